"""Cameras and arm, learned one after the other, are jointly refined (thesis, chapter 8)."""

from dataclasses import dataclass

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.verdict import Verdict
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.camera_scenario import (
    ArmScenario,
    CameraScenario,
    Counts,
    RenderedNico,
    learn_cameras_and_arm,
)
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.systems.simulated.imperfections import Imperfections

TEST_SESSION = 3
"""Day on which boards are shown that nobody learns from."""


@dataclass(frozen=True, eq=False)
class BodyScenario:
    """Cameras and arm learned one after the other, and then together."""

    cameras: CameraScenario
    """One after the other."""
    arm: ArmScenario
    """The arm among them that the body has."""
    test_boards: BoardViews
    """Boards that nobody learned from."""
    refined: BodyCalibration | None
    """Together; None where that came to no end."""
    verdict: Verdict
    """What is thought of that."""

    @property
    def accepted(self) -> bool:
        """Whether the refinement is kept."""
        return self.verdict.status != "FAIL"

    @property
    def model(self) -> SelfModel:
        """What is kept: the refined body, or the one before if the refinement was refused."""
        if self.refined is None or not self.accepted:
            return self.arm.model
        return self.refined.model


def learn_body(
    world: Imperfections | str,
    seed: int = 0,
    *,
    marker: str = "fiducial",
    counts: Counts | None = None,
    stage: Stage | None = None,
) -> BodyScenario:
    """Calibrate the cameras, move the arm before them, learn it, and refine both together.

    Args:
        seed: Which robot.
        marker: What is tracked on the hand: `fiducial` or `finger_tip`.
    """
    counts = counts or Counts()
    scenario = learn_cameras_and_arm(world, seed, markers=(marker,), counts=counts, stage=stage)

    boards = RenderedNico(world, seed, (marker,)).board_views(
        counts.test_boards, TEST_SESSION, progress=telling(stage, "more boards, kept for judging")
    )
    telling(stage, "refining arm and cameras together")(0, 1)
    found = refine(scenario, marker, boards)
    telling(stage, "refining arm and cameras together")(1, 1)
    return found


def refine(scenario: CameraScenario, marker: str, test_boards: BoardViews) -> BodyScenario:
    """Let arm and cameras refine each other on what they were learned from.

    Args:
        scenario: Cameras and arm, learned one after the other.
        marker: The arm to take.
        test_boards: Boards that nobody learned from.
    """
    arm = scenario.arms[marker]
    try:
        found = calibrate_body(
            arm.train,
            arm.model,
            scenario.views,
            test=arm.test,
            test_boards=test_boards,
            up=scenario.up,
        )
    except EstimationError as error:
        return BodyScenario(scenario, arm, test_boards, None, Verdict("FAIL", (str(error),)))
    return BodyScenario(scenario, arm, test_boards, found, judge(found))
