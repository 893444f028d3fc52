"""Chapter 7 of the thesis: an arm learned from pictures of its hand, by fiducial and by colour."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.experiments.experiment_report import ExperimentReport, Pair, Table, bars, spread
from nico_selfmodel.sessions.camera_scenario import ArmScenario, learn_cameras_and_arm
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.viz.figures.experiment_charts import bar_chart

ROWS = {"color": "finger_tip", "fiducial": "fiducial"}
"""How the hand is tracked -> what is tracked."""
ARM_MM = {"color": 317.0, "fiducial": 272.0}
"""Length of the arm to the tracked point, by calipers (section 7.4)."""
THESIS_MM = {"color": (3.77, 2.30), "fiducial": (2.74, 1.39)}
"""Distance of the predicted hand from what stereo measures: mean and SD [mm], figure 7.5."""
THESIS_PX = {"color": (5.78, 4.50), "fiducial": (4.55, 2.74)}
"""Distance of the predicted pixels from the tracked ones: mean and SD [px], figure 7.7."""


@dataclass(frozen=True)
class VisionRow:
    """One way of tracking, averaged over robots."""

    tracked: str
    """`color` or `fiducial`."""
    train_poses: float
    """Poses learned from."""
    test_poses: float
    """Poses judged by."""
    mm: tuple[float, float]
    """Mean and SD over the test poses of the distance in space [mm]."""
    arm: tuple[float, float]
    """The same as a share of the arm's length."""
    px: tuple[float, float]
    """Mean and SD over the test poses and both cameras of the distance in the image [px]."""
    worst: tuple[float, float]
    """Largest mean of a robot [mm, px]."""
    thesis_mm: tuple[float, float]
    """The thesis' mean and SD [mm]."""
    thesis_px: tuple[float, float]
    """The thesis' mean and SD [px]."""


@dataclass(frozen=True)
class VisionExperiment:
    """Everything that chapter 7 reports, through rendered pictures."""

    world: str
    """Name of the simulated world."""
    individuals: int
    """Simulated robots averaged over."""
    boards_px: float
    """Mean rms of the cameras' own calibration [px]."""
    rows: tuple[VisionRow, ...]
    """By colour and by fiducial."""


def run_vision(
    world: Imperfections,
    *,
    individuals: int = 1,
    seed: int = 0,
    progress: Stage | None = None,
) -> VisionExperiment:
    """Let robots learn cameras and arm from pictures, in which both markers are tracked.

    Args:
        individuals: Simulated robots.
        seed: Of the first one.
    """
    scenarios = []
    for i in range(individuals):
        stage = of_robot(progress, i, individuals)
        markers = tuple(ROWS.values())
        scenarios.append(learn_cameras_and_arm(world, seed + i, markers=markers, stage=stage))
    rows = tuple(
        _row(tracked, [scenario.arms[marker] for scenario in scenarios])
        for tracked, marker in ROWS.items()
    )
    boards = float(np.mean([scenario.cameras.rms for scenario in scenarios]))
    return VisionExperiment(world.name, individuals, boards, rows)


def _row(tracked: str, scenarios: list[ArmScenario]) -> VisionRow:
    space = [_required(scenario.seen.statistics) for scenario in scenarios]
    image = [_required(scenario.seen.pixel_statistics) for scenario in scenarios]
    mm = (1e3 * _mean(space, "mean"), 1e3 * _mean(space, "sd"))
    return VisionRow(
        tracked,
        float(np.mean([len(scenario.train) for scenario in scenarios])),
        float(np.mean([len(scenario.test) for scenario in scenarios])),
        mm,
        (mm[0] / ARM_MM[tracked], mm[1] / ARM_MM[tracked]),
        (_mean(image, "mean"), _mean(image, "sd")),
        (1e3 * max(s.mean for s in space), max(s.mean for s in image)),
        THESIS_MM[tracked],
        THESIS_PX[tracked],
    )


def _required(statistics: ErrorStatistics | None) -> ErrorStatistics:
    assert statistics is not None, "test poses are recorded until both cameras saw the hand"
    return statistics


def _mean(statistics: list[ErrorStatistics], name: str) -> float:
    return float(np.mean([getattr(one, name) for one in statistics]))


def report_of(results: VisionExperiment) -> ExperimentReport:
    """Return ours beside the thesis', with charts like figures 7.5 to 7.7."""
    head = (
        "# Learning an arm from pictures (thesis, chapter 7)\n\n"
        f"Ours: {results.individuals} simulated robot(s), imperfections `{results.world}`, seen "
        "through rendered pictures; cameras learned from rendered chessboards "
        f"({results.boards_px:.2f} px rms). Distance of the predicted hand from the tracked one on "
        "new random poses, mean (SD): in space [mm], as a share of the arm, in the image [px]. "
        "Thesis: the real robot, one run.\n\n"
    )
    rows = results.rows
    charts = {
        "in_space": _chart(
            rows, [(row.mm, row.thesis_mm) for row in rows], "error in space [mm]",
            "The hand is where the arm says, to a few millimetres",
        ),
        "as_share_of_the_arm": _chart(
            rows, [(_times(100.0, row.arm), _times(100.0, _thesis_arm(row))) for row in rows],
            "error / length of the arm [%]",
            "To the arm's length, fiducial and colour are nearly alike",
        ),
        "in_the_image": _chart(
            rows, [(row.px, row.thesis_px) for row in rows], "error in the image [px]",
            "And it is seen where arm and cameras together predict it",
        ),
    }  # fmt: skip
    return ExperimentReport(head, (_table(results),), charts, asdict(results))


def _table(results: VisionExperiment) -> Table:
    headings = ("tracked by", "train", "test", "mm", "thesis", "arm", "thesis", "px", "thesis")
    rows = [
        [
            row.tracked,
            f"{row.train_poses:.0f}",
            f"{row.test_poses:.0f}",
            spread(row.mm),
            spread(row.thesis_mm),
            spread(row.arm, 4),
            spread(_thesis_arm(row), 4),
            spread(row.px),
            spread(row.thesis_px),
        ]
        for row in results.rows
    ]
    title = (
        f"Predicted against tracked hand, new poses, {results.individuals} simulated, "
        f"{results.world}"
    )
    return Table(title, headings, rows)


def _thesis_arm(row: VisionRow) -> tuple[float, float]:
    """Return the thesis' error as a share of the arm's length."""
    return _times(1.0 / ARM_MM[row.tracked], row.thesis_mm)


def _times(factor: float, pair: tuple[float, float]) -> tuple[float, float]:
    return factor * pair[0], factor * pair[1]


def _chart(rows: Sequence[VisionRow], pairs: Sequence[tuple[Pair, Pair]], *labels: str) -> Any:
    """Draw ours and the thesis' for every row; labels are that of the axis and the title."""
    ours, theirs = zip(*pairs, strict=True)
    series = [bars("ours, simulated", ours), bars("thesis, real robot", theirs, published=True)]
    groups, (ylabel, title) = [row.tracked for row in rows], labels
    return bar_chart(groups, series, title=title, ylabel=ylabel, xlabel="tracked by")
