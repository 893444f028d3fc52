"""Chapter 6 of the thesis: an arm learned under motion capture, from few and from many samples."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.parallel import Workers
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import Imperfections

MANY, FEW = 104, 9
ARCS = {MANY: 0.5, FEW: 0.25}
"""Share of the visible arcs that the sweeps cover: the thesis' results with circles alone tell of
arcs that were short."""
TEST_POSES = 100
RANDOM_POSES = (0, 50, 100, 500)

THESIS_MM = {
    (FEW, "circle points", 0): (132.60, 65.53),
    (MANY, "circle points", 0): (17.15, 9.15),
    (FEW, "refined", 0): (47.38, 34.24),
    (MANY, "refined", 0): (7.44, 3.51),
    (FEW, "refined", 100): (15.32, 9.54),
    (FEW, "refined", 500): (14.86, 8.87),
    (MANY, "refined", 100): (3.19, 1.71),
    (MANY, "refined", 500): (2.97, 1.78),
}
"""Mean and SD of the error on 100 random poses of the real robot [mm], figures 6.8 and 6.9."""
THESIS_REPEATS = {"train": (2.47, 0.091), "test": (3.21, 0.039)}
"""Mean and SD over 100 random subsets [mm], section 6.4."""


@dataclass(frozen=True)
class Row:
    """One condition: ours beside the thesis'."""

    circle_samples: int
    """Samples on circles, 9 or 104."""
    method: str
    """`circle points` or `refined`."""
    random_samples: int
    """Random poses added to the training data."""
    mean_mm: float
    """Mean error on the test poses, averaged over robots."""
    sd_mm: float
    """SD of the error over the test poses, averaged over robots."""
    worst_mm: float
    """Largest mean error of a robot."""
    seconds: float
    """Mean time of the estimate."""
    thesis_mm: tuple[float, float] | None
    """Mean and SD of the thesis, where it reports them."""


@dataclass(frozen=True)
class Repeats:
    """The repeat test: one arm, many random subsets of the training poses."""

    train_mm: tuple[float, float]
    """Mean and SD over subsets of the mean training error."""
    test_mm: tuple[float, float]
    """Mean and SD over subsets of the mean test error."""
    links_mm: tuple[tuple[float, float], ...]
    """Mean and SD of the upper arm and the forearm up to the marker."""
    seconds: float
    """Mean time of an estimate."""


@dataclass(frozen=True)
class MotionCaptureExperiment:
    """Everything that chapter 6 reports, simulated."""

    world: str
    """Name of the simulated world."""
    individuals: int
    """How many simulated robots the rows average over."""
    rows: tuple[Row, ...]
    """The two charts, row by row."""
    repeats: Repeats
    """The repeat test."""


def run_motion_capture(
    arm: ArmDescription,
    world: Imperfections,
    *,
    individuals: int = 5,
    repeats: int = 100,
    seed: int = 0,
    progress: Stage | None = None,
    workers: Workers | None = None,
) -> MotionCaptureExperiment:
    """Run the chapter's two charts and its repeat test.

    Args:
        individuals: Simulated robots to average over.
        repeats: Random subsets of the repeat test.
        seed: Of the first robot.
        progress: Called with what is going on, steps done and steps in all.
        workers: Who lets the robots learn; this process if omitted.
    """
    report = progress or (lambda what, done, total: None)
    conditions = [(n, "circle points", 0) for n in (FEW, MANY)]
    conditions += [(n, "refined", k) for n in (FEW, MANY) for k in RANDOM_POSES]
    of_robots = (workers or Workers()).map(
        partial(_charts_of, arm, world, tuple(conditions)),
        range(seed, seed + individuals),
        lambda done, total: report("charts", done, total),
    )
    rows = tuple(map(_row, conditions, zip(*of_robots, strict=True)))
    repeated = _repeat(_Sessions(arm, world, seed), repeats, report)
    return MotionCaptureExperiment(world.name, individuals, rows, repeated)


@dataclass(frozen=True)
class _Outcome:
    """What one robot reached in one condition."""

    mean_mm: float
    sd_mm: float
    seconds: float


def _charts_of(
    arm: ArmDescription,
    world: Imperfections,
    conditions: tuple[tuple[int, str, int], ...],
    seed: int,
) -> list[_Outcome]:
    """Return what one robot reaches in each condition, wherever this runs."""
    sessions, found = _Sessions(arm, world, seed), []
    for condition in conditions:
        result = _estimate(sessions, *condition)
        assert result.test is not None
        errors = result.test.statistics
        found.append(_Outcome(1e3 * errors.mean, 1e3 * errors.sd, result.seconds))
    return found


class _Sessions:
    """The recordings of one robot, made when first asked for."""

    def __init__(self, arm: ArmDescription, world: Imperfections, seed: int) -> None:
        def session(protocol: SweepProtocol, number: int, sweeps: bool = True) -> Dataset:
            return simulated_session(
                arm, world, protocol, f"session {number}", seed=seed, session=number, sweeps=sweeps
            )

        protocol = SweepProtocol.for_arm(arm)
        self.seed = seed
        self.circles = {
            MANY: session(protocol.on_share_of_arcs(ARCS[MANY]), 0),
            FEW: session(protocol.on_share_of_arcs(ARCS[FEW]).minimal(), 1),
        }
        most = replace(protocol, random_poses=max(RANDOM_POSES))
        self.random = session(most, 2, sweeps=False)
        self.test = session(replace(protocol, random_poses=TEST_POSES), 3, sweeps=False)

    def train(self, circle_samples: int, random_rows: np.ndarray) -> Dataset:
        """Return circles with some of the random poses behind them."""
        circles = self.circles[circle_samples]
        return joined(circles, self.random.select(random_rows)) if len(random_rows) else circles


def joined(first: Dataset, second: Dataset) -> Dataset:
    """Return the rows of two data sets of one body, samples numbered on."""
    offset = int(first.sample.max())
    arrays = ("encoders", "p_WH_measured", "sweep", "marker", "pixels", "mirror")
    both = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in arrays}
    sample = np.concatenate([first.sample, second.sample + offset])
    return replace(first, sample=sample, extra={}, **both)


def _estimate(
    sessions: _Sessions, circle_samples: int, method: str, random_samples: int
) -> KinematicCalibration:
    train = sessions.train(circle_samples, np.arange(random_samples))
    how = "circle-points" if method == "circle points" else "refine"
    return calibrate_kinematics(train, method=how, test=sessions.test, seed=sessions.seed)


def _row(condition: tuple[int, str, int], outcomes: Sequence[_Outcome]) -> Row:
    means = np.array([one.mean_mm for one in outcomes])
    return Row(
        *condition,
        float(means.mean()),
        float(np.mean([one.sd_mm for one in outcomes])),
        float(means.max()),
        float(np.mean([one.seconds for one in outcomes])),
        THESIS_MM.get(condition),
    )


def _repeat(sessions: _Sessions, count: int, report: Stage) -> Repeats:
    """Refine from the 104 circle samples and a random half of the random poses, many times."""
    rng = np.random.default_rng((sessions.seed, 9))
    rows = np.arange(len(sessions.random))
    train, test, links, seconds = [], [], [], []
    for done in range(count):
        report("repeats", done, count)
        chosen = np.sort(rng.choice(rows, len(rows) // 2, replace=False))
        result = calibrate_kinematics(sessions.train(MANY, chosen), test=sessions.test, seed=done)
        assert result.test is not None
        train.append(1e3 * result.train.distances[~result.outliers].mean())
        test.append(1e3 * result.test.statistics.mean)
        links.append(link_lengths_mm(result))
        seconds.append(result.seconds)
    return Repeats(
        _mean_sd(train),
        _mean_sd(test),
        tuple(_mean_sd(column) for column in np.array(links).T),
        float(np.mean(seconds)),
    )


def link_lengths_mm(result: KinematicCalibration) -> tuple[float, float]:
    """Return shoulder to elbow and elbow to tracked point [mm].

    The shoulder is where the first two axes pass closest, the elbow where the last two do.
    """
    frames = result.model.dh.frames(np.zeros(len(result.model.joints)))
    shoulder, elbow = frames[1][:3, 3], frames[-2][:3, 3]
    hand = result.model.chain.p_WH_zero[0]
    return (
        1e3 * float(np.linalg.norm(elbow - shoulder)),
        1e3 * float(np.linalg.norm(hand - elbow)),
    )


def _mean_sd(values: list[float]) -> tuple[float, float]:
    array = np.asarray(values, dtype=float)
    return float(array.mean()), float(array.std(ddof=1)) if len(array) > 1 else 0.0
