"""Robots that learn their cameras and an arm of six joints, before they look into mirrors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError, SelfModelError
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.camera_scenario import (
    ArmScenario,
    Counts,
    learn_arm,
    nominal_with,
    watch_hand,
)
from nico_selfmodel.sessions.progress import Stage, of_robot, telling
from nico_selfmodel.sessions.rendered_nico import FIDUCIAL, RenderedNico
from nico_selfmodel.systems.looking import touching_arm
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections

_COUNTS = Counts(boards=120, circle=0, random=360, test=12)
"""What arm and cameras are learned from. The hand's marker is 20 mm from the wrist's axis, about
which it makes no circle to learn from."""


@dataclass(frozen=True, eq=False)
class Acquainted:
    """A robot, and what it has learned of itself."""

    seed: int
    """Which robot."""
    world: Imperfections
    """What is wrong with its body."""
    model: SelfModel
    """Arm and cameras."""
    readings: NDArray
    """At which the arm was learned [encoder units]. Shape (N, n)."""


def rendered(robot: Acquainted, quality: ImageQuality | None = None) -> RenderedNico:
    """Return a robot as it is built, its arm of six joints."""
    return RenderedNico(robot.world, robot.seed, (FIDUCIAL,), quality, touching_arm(FIDUCIAL))


def acquainted(
    world: Imperfections, seeds: Sequence[int], progress: Stage | None = None
) -> tuple[Acquainted, ...]:
    """Let robots learn their cameras from chessboards and their arms from pictures of their hands.

    Args:
        seeds: Which robots.

    Raises:
        EstimationError: If one cannot, with its seed.
    """
    found = []
    for i, seed in enumerate(seeds):
        try:
            learned = learn_six_joints(world, seed, of_robot(progress, i, len(seeds)))
        except SelfModelError as error:
            raise EstimationError(f"robot {seed} did not learn its arm: {error}") from error
        found.append(Acquainted(seed, world, learned.model, learned.train.encoders))
    return tuple(found)


def learn_six_joints(
    world: Imperfections, seed: int, stage: Stage, held_out: int = _COUNTS.test
) -> ArmScenario:
    """Let a robot learn its cameras from chessboards and its arm from pictures of its hand.

    Of the marker on the hand the corners are located too: they tell how the hand is turned, which
    its middle, next to the last two axes, hardly does.

    Args:
        seed: Which robot.
        held_out: Poses to judge by, of which as many are tried as it takes: in a third of them the
            hand is seen.
    """
    arm = touching_arm(FIDUCIAL)
    nico = RenderedNico(world, seed, (FIDUCIAL,), ImageQuality(), arm, corners=True)
    seen = watch_hand(nico, replace(_COUNTS, test=held_out), stage)
    telling(stage, "learning the arm")(0, 1)
    nominal = nominal_with(nico.arm, FIDUCIAL)
    learned = learn_arm(seen.train, seen.test, seen.cameras, nominal, "nico", nico.workspace.up_C)
    telling(stage, "learning the arm")(1, 1)
    return learned
