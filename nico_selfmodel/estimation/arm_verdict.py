"""The verdict on an arm, and on a self-model held against new data."""

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
from nico_selfmodel.estimation.verdict import (
    FEWEST_COMPARED,
    MOST_OUTLIERS,
    Verdict,
    bound_reason,
    conclude,
    held_out_is_worse,
    outliers_are_many,
    shortened,
    significantly_above,
)
from nico_selfmodel.model import SelfModel

_LARGEST_NOISE = 0.05
"""Residuals above this share of the workspace's size explain nothing."""
_PATTERNED_NOISE = 0.02
"""... as do residuals above this smaller share that depend on the pose."""
_LARGEST_RATIO = 10.0
"""Noise of the sensor above this many stated sigmas is something else."""
_NOTABLE_RATIO = 3.0
"""Scatter above this many stated sigmas is more than the sensor's."""
_LARGEST_JOINT_NOISE = np.radians(5.0)
"""A joint that is this uncertain about its encoder is not noisy but wrong."""
_LONELY_NOISE = 0.005
"""Residuals above this share of the workspace may be those of a wrong minimum."""
_RARE = 1.0 / 2000.0
"""Chance of a held-out share of outliers beyond which it is no accident ..."""
_RARE_OF_MANY = 0.01
"""... and of one that is large: the training may have as many, and be told so itself."""
_PATTERNS_SHOWN = 3
_WHAT_CHANGED = (
    "the training poses do not cover where the arm is used, or something moved between recordings"
)


def judge(calibration: KinematicCalibration, require_test_mm: float | None = None) -> Verdict:
    """Judge a calibration.

    Args:
        calibration: What was learned.
        require_test_mm: Largest mean held-out error allowed [mm].

    Returns:
        FAIL where a check fails; PASS where enough held-out poses were evaluated and nothing
        failed; else NOT_EVALUATED.
    """
    misfit = _misfit_reasons(calibration)
    if calibration.causes.words:
        # All else that is wrong follows from it.
        return Verdict("FAIL", tuple(misfit))
    test = calibration.test
    checks = [
        calibration.contradicted_robot,
        *_gear_reasons(calibration),
        *_pin_reasons(calibration),
        *misfit,
        _outlier_reason(calibration),
        *foreign_markers(calibration.train.observations, calibration.outliers),
        *(_timing_reasons(calibration) if not misfit else ()),
        _solver_reason(calibration),
        _starts_reason(calibration),
        # What a model that explains nothing can tell says nothing of the arm.
        *(_blind_reasons(calibration) if not misfit else ()),
        _held_out_reason(calibration),
        _held_out_outlier_reason(calibration),
        bound_reason(None if test is None else 1e3 * test.statistics.mean, require_test_mm, "mm"),
    ]
    poses = 0 if test is None else len(test.observations.poses)
    said = [] if test is None else [_held_out_words(calibration, test)]
    passed = [*said, *_set_aside_words(calibration)]
    return conclude(checks, poses, "poses", passed, _warnings(calibration))


def _warnings(calibration: KinematicCalibration) -> list[str]:
    """Say what the model lacks, and what the data cannot support, though nothing fails."""
    words = [str(pattern) for pattern in calibration.patterns[:_PATTERNS_SHOWN]]
    if words:
        words.append(
            "the model has nothing for it, so that the sigmas of parameters and predictions are "
            "too small; errors on poses like the held-out ones are as stated"
        )
    for change in (calibration.change, calibration.lag):
        if change is not None and not change.told_from_place:
            words.append(f"{change.what}, or the arm bends there: the poses do not tell which")
        elif change is not None and not change.notable:
            words.append(f"{change.what}; too little to matter beside the noise")
    rows = calibration.train.observations
    visits = len(np.unique(rows.sample))
    if len(rows.poses) < visits:
        words.append(
            f"{visits} samples are of {len(rows.poses)} poses: samples with equal readings count "
            "as one pose, in splits as in sigmas"
        )
    words += _joint_noise_words(calibration)
    if calibration.causes.stopped_after is not None:
        words.append(
            "the search for what would make the data fit stopped after "
            f"{calibration.causes.stopped_after} starts"
        )
    return words


def _joint_noise_words(calibration: KinematicCalibration) -> list[str]:
    """Say when points scatter by more than their stated sigma, or by much less."""
    noise, stated, total = calibration.noise, calibration.point_sigma, calibration.model.noise_sigma
    if noise is None or stated is None or total is None:
        return []
    if total < stated / _LARGEST_RATIO:
        return [
            f"the points scatter by {1e3 * total:.2g} mm a coordinate, the stated point_sigma_m is "
            f"{stated / total:.0f} times that: is its unit metres?"
        ]
    if total < _NOTABLE_RATIO * stated:
        return []
    if noise.sensor_sigma > _LARGEST_RATIO * stated:
        return []
    degrees = np.degrees(noise.joint_sigma)
    spread = f"{degrees.min():.2g}"
    if degrees.max() > 1.01 * degrees.min():
        spread += f" to {degrees.max():.2g}"
    return [
        f"the points scatter by {1e3 * total:.2g} mm a coordinate, {total / stated:.0f} times the "
        f"stated point_sigma_m: joint noise of {spread} deg explains it"
    ]


def _held_out_words(calibration: KinematicCalibration, test: Evaluation) -> str:
    """State the held-out error; where no noise explains some of it, without that and with it.

    Where residuals depend on the pose, what lies far off is the arm's own, and counts first.
    """
    wrong, poses = test.outliers, len(test.observations.poses)
    mean = 1e3 * test.statistics.mean
    where = f"{poses} poses that were held out"
    if not wrong.any():
        return f"{_rounded(mean)} mm mean error on {where}"
    worst, which = 1e3 * test.distances[wrong].max(), describe_outliers(test.observations, wrong)
    far = f"{wrong.sum()} of {len(wrong)} points are up to {worst:.3g} mm off ({which})"
    if wrong.all():
        return f"{_rounded(mean)} mm mean error on {where}; {far}"
    good = 1e3 * test.distances[~wrong].mean()
    if calibration.patterns:
        without = f"{_rounded(good)} mm without them"
        return f"{_rounded(mean)} mm mean error on {where}; {far}, {without}"
    return (
        f"{_rounded(good)} mm mean error on {where}, {len(wrong) - wrong.sum()} of {len(wrong)} "
        f"points; the other {wrong.sum()} are up to {worst:.3g} mm off, which no noise explains "
        f"({which}): {mean:.2f} mm with them"
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
    """Say when the minimum may be a wrong one: reached once, and something is left unexplained."""
    search, noise = calibration.search, calibration.model.noise_sigma
    if search is None or len(search.labels) < 3 or search.agreeing >= 2 or noise is None:
        return None
    if noise < _LONELY_NOISE * calibration.train.observations.size and not calibration.patterns:
        return None
    return (
        f"only one of {len(search.labels)} starts ({search.best_label}) reached the best minimum: "
        "it may not be the global one; allow more with --starts, or record more poses"
    )


def _blind_reasons(calibration: KinematicCalibration) -> list[str]:
    if calibration.uncertainty is None:
        return []
    return shortened([describe_blind(direction) for direction in calibration.uncertainty.blind])


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
    return [*calibration.causes.words, *([misfit] if misfit else [])]


def _misfit_reason(calibration: KinematicCalibration) -> str | None:
    noise, size = calibration.model.noise_sigma, calibration.train.observations.size
    advice = (
        "the model does not explain the data; check units and gears (--free), the pairing of "
        "readings and points, marker labels, and whether something moved during the recording"
    )
    if noise is None or len(calibration.train.distances) < 10:
        return None
    in_size = f"{1e3 * noise:.1f} mm a coordinate in a workspace of {1e3 * size:.0f} mm: {advice}"
    if noise > _LARGEST_NOISE * size:
        return f"the residuals are {in_size}"
    if noise > _PATTERNED_NOISE * size and calibration.patterns:
        return f"the residuals depend on the pose and are {in_size}"
    return _noise_reason(calibration, advice)


def _noise_reason(calibration: KinematicCalibration, advice: str) -> str | None:
    """Say when sensor or joints would have to be noisier than they can be."""
    noise, stated = calibration.noise, calibration.point_sigma
    if noise is None:
        return None
    if stated is not None and noise.sensor_sigma > _LARGEST_RATIO * stated:
        return (
            f"the residuals are {1e3 * noise.sensor_sigma:.2f} mm a coordinate beside what joint "
            f"noise explains, {noise.sensor_sigma / stated:.0f} times the stated point_sigma_m "
            f"({1e3 * stated:.2g} mm): {advice}"
        )
    worst = int(np.argmax(noise.joint_sigma))
    if noise.joint_sigma[worst] > _LARGEST_JOINT_NOISE:
        return (
            f"the angle of {calibration.model.joints[worst]} would have to be off by "
            f"{np.degrees(noise.joint_sigma[worst]):.1f} deg at random to explain the points: "
            f"{advice}"
        )
    return None


def _timing_reasons(calibration: KinematicCalibration) -> list[str]:
    """Say what changed during the recording, or that readings and points are not of one moment."""
    reasons = []
    if calibration.change is not None and calibration.change.notable:
        reasons.append(f"{calibration.change.what}: learn from one part alone, or record again")
    if calibration.lag is not None and calibration.lag.notable:
        reasons.append(calibration.lag.what)
    return reasons


def _outlier_reason(calibration: KinematicCalibration) -> str | None:
    share = outliers_are_many(calibration.outliers)
    if share is None:
        return None
    return (
        f"{100 * share:.0f} % of the training points contradict the rest "
        f"({describe_outliers(calibration.train.observations, calibration.outliers)}): the arm, or "
        "what was recorded, is not what the data set says"
    )


def _held_out_reason(calibration: KinematicCalibration) -> str | None:
    """Compare poses with poses, and free ones with free ones: sweeps say less of other poses."""
    test, rows = calibration.test, calibration.train.observations
    if test is None or not len(calibration.cross_validation):
        return None
    believed = ~calibration.outliers
    free = calibration.free_poses[believed]
    alike = free if free.any() else ~free
    expected = rows.select(believed).by_pose(calibration.cross_validation, alike)
    found = test.observations.by_pose(test.distances, ~test.outliers)
    worse = held_out_is_worse(expected, found)
    if worse is None:
        return None
    return (
        f"the held-out error (median {1e3 * worse[0]:.2f} mm) is significantly above that of the "
        f"training poses in cross-validation ({1e3 * worse[1]:.2f} mm): {_WHAT_CHANGED}"
    )


def _held_out_outlier_reason(calibration: KinematicCalibration) -> str | None:
    """Say when held-out points contradict the model far more often than training points do."""
    test = calibration.test
    if test is None or not test.outliers.any():
        return None
    found, n = _count_poses(test.observations, test.outliers)
    before, m = _count_poses(calibration.train.observations, calibration.outliers)
    rare = _RARE if outliers_are_many(test.outliers) is None else _RARE_OF_MANY
    if chance_of_more(found, n, before, m) > rare:
        return None
    return (
        f"{test.outliers.sum()} of {len(test.outliers)} held-out points are further off than model "
        f"and noise explain ({describe_outliers(test.observations, test.outliers)}), in {found} of "
        f"{n} poses, against {before} of {m} training poses: {_WHAT_CHANGED}"
    )


def _count_poses(observations: Observations, outliers: NDArray) -> tuple[int, int]:
    """Return how many poses have an outlier, and how many there are."""
    return len(np.unique(observations.pose[outliers])), len(observations.poses)


def judge_evaluation(model: SelfModel, evaluation: Evaluation) -> Verdict:
    """Judge a self-model by new data, against the error that its training lets expect.

    Args:
        model: The self-model.
        evaluation: It, held against the data.

    Returns:
        FAIL where the error is significantly above what was expected; NOT_EVALUATED where the
        model does not say what to expect, or the poses are too few.
    """
    expected = model.fit.get("expected_error")
    found = evaluation.observations.by_pose(evaluation.distances)
    if not expected or min(expected["n"], len(found)) < FEWEST_COMPARED:
        return Verdict("NOT_EVALUATED", ("there is too little to compare the error with",))
    n, median = len(found), float(expected["median_m"])
    medians = f"median {1e3 * np.median(found):.2f} mm, expected {1e3 * median:.2f} mm"
    above = significantly_above(found, median, n, expected["n"])
    rows, wrong = evaluation.observations, evaluation.outliers
    return beside_training(medians, rows, wrong, "points", above=above)


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
    if wrong.mean() > MOST_OUTLIERS:
        return Verdict("FAIL", (f"{off}: {_WHAT_CHANGED}",))
    return Verdict("PASS", (f"{within}; {off}",))
