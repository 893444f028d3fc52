"""Nico learns cameras, an arm of six joints, two mirrors, and the shape of its head and chest."""

from dataclasses import dataclass

from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.camera_scenario import ArmScenario
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, learn_six_joints
from nico_selfmodel.sessions.mirrors.knowing import (
    PLATE,
    know_itself,
    learn_two_mirrors,
    trusting,
    with_mirrors,
)
from nico_selfmodel.sessions.mirrors.learned_shape import LearnedShape
from nico_selfmodel.sessions.mirrors.mirror_scenario import MirrorScenario
from nico_selfmodel.sessions.mirrors.own_shape import learn_structure
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.simulated.imperfections import Imperfections

_HELD_OUT = 40
"""Poses by which cameras and arm are judged."""


@dataclass(frozen=True, eq=False)
class ShapeScenario:
    """What a robot has learned of itself at the end."""

    arm: ArmScenario
    """Cameras and arm."""
    mirrors: MirrorScenario
    """Two mirrors, by its hand in them."""
    shape: LearnedShape
    """Head and chest, by these and by more mirrors that were put up for them."""

    @property
    def model(self) -> SelfModel:
        """Arm, cameras and mirrors."""
        return self.mirrors.model


def learn_own_shape(
    world: Imperfections, seed: int = 0, progress: Stage | None = None
) -> ShapeScenario:
    """Let a robot make its own acquaintance as before the mirror test, and learn its shape.

    Args:
        world: What is wrong with its body.
        seed: Which robot.
        progress: Told how far it is.

    Raises:
        EstimationError: If it learns no mirror, does not trust one, or finds no surface.
        ModelError: If hardly any pose shows its hand in a mirror.
    """
    stage = of_robot(progress, 0, 1)
    arm = learn_six_joints(world, seed, stage, _HELD_OUT)
    robot = Acquainted(seed, world, arm.model, arm.train.encoders)
    mirrors = learn_two_mirrors(robot, PLATE, stage)
    known = trusting(know_itself(with_mirrors(robot, mirrors), PLATE, stage))
    shape, _ = learn_structure(known, stage)
    return ShapeScenario(arm, mirrors, shape)
