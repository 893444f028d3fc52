"""Robots that know their cameras and their arm, before the mirror test begins."""

from collections.abc import Sequence
from dataclasses import dataclass

from numpy.typing import NDArray

from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.camera_scenario import Counts, learn_cameras_and_arm
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.simulated.imperfections import Imperfections

MARKER = "fiducial"
"""What is tracked on the hand."""
_COUNTS = Counts(boards=12, circle=32, random=60, test=12)
"""What arm and cameras are learned from."""


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


def acquainted(
    world: Imperfections, seeds: Sequence[int], progress: Stage | None = None
) -> tuple[Acquainted, ...]:
    """Let robots learn their cameras from chessboards and their arms from pictures of their hands.

    Args:
        world: What is wrong with the bodies.
        seeds: Which robots.
        progress: Told how far it is.
    """
    found = []
    for i, seed in enumerate(seeds):
        stage = of_robot(progress, i, len(seeds))
        learned = learn_cameras_and_arm(
            world, seed, markers=(MARKER,), counts=_COUNTS, stage=stage
        ).arms[MARKER]
        found.append(Acquainted(seed, world, learned.model, learned.train.encoders))
    return tuple(found)
