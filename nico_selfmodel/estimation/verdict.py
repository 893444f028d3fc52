"""PASS, FAIL or NOT_EVALUATED, with reasons: whether a calibration may be trusted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.blind_words import describe_blind
from nico_selfmodel.estimation.error_statistics import Evaluation
from nico_selfmodel.estimation.kinematics import KinematicCalibration
from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.outlier_words import (
    chance_of_more,
    describe_outliers,
    foreign_markers,
)
from nico_selfmodel.estimation.residual_patterns import pose_dependence, step_in_time
from nico_selfmodel.model import SelfModel

_MOST_OUTLIERS = 0.25
"""A larger share of points that are not believed is no accident."""
_LARGEST_NOISE = 0.05
"""Residuals above this share of the workspace's size explain nothing."""
_PATTERNED_NOISE, _PATTERN = 0.02, 5.0
"""... as do residuals above this smaller share that depend on the pose with this standard score."""
_LARGEST_RATIO = 10.0
"""Residuals above this many stated sigmas are not joint play."""
_SIGNIFICANT = 3.3
"""Standard scores of a rank test beyond which held-out errors count as larger: one in 2000."""
_BLIND_SHOWN = 3
"""Blind directions among the reasons; the result lists them all."""
_RARE = 1.0 / 2000.0
"""The same as a chance."""
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
    misfit = _misfit_reasons(calibration)
    if calibration.causes:
        # All else that is wrong follows from it.
        return Verdict("FAIL", tuple(misfit))
    checks = [
        calibration.contradicted_robot,
        *_gear_reasons(calibration),
        *_pin_reasons(calibration),
        *misfit,
        _outlier_reason(calibration),
        *foreign_markers(calibration.train.observations, calibration.outliers),
        _step_reason(calibration) if not misfit else None,
        _solver_reason(calibration),
        _starts_reason(calibration),
        # What a model that explains nothing can tell says nothing of the arm.
        *(_blind_reasons(calibration) if not misfit else ()),
        _held_out_reason(calibration),
        _held_out_outlier_reason(calibration),
        _bound_reason(calibration, require_test_mm),
    ]
    failed = tuple(reason for reason in checks if reason)
    if failed:
        return Verdict("FAIL", failed)
    if calibration.test is None:
        return Verdict("NOT_EVALUATED", ("nothing was held out: give --test or --test-fraction",))
    return Verdict("PASS", (_held_out_words(calibration.test), *_set_aside_words(calibration)))


def _held_out_words(test: Evaluation) -> str:
    """State the held-out error; where no noise explains some of it, without that and with it."""
    wrong = test.outliers
    n, mean = len(wrong), 1e3 * test.statistics.mean
    if not wrong.any():
        return f"{_rounded(mean)} mm mean error on {n} points that were held out"
    good, worst = 1e3 * test.distances[~wrong].mean(), 1e3 * test.distances[wrong].max()
    return (
        f"{_rounded(good)} mm mean error on {n - wrong.sum()} of {n} points that were held out; the"
        f" other {wrong.sum()} are up to {worst:.3g} mm off, which no noise explains"
        f" ({describe_outliers(test.observations, wrong)}): {mean:.2f} mm with them"
    )


def _rounded(mm: float) -> str:
    """Return a length that a small arm does not round to nothing."""
    return f"{mm:.2f}" if mm >= 0.1 else f"{mm:.3g}"


def _set_aside_words(calibration: KinematicCalibration) -> list[str]:
    """Say which training points were not believed, if any."""
    wrong, rows = calibration.outliers, calibration.train.observations
    if not wrong.any():
        return []
    which = describe_outliers(rows, wrong)
    return [f"{wrong.sum()} of {len(rows)} training points were set aside: {which}"]


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


def _misfit_reasons(calibration: KinematicCalibration) -> list[str]:
    """Say when the model leaves so much unexplained that nothing else about it counts, and why."""
    misfit = _misfit_reason(calibration)
    return [*calibration.causes, *([misfit] if misfit else [])]


def _misfit_reason(calibration: KinematicCalibration) -> str | None:
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
    if noise > _PATTERNED_NOISE * size and _pattern(calibration) > _PATTERN:
        return (
            f"the residuals depend on the pose and are {1e3 * noise:.1f} mm a coordinate in a "
            f"workspace of {1e3 * size:.0f} mm: {advice}"
        )
    if stated is not None and noise > _LARGEST_RATIO * stated:
        return (
            f"the residuals are {1e3 * noise:.2f} mm a coordinate, {noise / stated:.0f} times the "
            f"stated point_sigma_m ({1e3 * stated:.2g} mm): {advice}"
        )
    return None


def _pattern(calibration: KinematicCalibration) -> float:
    """Return how surely the residuals of believed points depend on the pose."""
    believed, train = ~calibration.outliers, calibration.train
    rows = train.observations.select(believed)
    return pose_dependence(rows, train.residuals[believed], calibration.model.parameters)


def _step_reason(calibration: KinematicCalibration) -> str | None:
    """Say when all points shifted in the middle of the recording."""
    believed, train = ~calibration.outliers, calibration.train
    free = calibration.free_poses[believed]
    step = step_in_time(train.observations.select(believed), train.residuals[believed], free)
    if step is None:
        return None
    mm = ", ".join(f"{value:.2f}" for value in 1e3 * step.shift)
    return (
        f"after sample {step.after} the points are shifted by about ({mm}) mm: tracker or base "
        "moved, or drifted, during the recording; learn from one part alone, or record again"
    )


def _outlier_reason(calibration: KinematicCalibration) -> str | None:
    share = float(np.mean(calibration.outliers))
    if share <= _MOST_OUTLIERS:
        return None
    return (
        f"{100 * share:.0f} % of the training points contradict the rest "
        f"({describe_outliers(calibration.train.observations, calibration.outliers)}): the arm, or "
        "what was recorded, is not what the data set says"
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


def _held_out_outlier_reason(calibration: KinematicCalibration) -> str | None:
    """Say when held-out points contradict the model far more often than training points do."""
    test = calibration.test
    if test is None or not test.outliers.any():
        return None
    found, n = int(test.outliers.sum()), len(test.outliers)
    before, m = int(calibration.outliers.sum()), len(calibration.outliers)
    if found <= _MOST_OUTLIERS * n and chance_of_more(found, n, before, m) > _RARE:
        return None
    return (
        f"{found} of {n} held-out points are further off than model and noise explain "
        f"({describe_outliers(test.observations, test.outliers)}), against {before} of {m} training"
        f" points: {_WHAT_CHANGED}"
    )


def _bound_reason(calibration: KinematicCalibration, require_test_mm: float | None) -> str | None:
    if require_test_mm is None:
        return None
    if calibration.test is None:
        return "--require-test-mm was given but nothing was held out"
    mean = 1e3 * calibration.test.statistics.mean
    if mean <= require_test_mm:
        return None
    words = f"mean held-out error {mean:.3f} mm, required at most {require_test_mm:g} mm"
    return (
        f"{words}: {_held_out_words(calibration.test)}"
        if calibration.test.outliers.any()
        else words
    )


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
    medians = f"median {1e3 * np.median(found):.2f} mm, expected {1e3 * median:.2f} mm"
    above = significantly_above(found, median, n, expected["n"])
    return beside_training(
        medians, evaluation.observations, evaluation.outliers, "points", above=above
    )


def beside_training(
    medians: str, observations: Observations, wrong: NDArray, things: str, *, above: bool
) -> Verdict:
    """Return the verdict on new errors beside those of the training.

    Args:
        medians: Found and expected ones in words.
        observations: What was held against the model.
        wrong: Rows of it that neither model nor noise explains. Boolean, shape (N,).
        things: What a row is.
        above: Whether the errors are significantly above those of the training.
    """
    if above:
        words = f"the error ({medians}) is significantly above that of the training poses"
        return Verdict("FAIL", (f"{words}: {_WHAT_CHANGED}",))
    within = f"the error ({medians}) is that of the training poses"
    if not wrong.any():
        return Verdict("PASS", (within,))
    off = (
        f"{wrong.sum()} of {len(wrong)} {things} are further off than model and noise explain "
        f"({describe_outliers(observations, wrong)})"
    )
    if wrong.mean() > _MOST_OUTLIERS:
        return Verdict("FAIL", (f"{off}: {_WHAT_CHANGED}",))
    return Verdict("PASS", (f"{within}; {off}",))


def significantly_above(errors: NDArray, median: float, n: float, known_from: float) -> bool:
    """Return whether errors are significantly, and notably, above an expected median.

    A sign test: half of them should lie above the median, which is itself known from a sample.

    Args:
        errors: What was found. Shape (k,).
        median: What was expected, in the same unit.
        n: How many independent ones there are among them.
        known_from: How many there were in the sample.
    """
    share = float(np.mean(errors > median))
    score = (share - 0.5) / np.sqrt(0.25 * (1.0 / n + 1.0 / known_from))
    return bool(score >= _SIGNIFICANT and np.median(errors) >= _NOTABLE * median)


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
