"""What speaks for and against a learned arm."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm.evaluation import Evaluation
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.estimation.bending.what_bends import (
    bending_faults,
    bending_warnings,
    kept_words,
)
from nico_selfmodel.estimation.diagnosis.gear_check import gear_words
from nico_selfmodel.estimation.diagnosis.misread_joint import (
    misread_joints,
    nearest_turns,
    uneven_place,
)
from nico_selfmodel.estimation.diagnosis.systematic_residuals import FAR, MUCH, tell_sides
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_JOINT_NOISE, LARGEST_NOISE
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.outlier_words import (
    describe_outliers,
    equal_readings,
    exchanged_names,
    foreign_markers,
    held_out_apart,
    more_held_out_outliers,
)
from nico_selfmodel.estimation.results.calibration_result import (
    CAUSE,
    FAILURE,
    LAST,
    MISFIT,
    NOTE,
    WARNING,
    Finding,
    findings,
)
from nico_selfmodel.model.arm.dh_parameters import DhParameters, slopes_by_angle

_PATTERNED_NOISE = 0.02
"""... as do residuals above this smaller share that depend on the pose."""
_LARGEST_RATIO = 10.0
"""Noise of the sensor above this many stated sigmas is something else."""
_NOTABLE_RATIO = 3.0
"""Scatter above this many stated sigmas is more than the sensor's."""
_LONELY_NOISE = 0.005
"""Residuals above this share of the workspace may be those of a wrong minimum."""
_PATTERNS_SHOWN = 3
WHAT_CHANGED = (
    "the training poses do not cover where the arm is used, or something moved between recordings"
)

_ASKED = 500
"""Points that were set aside of which each joint is asked whether it was off there, at most."""


def arm_findings(calibration: KinematicCalibration) -> tuple[Finding, ...]:
    """Return what speaks for and against a learned arm beyond what every calibration is asked."""
    misfit = _misfit_reason(calibration)
    uneven, misread = _misread(calibration)
    explained = misfit is None and not (calibration.causes.words or uneven)
    exchanged = _exchanged_words(calibration)
    foreign = foreign_markers(calibration.train.observations, calibration.outliers)
    if foreign and exchanged:
        foreign, exchanged = exchanged, []
    failures = [
        calibration.size and calibration.size.reason,
        *bending_faults(calibration.ladder),
        *gear_words(calibration.doubtful_gears),
        *_fixed_reasons(calibration),
        *foreign,
        *_faulty_pattern(calibration).values(),
        *(_timing_reasons(calibration) if explained else ()),
    ]
    last = [_starts_reason(calibration), _held_out_outlier_reason(calibration)]
    held_out, ladder = calibration.test, calibration.ladder
    said = [] if held_out is None else [_held_out_words(calibration, held_out)]
    bends = kept_words(ladder, calibration.model.bending, calibration.at)
    bends_badly = bending_warnings(ladder, calibration.at)
    return (
        *findings(CAUSE, calibration.causes.words),
        *findings(MISFIT, [misfit]),
        *findings(FAILURE, [*failures, *uneven]),
        *findings(LAST, last),
        *findings(WARNING, [*bends_badly, *exchanged, *misread, *_warnings(calibration)]),
        *findings(NOTE, [*said, *bends, *_set_aside_words(calibration)]),
    )


def _warnings(calibration: KinematicCalibration) -> list[str]:
    """Say what the model lacks, and what the data cannot support, though nothing fails."""
    words = [str(pattern) for pattern in calibration.patterns[:_PATTERNS_SHOWN]]
    words = [one for one in words if one not in _faulty_pattern(calibration)]
    if words:
        words.append(
            "the model has nothing for it, so that the sigmas of parameters and predictions are "
            "too small; errors on poses like the held-out ones are as stated"
        )
    both = [change for change in (calibration.change, calibration.lag) if change is not None]
    words += [change.warning for change in both if change.warning]
    rows = calibration.train.observations
    words += equal_readings(len(np.unique(rows.sample)), len(rows.poses))
    if calibration.odd_axes and not (calibration.size and calibration.size.reason):
        words.append(calibration.odd_axes)
    words += [calibration.size.warning] if calibration.size and calibration.size.warning else []
    words += _joint_noise_words(calibration)
    if calibration.causes.stopped_after is not None:
        words.append(
            "the search for what would make the data fit stopped after "
            f"{calibration.causes.stopped_after} starts"
        )
    return words


def _faulty_pattern(calibration: KinematicCalibration) -> dict[str, str]:
    """Say that most of what is missed is one joint's backlash that nobody told, or unevenness.

    Returns:
        What to do about it, by the words of the pattern; empty where there is none.
    """
    told = calibration.train.observations.approach.any()
    found = {}
    for pattern in calibration.patterns[:1]:
        words = str(pattern)
        if pattern.score.improvement <= MUCH:
            continue
        if pattern.side_of is not None and not told and abs(pattern.score.values[0]) > FAR:
            found[words] = f"{words}: {tell_sides(pattern.side_of)}"
        if pattern.uneven is not None and pattern.size > FAR:
            found[words] = (
                f"{words}: no gear and no ripple is like that; check {pattern.uneven} there"
            )
    return found


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
    far = f"{wrong.sum()} of {len(wrong)} points up to {worst:.3g} mm off ({which})"
    if wrong.all():
        return f"{_rounded(mean)} mm mean error on {where}; {far}"
    good = 1e3 * test.distances[~wrong].mean()
    if calibration.patterns:
        without = f"{_rounded(good)} mm without them"
        return f"{_rounded(mean)} mm mean error on {where}; {far}, {without}"
    good_words, with_all = f"{_rounded(good)} mm", f"{mean:.2f} mm"
    return held_out_apart(good_words, where, which, wrong, "points", f"{worst:.3g} mm", with_all)


def _rounded(mm: float) -> str:
    """Return a length that a small arm does not round to nothing."""
    return f"{mm:.2f}" if mm >= 0.1 else f"{mm:.3g}"


def _exchanged_words(calibration: KinematicCalibration) -> list[str]:
    """Say which markers' names are exchanged in part of the training poses."""
    rows, wrong = calibration.train.observations, calibration.outliers
    if len(rows.markers) < 2 or not wrong.any() or wrong.all():
        return []
    arm = calibration.model.parameters
    each = (np.full(len(rows), m) for m in range(len(rows.markers)))
    predicted = [arm.predict(rows.angles, one, rows.approach)[0] for one in each]
    told_as = np.linalg.norm(rows.p_WH - np.stack(predicted), axis=2).T
    # Points that are met exactly leave nothing, and nothing is divided by.
    most = max(told_as[np.arange(len(rows)), rows.marker][~wrong].max(), np.finfo(float).tiny)
    return exchanged_names(rows.markers, rows.marker, rows.sample, wrong, told_as / most)


def _set_aside_words(calibration: KinematicCalibration) -> list[str]:
    """Say which training points were outliers, if any."""
    wrong, rows = calibration.outliers, calibration.train.observations
    if not wrong.any():
        return []
    which = describe_outliers(rows, wrong)
    return [f"{wrong.sum()} of {len(rows)} training points set aside: {which}"]


def _turned(
    arm: DhParameters, rows: Observations, wrong: NDArray
) -> tuple[NDArray, tuple[NDArray, NDArray]]:
    """Turn each joint alone to where some points come nearest to where they were measured.

    Returns:
        Derivatives by the joints there, shape (N, 3, n), the angles, shape (N, n), and the
        residuals, shape (N, 3, n).
    """

    def seen_from(which: NDArray, turns: NDArray) -> tuple[NDArray, NDArray, NDArray | None]:
        own = wrong[which]
        approach = None if rows.approach is None else rows.approach[own]
        return rows.angles[own] + arm.servos.gear * turns, rows.marker[own], approach

    n, p = len(rows.joints), rows.p_WH[wrong]
    turns = nearest_turns(lambda which, by: arm.points(*seen_from(which, by)), p, n)
    by_angle, left = np.empty((2, len(wrong), 3, n))
    for j in range(n):
        alone = turns * (np.arange(n) == j)
        there, jacobian = arm.predict(*seen_from(np.arange(len(wrong)), alone))
        by_angle[:, :, j] = slopes_by_angle(arm, jacobian)[:, :, j]
        left[:, :, j] = p - there
    return by_angle, (turns, left)


def _misread(calibration: KinematicCalibration) -> tuple[list[str], list[str]]:
    """Name the joint that was read wrongly where points were set aside, if they tell one.

    Returns:
        Where on its turn it is uneven, which is a fault; and else how often it was off.
    """
    train, rows = calibration.train, calibration.train.observations
    # A joint takes all points of a pose along.
    sound = np.isin(rows.sample, rows.sample[~calibration.outliers])
    wrong = np.flatnonzero(calibration.outliers & ~sound)
    if train.covariance is None or not len(wrong):
        return [], []
    step = -(-len(wrong) // _ASKED)
    wrong = wrong[::step]
    by_angle, turned = _turned(calibration.model.parameters, rows, wrong)
    known = train.residuals[wrong], by_angle, train.covariance[wrong]
    joints, off = misread_joints(*known, turned)
    if not joints:
        return [], []
    told = np.isfinite(off)
    names = " or ".join(f"{rows.joints[j]!r}" for j in joints)
    asked = np.append(np.flatnonzero(sound), wrong)
    uneven = _uneven_words(rows, joints[0], names, asked, wrong[told], off[told])
    if uneven:
        return uneven, []
    poses, of = len(np.unique(rows.sample[wrong][told])), len(np.unique(rows.sample[wrong]))
    size = float(np.degrees(np.median(np.abs(off[told]))))
    asked_words = "" if step == 1 else " and that were asked"
    which = (
        "" if len(joints) == 1 else ", and the points do not tell which: track more markers there"
    )
    return [], [
        f"in {poses} of {of} poses whose points were set aside{asked_words} the encoder of "
        f"{names} was off, by {size:.2g} deg in the median: look for play, a loose "
        f"coupling or missed counts there{which}"
    ]


def _uneven_words(
    rows: Observations, joint: int, names: str, asked: NDArray, wrong: NDArray, off: NDArray
) -> list[str]:
    """Say where on a joint's turn it is read wrongly, by how much; nothing where it is anywhere.

    Args:
        asked: Rows of which it is known whether it was. Shape (A,).
        wrong: Those where it was, shape (K,), by how much [rad], shape (K,).
    """
    size = float(np.median(np.abs(off)))
    sample, first = np.unique(rows.sample[asked], return_index=True)
    read = np.degrees(rows.units.sign[joint] * rows.angles[asked[first], joint])
    was = np.isin(sample, rows.sample[wrong])
    place = uneven_place(read, was)
    if place is None or size <= FAR:
        return []
    there = (read >= place[0]) & (read <= place[1])
    span, cause = (
        f"read {place[0]:.0f} to {place[1]:.0f} deg",
        "check the encoder and the gear there",
    )
    if place[0] == place[1]:
        span, cause = f"stands at {place[0]:.6g} deg", "its encoder was frozen, or not read"
    return [
        f"in {(was & there).sum()} of {there.sum()} poses in which {names} {span} that was off, by "
        f"{np.degrees(size):.2g} deg in the median, and in {(was & ~there).sum()} of "
        f"{(~there).sum()} others: {cause}; what was held out there was set aside, too"
    ]


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


def _fixed_reasons(calibration: KinematicCalibration) -> list[str]:
    return [
        f"`{pin.name}` is fixed at {pin.value:.6g}, which contradicts the data: without it they "
        f"ask for {pin.wanted:.6g} and the rms residual falls to 1 / {pin.rise:.3g}; correct the "
        "value, or leave the --fix out"
        for pin in calibration.contradicted_parameters
    ]


def _misfit_reason(calibration: KinematicCalibration) -> str | None:
    noise, size = calibration.model.noise_sigma, calibration.train.observations.size
    advice = (
        "the model does not explain the data; check units and gears (--free), the pairing of "
        "readings and points, marker labels, and whether something moved during the recording"
    )
    if noise is None or len(calibration.train.distances) < 10:
        return None
    in_size = f"{1e3 * noise:.1f} mm a coordinate in a workspace of {1e3 * size:.0f} mm: {advice}"
    if noise > LARGEST_NOISE * size:
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
    if noise.joint_sigma[worst] > LARGEST_JOINT_NOISE:
        return (
            f"the angle of {calibration.model.joints[worst]} would have to be off by "
            f"{np.degrees(noise.joint_sigma[worst]):.1f} deg at random to explain the points: "
            f"{advice}"
        )
    return None


def _timing_reasons(calibration: KinematicCalibration) -> list[str]:
    """Say what changed during the recording, or that readings and points are not of one moment."""
    reasons = []
    if calibration.change is not None and calibration.change.reason:
        reasons.append(calibration.change.reason)
    if calibration.lag is not None and calibration.lag.notable:
        reasons.append(calibration.lag.what)
    return reasons


def _held_out_outlier_reason(calibration: KinematicCalibration) -> str | None:
    """Say when held-out points contradict the model far more often than training points do."""
    test = calibration.test
    if test is None or not test.outliers.any():
        return None
    return more_held_out_outliers(
        test.outliers,
        "points",
        describe_outliers(test.observations, test.outliers),
        _count_poses(test.observations, test.outliers),
        _count_poses(calibration.train.observations, calibration.outliers),
        WHAT_CHANGED,
    )


def _count_poses(observations: Observations, outliers: NDArray) -> tuple[int, int]:
    """Return how many poses have an outlier, and how many there are."""
    return len(np.unique(observations.pose[outliers])), len(observations.poses)
