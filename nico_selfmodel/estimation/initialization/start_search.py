"""Many starts, one minimum: which starts are tried, which is best, how many agree."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.hand_residuals import LineResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss, robust_scale
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly

ENOUGH_AGREE = 3
"""The search ends when this many starts have reached the best minimum ..."""
RANDOM = "random axes"
"""Label of a start from nothing."""
_NOISE = 3.0
"""... and it leaves less than this many standard deviations of the tracker, where several markers
of one hand tell them: a wrong minimum may attract more starts than the right one."""
_EXPLAINS = 0.005
"""... or less than this share of the workspace ..."""
_TRIED = 8
"""... after this many starts where all are random; or so many agree."""
_MOST_LEFT = 0.02
"""Above this share of the workspace only many that agree end the search."""
ASTRAY = 0.1
"""Share of the workspace that a random start leaves, itself a local optimum, above which it is a
wrong one: a right one leaves noise, be there outliers."""
_SEEN_TOGETHER = 5
"""Samples with both of two markers that tell how their distance scatters."""
SEARCH_ROWS = 150
"""Rows on which starts are tried: enough to tell one minimum from another."""


@dataclass(frozen=True, eq=False)
class LineSolution:
    """An arm refined from one start."""

    arm: ArmEstimate
    """The arm."""
    robust: RobustSolution
    """How it was solved, with its outliers."""
    residuals: NDArray
    """Predicted minus measured [m]. Shape (3, N)."""


@dataclass(frozen=True, eq=False)
class StartSearch:
    """The outcome of trying several starts."""

    best: LineSolution
    """The best minimum."""
    best_label: str
    """Where the best start came from."""
    labels: tuple[str, ...]
    """Where each start came from."""
    scores: NDArray
    """Cost of each start's minimum on one common scale; the lowest is best. Shape (starts,)."""
    agreeing: int
    """How many starts reached the best minimum, the best included."""


def refine_lines(
    observations: Observations,
    start: ArmEstimate,
    pinned_gears: NDArray,
    sigma: float,
    loss: str,
    *,
    rough: bool = False,
) -> LineSolution:
    """Refine an arm in the minimal line parameters.

    Args:
        start: Where to start.
        pinned_gears: Gears that stay at the start's value. Shape (n,).
        sigma: Whitening of the residuals [m].
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.
        rough: Stop early: good enough to tell one minimum from another.
    """
    program, block = line_program(observations, start, pinned_gears, sigma)
    robust = solve_robustly(program, 0, loss, rough=rough)
    arm = block.hypothesis(robust.solution.x)
    return LineSolution(arm, robust, sigma * program.residuals(0, robust.solution.x))


def line_program(
    observations: Observations, start: ArmEstimate, pinned_gears: NDArray, sigma: float
) -> tuple[CalibrationProgram, LineResiduals]:
    """Return the program of the lines about a start, and its residual block."""
    block = LineResiduals(observations, start, sigma)
    program = CalibrationProgram()
    program.add_variables(block.names, block.start)
    for joint, pinned in zip(observations.joints, pinned_gears, strict=True):
        if pinned:
            program.fix(f"{joint}.gear")
    program.add_residuals(block)
    return program, block


def search_starts(
    observations: Observations,
    few: Observations,
    starts: Iterable[tuple[str, ArmEstimate]],
    pinned_gears: NDArray,
    sigma: float,
    loss: str,
    astray: float = np.inf,
) -> StartSearch:
    """Refine each start, until enough of them agree on the best minimum.

    Args:
        few: The part of it on which starts are tried.
        starts: Labelled starts, the most trusted first; at least one.
        pinned_gears: Gears that stay. Shape (n,).
        sigma: Whitening of the residuals [m].
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.
        astray: Standard deviation of an inlier coordinate above which a start that leaves more than
            another one is not refined [m].

    Returns:
        The best minimum, and how many starts reached it.
    """
    first_pass = "none" if loss == "none" else "cauchy"
    found: list[tuple[str, LineSolution]] = []
    scores, agree = np.zeros(0), np.zeros(0, dtype=bool)
    least = np.inf
    for tried, (label, start) in enumerate(starts, start=1):
        left = left_by(start, few) if np.isfinite(astray) else 0.0
        if left > max(astray, least):
            continue
        least = min(least, left)
        refined = refine_lines(few, start, pinned_gears, sigma, first_pass, rough=True)
        found.append((label, refined))
        scores = _scores([solution for _, solution in found], loss)
        agree = _agree([solution for _, solution in found], int(np.argmin(scores)))
        best = found[int(np.argmin(scores))][1]
        if _enough(best, int(agree.sum()), tried, found[0][0] != RANDOM, few):
            break
    label, solution = found[int(np.argmax(agree))]
    solution = refine_lines(observations, solution.arm, pinned_gears, sigma, loss)
    labels = tuple(name for name, _ in found)
    return StartSearch(solution, label, labels, scores, int(agree.sum()))


def left_by(start: ArmEstimate, observations: Observations) -> float:
    """Return the standard deviation of an inlier coordinate about a start [m]."""
    predicted = start.predict(observations.angles, observations.marker)
    return robust_scale(np.linalg.norm(predicted - observations.p_WH, axis=1), 3)


def _enough(
    best: LineSolution, agreeing: int, tried: int, trusted: bool, few: Observations
) -> bool:
    """Return whether a search may end: enough agree, and what they leave is explained."""
    noise = _noise(best)
    if agreeing >= _TRIED:
        return True
    if agreeing < ENOUGH_AGREE or noise > _MOST_LEFT * few.size:
        return False
    tracker = _tracker_noise(few)
    if trusted or (tracker is not None and noise < _NOISE * tracker):
        return True
    return tried >= _TRIED and noise < _EXPLAINS * few.size


def _tracker_noise(observations: Observations) -> float | None:
    """Return the standard deviation of a coordinate, from distances of markers of one sample [m].

    The hand is rigid: whatever its joints do, the distance of two markers is always the same, and
    scatters by sqrt(2) of a coordinate's noise, here by its median; None with one marker.
    """
    found = [np.median(np.abs(d - np.median(d))) for d in distances_between(observations).values()]
    return float(1.4826 * np.median(found) / np.sqrt(2.0)) if found else None


def distances_between(observations: Observations) -> dict[tuple[int, int], NDArray]:
    """Return the distances of two markers in all samples that have both, of pairs seen often [m].

    Returns:
        By the markers' indices; each of shape (samples with both,).
    """
    own = [observations.select(observations.marker == k) for k in range(len(observations.markers))]
    found = {}
    for i, a in enumerate(own):
        for j, b in enumerate(own[i + 1 :], start=i + 1):
            _, first, second = np.intersect1d(a.sample, b.sample, return_indices=True)
            if len(first) >= _SEEN_TOGETHER:
                found[i, j] = np.linalg.norm(a.p_WH[first] - b.p_WH[second], axis=1)
    return found


def few_rows(observations: Observations, seed: int, rows: int = SEARCH_ROWS) -> Observations:
    """Return whole poses enough to tell one minimum from another.

    They have three times as many equations as unknowns.

    Args:
        rows: As many at least, if there are.
    """
    unknowns = 5 * len(observations.joints) + 3 * len(observations.markers)
    return observations.thinned(max(rows, unknowns), np.random.default_rng((seed, 2)))


def _scores(solutions: list[LineSolution], loss: str) -> NDArray:
    """Return costs on the scale of the best start, so that they can be compared."""
    norms = [np.linalg.norm(solution.residuals, axis=0) for solution in solutions]
    common = Loss("none")
    if loss != "none":
        common = Loss("cauchy", max(min(robust_scale(n, 3) for n in norms), 1e-12))
    return np.array([common.rho_and_weight(n**2, 3)[0].sum() for n in norms])


def _agree(solutions: list[LineSolution], best: int) -> NDArray:
    """Return which solutions predict what the best does, within a fiftieth of the noise."""
    reference, noise = solutions[best].residuals, _noise(solutions[best])
    difference = [np.sqrt(np.mean((s.residuals - reference) ** 2)) for s in solutions]
    return np.array(difference) <= 0.02 * noise + 1e-9


def _noise(solution: LineSolution) -> float:
    """Return the standard deviation of a coordinate, outliers aside [m]."""
    return robust_scale(np.linalg.norm(solution.residuals, axis=0), 3)
