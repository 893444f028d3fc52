"""One recording of a simulated whole Nico whose moving head sees its hands in mirrors."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.planning.body_before_mirror import BodyBeforeMirror
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.recording.recorded_samples import RecordedSamples
from nico_selfmodel.recording.session import Progress, sample_pose
from nico_selfmodel.sessions.whole_body import (
    attached_in_room,
    room_about_nico,
    seen_by,
    whole_nico,
)
from nico_selfmodel.systems.looking import ARM_JOINTS
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.instance import RobotInstance
from nico_selfmodel.systems.simulated.robot import SimulatedRobot
from nico_selfmodel.systems.simulated.sensors import StereoPixelsBeforeGlass

_POOL = 100
"""Poses of each hand, of which those are taken that tell most of where the glass stands."""
_TRIES = 5
"""Visits of a pose before it is given up."""


@dataclass(frozen=True, eq=False)
class BeforeMirrors:
    """What a whole Nico saw of itself, and where the mirrors really stood."""

    data: BodyDataset
    """The recording."""
    planes_true: Mapping[str, Plane]
    """Planes in the frame of the room, by mirror: for judging, never for learning."""


def session_before_mirrors(
    world: Imperfections,
    seed: int,
    session: int,
    mirrors: Mapping[str, Mirror],
    *,
    poses: int,
    name: str | None = None,
    pixel_sigma: float = 0.3,
    plate: MirrorPlate | None = None,
    progress: Progress | None = None,
) -> BeforeMirrors:
    """Record a whole Nico before mirrors, one after the other: it looks at its hands' reflections.

    Poses are those in which the robot as described would see a hand's card in the glass with both
    cameras, the hands by turns. Beside it are recorded, directly: what the glass leaves to be seen
    of the room, and finger tips, which are seen from all sides; a card that faces the glass is not.
    Of reflections: that card and finger tips. What hides markers is not simulated but for the
    glass.

    Args:
        seed: Which robot.
        session: Of poses and noise.
        mirrors: Where each stands before the left camera of the robot as described that looks
            straight ahead.
        poses: Poses before each mirror.
        name: Of the recording; robot and session if omitted.
        pixel_sigma: Noise of a pixel coordinate [px].
        plate: Of what size they are, and whether they are flat; what stains show is left out.

    Returns:
        The recording; lenses are told as they are, as calibrated cameras know them.

    Raises:
        ModelError: If hardly any pose shows a hand in one of the mirrors.
        ValueError: If no pose or no mirror is wanted.
    """
    if poses < 1 or not mirrors:
        raise ValueError(f"nothing to record: {poses} poses before {len(mirrors)} mirrors")
    nico, tree = whole_nico(world, seed)
    room, plate = room_about_nico(), plate or MirrorPlate()
    view, rng = BodyView(nico.body, attached_in_room(room)), np.random.default_rng((seed, session))
    cards = [f"{side}_hand_fiducial" for side in ARM_JOINTS]
    before = {
        mirror: BodyBeforeMirror.of(view, place, (plate.width, plate.height), cards, rng)
        for mirror, place in mirrors.items()
    }
    plan = [
        (mirror, card, q)
        for mirror, standing in before.items()
        for card, q in standing.by_turns(cards, poses, rng, _POOL)
    ]
    glass = next(iter(before.values())).glass
    first = StereoPixelsBeforeGlass(pixel_sigma, glass, plate.radius)
    instance = RobotInstance(nico.mechanics, X_TB=nico.X_TB)
    robot = SimulatedRobot(instance, first, (seed, session, 28))
    body, angles = nico.body, np.array([q for _, _, q in plan])
    commands = commands_of_angles(robot.joints, body.lower, body.upper, angles)
    about = {
        "name": name or f"whole_nico_{seed}_{session}_mirrors",
        "source": world.origin("simulated whole nico before mirrors", seed, session),
        "seed": seed,
    }
    with RecordedSamples(robot.joints, robot.markers, about) as kept:
        for index, ((mirror, _, _), command) in enumerate(zip(plan, commands, strict=True)):
            glass = before[mirror].glass
            robot.sensor = StereoPixelsBeforeGlass(pixel_sigma, glass, plate.radius)
            sample_pose(robot, kept, index, "", command, _TRIES, mirror)
            if progress is not None:
                progress(index + 1, len(plan))
    data = seen_by(tree, room, kept.dataset())
    facing = [card for index, (_, card, _) in enumerate(plan) if kept.visits(index)]
    shown = data.of_rows(_shown(data, facing))
    return BeforeMirrors(shown, {mirror: b.glass.plane for mirror, b in before.items()})


def _shown(data: BodyDataset, wanted: list[str]) -> NDArray:
    """Return what a camera could find: of cards only the one that faces the glass, there. (N,)."""
    table = data.observations
    names = np.array([marker.name for marker in data.markers])[table.marker]
    of_room = np.array([data.on_link(m.on) for m in data.markers])[table.marker] == WORLD
    cards = np.isin(names, sorted(set(wanted)))
    there = ~of_room & (~cards | (names == np.array(wanted)[table.pose]))
    return np.where(table.mirror == "", ~cards, there)
