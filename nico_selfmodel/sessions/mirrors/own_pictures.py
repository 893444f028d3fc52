"""Pictures of one's own in mirrors: what was seen, what was expected, what of it surprises."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.mirrors.mirror import evaluate_mirrors
from nico_selfmodel.estimation.observations.matching import reading_columns
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording.recorded_samples import IMAGES, POSE
from nico_selfmodel.sessions.looks.expecting import Expecting, MirrorLook, Unknown
from nico_selfmodel.sessions.looks.known_body import Shot, know_body
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.images.image_file import read_image
from nico_selfmodel.vision.images.motion_mask import picture_noise

MOST_UNLIKE = 0.25
"""Share of the body that may look otherwise than expected: marks are small, other things are not.
"""
_ELSEWHERE = 4.0
"""How much farther off than where its mirrors were learned the hand may be seen."""


@dataclass(frozen=True, eq=False)
class OwnLook:
    """One pose before one mirror."""

    sample: int
    """Of the recording."""
    mirror: str
    """Which mirror."""
    pair: tuple[MirrorLook, MirrorLook]
    """Of the left and the right camera."""
    places: tuple[tuple[str, ...], tuple[str, ...]]
    """Link that is expected at each surprising place, of either camera."""


def look_at_own_pictures(
    model: SelfModel,
    data: Dataset,
    folder: str | Path,
    most: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[OwnLook, ...]:
    """Hold a recording's pictures before mirrors against what the body should look like there.

    How body and head stand is told by the pictures themselves (`know_body`): a mark is small, and
    what does not fit counts little. The noise of a camera is told by two poses before one mirror,
    between which most stood still. What colours and places are not known by is what a description
    is known to: nothing was learned of an unmarked body.

    Args:
        model: Arm, cameras and mirrors, and the robot's description.
        data: Poses before these mirrors.
        folder: In which it lies, with its pictures.
        most: Poses before each mirror.
        progress: Told how many pictures are done.

    Returns:
        Looks, mirror by mirror.

    Raises:
        ModelError: If the model lacks mirrors, cameras or a description, or a mirror failed.
        DataError: If the recording has no pictures in these mirrors, or they show something else.
        EstimationError: If hardly anything of the body is in view.
    """
    if not model.mirrors:
        raise ModelError(
            f"self-model {model.name!r} has no mirror: learn it with `nico-selfmodel calibrate "
            "mirror`"
        )
    robot = described(model)
    samples, shots = own_shots(model, data, folder, most)
    _require_own_hand(model, data)
    noise = picture_noises(shots)
    done: list[OwnLook] = []
    with BodyImage(robot, model) as image:
        body = know_body(image, model, shots)
        for sample, shot in zip(samples, shots, strict=True):
            expecting = Expecting(image, model.rig, body.mirror(shot.mirror), noise, Unknown())
            left, right = (
                expecting.judged(side, picture, shot.readings)
                for side, picture in enumerate(shot.pictures)
            )
            _require_own_body(image, sample, shot.mirror, (left, right))
            places = _links(image, left), _links(image, right)
            done.append(OwnLook(sample, shot.mirror, (left, right), places))
            if progress:
                progress(len(done), len(shots))
    return tuple(done)


def own_shots(
    model: SelfModel, data: Dataset, folder: str | Path, most: int
) -> tuple[list[int], list[Shot]]:
    """Return what a recording kept of looks into mirrors that the model knows.

    Args:
        most: Poses before each mirror.

    Returns:
        Samples, and readings and pictures of each, mirror by mirror.

    Raises:
        ModelError: If a mirror failed its calibration.
        DataError: If there are none, or a picture has another size than the cameras'.
    """
    names = [name for name in dict.fromkeys(data.mirror.tolist()) if name]
    known = [name for name in names if name in model.mirrors]
    if not known:
        got = f"was made in {listed(names)}" if names else "shows no mirror"
        raise DataError(
            f"data set {data.name!r} {got}; the self-model knows {listed(model.mirrors)}"
        )
    if POSE not in data.extra or not (Path(folder) / IMAGES).is_dir():
        raise DataError(f"{folder}: no pictures were kept; record them with `record --images`")
    columns, samples, shots = reading_columns(model, data), [], []
    for name in known:
        failure = model.mirror_failure(name)
        if failure is not None:
            raise ModelError(f"mirror {name!r} failed its calibration: {failure}")
        rows = np.flatnonzero(data.mirror == name)
        first = rows[np.unique(data.sample[rows], return_index=True)[1]][:most]
        for row in first.tolist():
            pictures = pictures_of(model, Path(folder), int(data.extra[POSE][row]))
            samples.append(int(data.sample[row]))
            shots.append(Shot(name, data.encoders[row][columns], pictures))
    return samples, shots


def pictures_of(model: SelfModel, folder: Path, pose: int) -> tuple[NDArray, NDArray]:
    """Return both cameras' pictures of a pose of a recording."""
    found = []
    for side, camera in zip(SIDES, model.rig.cameras, strict=True):
        path = folder / IMAGES / f"{side}{pose:04d}.png"
        picture = read_image(path)
        height, width = picture.shape[:2]
        if (width, height) != camera.image_size:
            raise DataError(
                f"{path} has {width} x {height} pixels, the self-model's cameras have "
                f"{camera.image_size[0]} x {camera.image_size[1]}: other cameras took it"
            )
        found.append(picture)
    return found[0], found[1]


def described(model: SelfModel) -> ArmDescription:
    """Return the description that tells shape and colours."""
    robot = ArmDescription.of_model(model)
    if robot is None:
        raise ModelError(
            f"self-model {model.name!r} names no robot, so that nothing is known of its shape: "
            "learn the arm with `calibrate kinematics --robot`"
        )
    return robot


def _require_own_hand(model: SelfModel, data: Dataset) -> None:
    """Refuse reflections of a hand that is not where the self-model has it.

    Raises:
        DataError: Naming how far off it is.
    """
    own = np.isin(data.mirror, [*model.mirrors]) & np.isfinite(data.pixels).any(axis=1)
    learned = model.fit.get("mirrors")
    if not own.any() or not isinstance(learned, Mapping) or "rms_px" not in learned:
        return
    found = evaluate_mirrors(data.select(own), model, model.mirrors)
    off, usual = float(np.median(found.distances_px)), float(learned["rms_px"])
    if off > _ELSEWHERE * usual:
        raise DataError(
            f"data set {data.name!r}: the hand is seen {off:.0f} px from where the self-model "
            f"expects it in its mirrors, where it was {usual:.1f} px when they were learned: other "
            "cameras took the pictures, or a mirror was moved"
        )


def _require_own_body(
    image: BodyImage, sample: int, mirror: str, pair: tuple[MirrorLook, MirrorLook]
) -> None:
    """Refuse pictures that show something else.

    Raises:
        DataError: Naming the sample.
    """
    numbers = set(image.links) - image.moving
    share = max(look.unlike(numbers) for look in pair)
    if share > MOST_UNLIKE:
        raise DataError(
            f"sample {sample}: {100.0 * share:.0f} % of the body in mirror {mirror!r} looks "
            "otherwise than expected: no mirror is in view, or it is dirty, bent, or ends before "
            "the body"
        )


def picture_noises(shots: Sequence[Shot]) -> tuple[float, float]:
    """Return the standard deviation of a grey level of either camera.

    Raises:
        DataError: If no mirror has two poses.
    """
    both = [pair for pair in pairwise(shots) if pair[0].mirror == pair[1].mirror]
    if not both:
        raise DataError(
            "two poses before one mirror are needed, got one before each: what stood still "
            "between them tells the noise of the cameras"
        )
    left, right = (
        float(np.median([picture_noise(a.pictures[side], b.pictures[side]) for a, b in both]))
        for side in range(len(SIDES))
    )
    return left, right


def _links(image: BodyImage, look: MirrorLook) -> tuple[str, ...]:
    numbers = [int(look.labels[round(b.v), round(b.u)]) for b in look.blobs]
    return tuple(image.links.get(number, "beside the body") for number in numbers)
