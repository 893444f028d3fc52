"""A robot of the mirror test looks at its own arm, without a mirror, and learns its shape."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.recording.recorded_samples import RecordedSamples
from nico_selfmodel.recording.session import sample_pose
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted
from nico_selfmodel.sessions.mirrors.own_shape import Surfaces
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.sessions.rendered_nico import FIDUCIAL, RenderedNico
from nico_selfmodel.sessions.shapes.moving_shape import MovingShape, shape_of_arm
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.systems.looking import touching_arm
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.station_body import StationBody

ARM_LINKS = ("right_forearm", "right_hand")
"""Links of the arm whose shape is learned."""
_POSES = (40, 80)
"""In which the robot looks at its arm: in more where these show too little of it."""
_TRIES = 2
_DAY = 10


def spread(readings: NDArray, count: int) -> NDArray:
    """Return readings that lie far from each other, in parts of what each joint turns by.

    The first is the one in the middle, each further one that which is farthest from all before it.

    Args:
        readings: Some more than once. Shape (N, n).
        count: How many at most.

    Returns:
        Shape (count, n), or fewer where there are no more.
    """
    each = np.unique(readings, axis=0)
    parts = (each - each.mean(axis=0)) / np.maximum(np.ptp(each, axis=0), 1e-12)
    chosen = [int(np.argmin(np.linalg.norm(parts, axis=1)))]
    apart = np.full(len(each), np.inf)
    for _ in range(min(count, len(each)) - 1):
        apart = np.minimum(apart, np.linalg.norm(parts - parts[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(apart)))
    return each[chosen]


@dataclass(frozen=True, eq=False)
class ArmStructure:
    """What a robot has learned of its arm's shape, and what is true."""

    shape: MovingShape
    """As learned."""
    surfaces: tuple[Surfaces, ...]
    """All that is true in each look that counted: for judging, never for learning."""


def learn_arm_structure(robot: Acquainted, stage: Stage) -> ArmStructure:
    """Let a robot look at its arm in poses in which it was learned, and learn forearm and hand.

    Args:
        robot: Who has learned arm and cameras.

    Raises:
        EstimationError: If too few poses show a link, or no surface is found.
    """
    for poses in _POSES:
        with TemporaryDirectory() as folder:
            looks = Path(folder) / "arm"
            data, surfaces = look_at_arm(robot, looks, poses, stage)
            free_memory()
            rng = np.random.default_rng((robot.seed, 54))
            try:
                shape = shape_of_arm(robot.model, data, looks, ARM_LINKS, rng, stage)
            except EstimationError:
                if poses == _POSES[-1]:
                    raise
                continue
        counted = shape.errors.sample[shape.errors.expected]
        return ArmStructure(shape, tuple(surfaces[int(sample)] for sample in counted))
    raise AssertionError("the last look returns or raises")


def look_at_arm(
    robot: Acquainted, folder: Path, poses: int, stage: Stage, day: int = _DAY
) -> tuple[Dataset, dict[int, Surfaces]]:
    """Let a robot look at its arm in poses that are far from each other.

    Args:
        robot: Who has learned arm and cameras.
        folder: Where its pictures are kept.
        poses: How many; the same come first whatever their number.
        day: On which.

    Returns:
        What it saw, whose pictures lie in the folder, and all true surfaces in each sample.
    """
    arm = touching_arm(FIDUCIAL)
    nico = RenderedNico(robot.world, robot.seed, (FIDUCIAL,), ImageQuality(), arm, corners=True)
    plan = spread(robot.readings, poses)
    tell, true = telling(stage, "looking at its arm"), {}
    with nico.station(day, robot.model.rig) as station:
        body = StationBody(station, station.joints, nico.tracked, keep_images=True)
        about = {
            "name": "arm",
            "source": station.world.origin("rendered nico", robot.seed, day),
            "seed": robot.seed,
            "image_size": station.image_size,
        }
        with RecordedSamples(station.joints, nico.tracked, about, folder) as kept:
            for index, command in enumerate(plan):
                sample_pose(body, kept, index, "", command, _TRIES)
                if kept.visits(index):
                    true[len(true) + 1] = station.surfaces_true(body.context)
                tell(index + 1, len(plan))
    return kept.dataset(), true
