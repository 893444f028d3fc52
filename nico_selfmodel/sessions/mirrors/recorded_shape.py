"""The outer shape of links from a recording that kept its pictures in many mirrors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration, calibrate_mirrors
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.recording.recorded_samples import POSE
from nico_selfmodel.sessions.looks.expecting import Expecting, Unknown
from nico_selfmodel.sessions.looks.known_body import Shot, know_body
from nico_selfmodel.sessions.mirrors.learned_shape import LearnedShape, Skeleton, learn_shape
from nico_selfmodel.sessions.mirrors.own_pictures import (
    described,
    own_shots,
    picture_noises,
    pictures_of,
)
from nico_selfmodel.sessions.mirrors.shape_looks import (
    ShapeLooks,
    shown_enough,
    well_told,
)
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.systems.rendering.body_image import BodyImage

_MOST = 5
"""Poses before each mirror among which that is taken which covers least."""
_POSTURE = 2
"""Mirrors that tell how the body stands."""


@dataclass(frozen=True, eq=False)
class RecordedShape:
    """What pictures of one's own told."""

    mirrors: MirrorCalibration
    """Where the mirrors stand, by the hand in them."""
    shape: LearnedShape
    """Links, by head and body in them."""


def shape_of_recording(
    model: SelfModel,
    data: Dataset,
    folder: str | Path,
    links: Sequence[str],
    rng: np.random.Generator,
    stage: Stage | None = None,
    test: Dataset | None = None,
) -> RecordedShape:
    """Learn where the mirrors of a recording stand, and in them the outer shape of links.

    The hand tells the mirrors, the pictures how head and body stand before them, and a picture
    without a mirror the colour of the room.

    Args:
        model: Arm and cameras, and the robot's description.
        data: Poses before at least `FEWEST_MIRRORS` mirrors, and one without.
        folder: In which it lies, with its pictures.
        links: Whose shape is learned; they stand still in all pictures.
        rng: Source of samples of what is not known.
        stage: Told how far it is.
        test: Held-out poses before the same mirrors, which judge these.

    Raises:
        ModelError: If the model lacks cameras, an arm or a description.
        DataError: If pictures are missing, of another size, or in too few mirrors.
        EstimationError: If too few mirrors are told well, or no surface is found.
        ValueError: If a link does not exist, or moves with the arm.
    """
    shown = shown_enough(data.select(data.mirror != ""))
    if test is not None:
        judging = np.isin(test.mirror, np.unique(shown.mirror))
        test = test.select(judging) if judging.any() else None
    found = calibrate_mirrors(shown, model, test=test)
    told = replace(found.model, covariance=found.covariance)
    robot = described(told)
    _, shots = own_shots(told, data, folder, _MOST)
    noise = picture_noises(shots)
    with BodyImage(robot, told) as image:
        _require_standing(image, links)
        sure = sorted(found.mirrors, key=lambda name: _vague(told, name))[:_POSTURE]
        first = [next(shot for shot in shots if shot.mirror == name) for name in sure]
        know_body(image, told, first, telling(stage, "learning how it stands"))
        poses = image.poses(shots[0].readings)
        middles = np.array([poses[link][:3, 3] for link in links])
        known = {name: told.mirrors[name] for name in found.mirrors}
        mirrors = well_told(told.rig, known, middles)
        tree = KinematicTree.from_urdf(robot.urdf)
        skeleton = Skeleton.of(tree, poses, ends(tree, links))
        expecting = {
            m: Expecting(image, told.rig, mirror, noise, Unknown()) for m, mirror in mirrors.items()
        }
        choices = [[shot for shot in shots if shot.mirror == name] for name in mirrors]
        tell, seen = telling(stage, "choosing pictures"), []
        for one in choices:
            seen.append(_least_covered(expecting[one[0].mirror], one, links))
            tell(len(seen), len(choices))
    chosen, covered = zip(*seen, strict=True)
    room = _room(told, data, Path(folder))
    looks = ShapeLooks(MappingProxyType(mirrors), chosen, covered, room, noise)
    return RecordedShape(found, learn_shape(looks, told, skeleton, poses, links, rng, stage))


def _require_standing(image: BodyImage, links: Sequence[str]) -> None:
    """Refuse links that there are not, and those that move with the arm.

    Raises:
        ValueError: If there is one.
    """
    moving = {image.links[number] for number in image.moving}
    standing = sorted(set(image.links.values()) - moving)
    for link in links:
        if link in moving:
            raise ValueError(
                f"--link {link}: it moves with the arm, and a shape is learned of what stands still"
            )
        refuse_unknown("link", link, standing)


def _vague(model: SelfModel, mirror: str) -> float:
    """Return the variance of a mirror's tilts, by which mirrors are compared [rad^2]."""
    covariance = model.mirrors[mirror].covariance
    return np.inf if covariance is None else float(np.trace(covariance[:2, :2]))


def ends(tree: KinematicTree, links: Sequence[str]) -> tuple[str, ...]:
    """Return links that carry none of the others: all that hangs on them counts to them."""
    carrying = set()
    for link in links:
        above = link
        while above in tree.joint_above:
            above = tree.joint_above[above].parent_body().name()
            carrying.add(above)
    return tuple(link for link in links if link not in carrying)


def _least_covered(
    expecting: Expecting, shots: Sequence[Shot], links: Sequence[str]
) -> tuple[Shot, tuple[NDArray, NDArray]]:
    """Return the pictures before a mirror that show most of some links.

    Returns:
        They, and which pixels of each the moving arm may cover. Shape (h, w) each.
    """
    image = expecting.image
    wanted = [number for number, name in image.links.items() if name in links]
    best = None
    for shot in shots:
        shown, covered = 0, []
        for side in range(len(SIDES)):
            seen = image.expect(shot.readings, expecting.mirror, side)
            arm = expecting.covered(side, seen)
            shown += int((np.isin(seen.labels, wanted) & ~arm).sum())
            covered.append(arm)
        if best is None or shown > best[0]:
            best = shown, shot, (covered[0], covered[1])
    assert best is not None, "every mirror that is known has pictures"
    return best[1:]


def _room(model: SelfModel, data: Dataset, folder: Path) -> NDArray:
    """Return what the left camera saw without a mirror, BGR. Shape (h, w, 3).

    Raises:
        DataError: If there is no such picture.
    """
    rows = np.flatnonzero(data.mirror == "")
    if not len(rows):
        raise DataError(
            f"{folder}: no pose was recorded without a mirror, which tells the colour of the room: "
            "record one"
        )
    return pictures_of(model, folder, int(data.extra[POSE][rows[0]]))[0]
