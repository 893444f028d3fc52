"""A robot wakes up not knowing its arm, moves it, and learns it: the main job."""

import warnings
from dataclasses import dataclass, replace

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import Imperfections

_TEST_POSES = 100
"""Poses recorded for judging."""


@dataclass(frozen=True, eq=False)
class MotionCaptureScenario:
    """What was recorded and what was learned from it."""

    train: Dataset
    """Circles of every joint and random poses."""
    test: Dataset
    """Random poses that the learner does not see."""
    circle_points: KinematicCalibration | None
    """The arm from the circles alone; None where a joint's circle says too little."""
    refined: KinematicCalibration
    """The arm refined over all poses."""


def learn_by_motion_capture(
    arm: ArmDescription,
    world: Imperfections,
    *,
    seed: int = 0,
    random_poses: int = 100,
    stage: Stage | None = None,
) -> MotionCaptureScenario:
    """Record a simulated arm and learn it.

    Args:
        arm: The robot's arm as described. It shapes the simulated body and the exported URDF; the
            learner starts from the circles.
        random_poses: Poses recorded for training beside the circles.
        stage: Called with what is going on, steps done and steps in all.
    """
    protocol = SweepProtocol.for_arm(arm)
    train = simulated_session(
        arm,
        world,
        replace(protocol, random_poses=random_poses),
        "train",
        seed=seed,
        session=0,
        progress=telling(stage, "moving every joint, watching the hand"),
    )
    test = simulated_session(
        arm,
        world,
        replace(protocol, random_poses=_TEST_POSES),
        "test",
        seed=seed,
        session=1,
        sweeps=False,
        progress=telling(stage, "new poses, kept for judging"),
    )
    nominal = nominal_of(arm)
    learning = telling(stage, "learning")
    learning(0, 2)
    try:
        circles = calibrate_kinematics(train, method="circle-points", test=test, nominal=nominal)
    except NotIdentifiableError as error:
        warnings.warn(f"circles alone do not make an arm: {error}", stacklevel=2)
        circles = None
    learning(1, 2)
    refined = calibrate_kinematics(train, test=test, nominal=nominal, name=f"{arm.robot} arm")
    learning(2, 2)
    return MotionCaptureScenario(train, test, circles, refined)


def nominal_of(arm: ArmDescription) -> NominalArm:
    """Return what the estimators need of a robot description."""
    return NominalArm(arm.chain, arm.lower, arm.upper, arm.source)
