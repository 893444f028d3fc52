"""PASS, FAIL or NOT_EVALUATED, with reasons: whether a calibration may be trusted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.blind_words import describe_blind
from nico_selfmodel.estimation.error_statistics import Evaluation
from nico_selfmodel.estimation.kinematics import KinematicCalibration
from nico_selfmodel.model import SelfModel

_MOST_OUTLIERS = 0.25
"""A larger share of points that are not believed is no accident."""
_LARGEST_NOISE = 0.05
"""Residuals above this share of the workspace's size explain nothing."""
_LARGEST_RATIO = 10.0
"""Residuals above this many stated sigmas are not joint play."""
_SIGNIFICANT = 3.3
"""Standard scores of a rank test beyond which held-out errors count as larger: one in 2000."""
_BLIND_SHOWN = 3
"""Blind directions among the reasons; the result lists them all."""
_NOTABLE = 1.3
"""And the ratio of the medians that makes it worth a failure."""
_WHAT_CHANGED = (
    "the training poses do not cover where the arm is used, or something moved between recordings"
)


@dataclass(frozen=True)
class Verdict:
    """Status of a calibration and why."""

    status: str
    """`PASS`, `FAIL` or `NOT_EVALUATED`."""
    reasons: tuple[str, ...]
    """Failed checks, or what was checked."""


def judge(calibration: KinematicCalibration, require_test_mm: float | None = None) -> Verdict:
    """Judge a calibration.

    Args:
        calibration: What was learned.
        require_test_mm: Largest mean held-out error allowed [mm].

    Returns:
        FAIL where a check fails; PASS where held-out data were evaluated and nothing failed;
        NOT_EVALUATED where nothing was held out.
    """
    checks = [
        *_gear_reasons(calibration),
        *_pin_reasons(calibration),
        _misfit_reason(calibration),
        _outlier_reason(calibration),
        _solver_reason(calibration),
        _starts_reason(calibration),
        *_blind_reasons(calibration),
        _held_out_reason(calibration),
        _bound_reason(calibration, require_test_mm),
    ]
    failed = tuple(reason for reason in checks if reason)
    if failed:
        return Verdict("FAIL", failed)
    if calibration.test is None:
        return Verdict("NOT_EVALUATED", ("nothing was held out: give --test or --test-fraction",))
    mean = 1e3 * calibration.test.statistics.mean
    n = calibration.test.statistics.n
    return Verdict("PASS", (f"{mean:.2f} mm mean error on {n} points that were held out",))


def _solver_reason(calibration: KinematicCalibration) -> str | None:
    if calibration.converged:
        return None
    return f"the solver stopped after {calibration.iterations} steps without reaching a minimum"


def _starts_reason(calibration: KinematicCalibration) -> str | None:
    search = calibration.search
    if search is None or len(search.labels) < 3 or search.agreeing >= 2:
        return None
    return (
        f"only one of {len(search.labels)} starts ({search.best_label}) reached the best minimum: "
        "it may not be the global one; allow more with --starts, or record more poses"
    )


def _blind_reasons(calibration: KinematicCalibration) -> list[str]:
    if calibration.uncertainty is None:
        return []
    words = [describe_blind(direction) for direction in calibration.uncertainty.blind]
    more = len(words) - _BLIND_SHOWN
    return words if more <= 0 else [*words[:_BLIND_SHOWN], f"and {more} more blind directions"]


def _gear_reasons(calibration: KinematicCalibration) -> list[str]:
    return [
        f"`{gear.name}` is held at 1 because the encoder is said to read joint angles, but the "
        f"data ask for about {gear.value:.3g} (+- {gear.sigma:.2g}): correct the unit, or add "
        f"--free {gear.name}"
        for gear in calibration.doubtful_gears
    ]


def _pin_reasons(calibration: KinematicCalibration) -> list[str]:
    return [
        f"`{pin.name}` is pinned at {pin.value:.6g}, which contradicts the data: without pins they "
        f"ask for {pin.wanted:.6g} and the rms residual falls to 1 / {pin.rise:.3g}; correct the "
        "value, or leave the pin out"
        for pin in calibration.contradicted_pins
    ]


def _misfit_reason(calibration: KinematicCalibration) -> str | None:
    """Say when the model leaves so much unexplained that nothing else about it counts."""
    noise, size = calibration.model.noise_sigma, calibration.train.observations.size
    stated = calibration.point_sigma
    advice = (
        "the model does not explain the data; check units and gears (--free), the pairing of "
        "readings and points, marker labels, and whether something moved during the recording"
    )
    if noise is None or len(calibration.train.distances) < 10:
        return None
    if noise > _LARGEST_NOISE * size:
        return f"the residuals are {1e3 * noise:.1f} mm a coordinate in a workspace of " + (
            f"{1e3 * size:.0f} mm: {advice}"
        )
    if stated is not None and noise > _LARGEST_RATIO * stated:
        return (
            f"the residuals are {1e3 * noise:.2f} mm a coordinate, {noise / stated:.0f} times the "
            f"stated point_sigma_m ({1e3 * stated:.2g} mm): {advice}"
        )
    return None


def _outlier_reason(calibration: KinematicCalibration) -> str | None:
    share = float(np.mean(calibration.outliers))
    if share <= _MOST_OUTLIERS:
        return None
    return (
        f"{100 * share:.0f} % of the training points contradict the rest: the arm, or what was "
        "recorded, is not what the data set says"
    )


def _held_out_reason(calibration: KinematicCalibration) -> str | None:
    expected = calibration.cross_validation
    if calibration.test is None or len(expected) < 5 or len(calibration.test.distances) < 5:
        return None
    found = calibration.test.distances
    ratio = float(np.median(found) / max(np.median(expected), 1e-12))
    if rank_score(expected, found) < _SIGNIFICANT or ratio < _NOTABLE:
        return None
    return (
        f"the held-out error (median {1e3 * np.median(found):.2f} mm) is significantly above that "
        f"of the training poses in cross-validation ({1e3 * np.median(expected):.2f} mm): "
        f"{_WHAT_CHANGED}"
    )


def _bound_reason(calibration: KinematicCalibration, require_test_mm: float | None) -> str | None:
    if require_test_mm is None:
        return None
    if calibration.test is None:
        return "--require-test-mm was given but nothing was held out"
    mean = 1e3 * calibration.test.statistics.mean
    if mean <= require_test_mm:
        return None
    return f"mean held-out error {mean:.3f} mm, required at most {require_test_mm:g} mm"


def judge_evaluation(model: SelfModel, evaluation: Evaluation) -> Verdict:
    """Judge a self-model by new data, against the error that its training lets expect.

    Args:
        model: The self-model.
        evaluation: It, held against the data.

    Returns:
        FAIL where the error is significantly above what was expected; NOT_EVALUATED where the
        model does not say what to expect, or the points are too few.
    """
    expected = model.fit.get("expected_error")
    found = evaluation.distances
    if not expected or min(expected["n"], len(found)) < 5:
        return Verdict("NOT_EVALUATED", ("there is too little to compare the error with",))
    n, median = len(found), float(expected["median_m"])
    # A sign test: half of the points should lie above the median, itself known from a sample.
    score = (np.sum(found > median) - 0.5 * n) / np.sqrt(0.25 * n * (1.0 + n / expected["n"]))
    medians = f"median {1e3 * np.median(found):.2f} mm, expected {1e3 * median:.2f} mm"
    if score >= _SIGNIFICANT and np.median(found) >= _NOTABLE * median:
        above = f"the error ({medians}) is significantly above that of the training poses"
        return Verdict("FAIL", (f"{above}: {_WHAT_CHANGED}",))
    return Verdict("PASS", (f"the error ({medians}) is that of the training poses",))


def rank_score(a: NDArray, b: NDArray) -> float:
    """Return the standard score of b's ranks over a's (Mann and Whitney 1947).

    Args:
        a: First sample. Shape (n,).
        b: Second sample. Shape (m,).

    Returns:
        About standard normal where both come from one distribution; positive where b is larger.
    """
    _, which, counts = np.unique(np.concatenate([a, b]), return_inverse=True, return_counts=True)
    # Equal values share the mean of their ranks.
    ranks = (np.cumsum(counts) - 0.5 * (counts - 1))[which]
    n, m = len(a), len(b)
    u = ranks[n:].sum() - 0.5 * m * (m + 1)
    return float((u - 0.5 * n * m) / np.sqrt(n * m * (n + m + 1) / 12.0))
