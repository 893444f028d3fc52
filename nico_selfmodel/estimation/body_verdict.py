"""PASS, FAIL or NOT_EVALUATED for arm and eyes that refined each other."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.blind_words import describe_blind
from nico_selfmodel.estimation.body import BodyCalibration
from nico_selfmodel.estimation.lens_folds import folds_of
from nico_selfmodel.estimation.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.verdict import Verdict, rank_score
from nico_selfmodel.model.camera import DISTORTION, INTRINSICS
from nico_selfmodel.model.stereo_rig import EYES

_MOST_OUTLIERS = 0.25
_LARGEST_PLAY = np.radians(5.0)
"""A joint that is this uncertain about its encoder is not play."""
_BLIND_SHOWN = 3
_SIGNIFICANT, _NOTABLE, _FEWEST = 3.3, 1.3, 10
"""As in the verdict on an arm: standard score and ratio of medians of a larger held-out error."""
_MOST_LOST = 0.02
"""Share of believed poses that may lack a point in front of both eyes."""


def judge_body(
    calibration: BodyCalibration,
    require_test_mm: float | None = None,
    require_test_px: float | None = None,
) -> Verdict:
    """Judge a calibration.

    Args:
        calibration: What was learned.
        require_test_mm: Largest mean 3D error on held-out data allowed [mm].
        require_test_px: Largest mean error in the images on held-out data allowed [px].

    Returns:
        FAIL where a check fails, above all where the eyes measure boards worse than before or
        lost their scale; PASS where held-out data were evaluated; else NOT_EVALUATED.
    """
    checks = [
        *(calibration.boards.reasons if calibration.boards else ()),
        _ray_reason(calibration),
        _noise_reason(calibration),
        _outlier_reason(calibration),
        None if calibration.converged else "the solver stopped without reaching a minimum",
        *_blind_reasons(calibration),
        _held_out_reason(calibration),
        _bound_reason(calibration, require_test_mm, "mm"),
        _bound_reason(calibration, require_test_px, "px"),
    ]
    failed = tuple(reason for reason in checks if reason)
    if failed:
        return Verdict("FAIL", failed)
    if calibration.test is None or calibration.test.statistics is None:
        return Verdict("NOT_EVALUATED", ("nothing was held out: give --test or --test-fraction",))
    return Verdict("PASS", (_held_out_words(calibration.test),))


def _held_out_words(test: PixelEvaluation) -> str:
    """State the held-out errors, and of how many poses where one eye alone saw some."""
    points, pixels, n = test.statistics, test.pixel_statistics, test.poses
    assert points is not None
    assert pixels is not None
    words = f"{1e3 * points.mean:.2f} mm and {pixels.mean:.2f} px mean error on {n} poses that were"
    by_both = test.select(np.flatnonzero(np.isfinite(test.p_LH_seen).all(axis=1))).poses
    both = "" if by_both == n else f", {by_both} of them seen by both eyes"
    return f"{words} held out{both}"


def body_warnings(calibration: BodyCalibration) -> tuple[str, ...]:
    """Return what the method cannot promise, in words, though nothing fails."""
    options, words = calibration.options, []
    if options.stage != "kinematics" and not options.anchored:
        name = "the thesis' own variant" if options.variant == "thesis" else "without boards"
        words.append(
            f"{name}: nothing but `{calibration.scale_from}` holds the scale"
            f"{_gives_way(calibration)}; its own 3D "
            "error may fall while the true one grows. Anchor it with boards"
        )
    if calibration.boards is not None and not calibration.boards.held_out:
        words.append("no board was held out: the check of the eyes used boards they learned from")
    if calibration.board_outliers.any():
        words.append(
            f"{int(calibration.board_outliers.sum())} boards contradict the rest: left out"
        )
    rig = calibration.model.rig
    words += folds_of(EYES, rig.eyes, rig.left.image_size).values()
    return tuple(words)


def _gives_way(calibration: BodyCalibration) -> str:
    """Say what inside the eyes was free to fit the arm, if anything."""
    free = {n.partition(".")[2] for n in calibration.free if n.partition(".")[0] in EYES}
    if free & set(DISTORTION):
        return ", and lenses bend to fit the arm"
    if free & set(INTRINSICS):
        return ", and focal lengths and image centres shift to fit the arm"
    return ""


def _ray_reason(calibration: BodyCalibration) -> str | None:
    """Say where the lenses fold the image within the reach of the hand."""
    observations = calibration.train.observations
    lost = observations.by_both & ~np.isfinite(calibration.train.p_LH_seen).all(axis=1)
    share = _share_of_poses(calibration, lost & ~calibration.outliers)
    if share <= _MOST_LOST:
        return None
    return (
        f"in {100 * share:.0f} % of the poses no point in front of the refined eyes could be what "
        "they saw: their lenses fold the image, or they do not face the same way"
    )


def _noise_reason(calibration: BodyCalibration) -> str | None:
    play = calibration.noise.joint_sigma
    if play <= _LARGEST_PLAY:
        return None
    return (
        f"the joints would have to play by {np.degrees(play):.1f} deg to explain the pixels: check "
        "the pairing of readings and images, marker labels, and whether something moved"
    )


def _outlier_reason(calibration: BodyCalibration) -> str | None:
    share = _share_of_poses(calibration, calibration.outliers)
    if share <= _MOST_OUTLIERS:
        return None
    return (
        f"{100 * share:.0f} % of the poses contradict the rest: arm, eyes, or what was recorded "
        "are not what the data set says"
    )


def _share_of_poses(calibration: BodyCalibration, rows: NDArray) -> float:
    """Return the share of the training poses that have one of some rows. Shape (N,)."""
    train = calibration.train
    return train.select(rows).poses / train.poses


def _blind_reasons(calibration: BodyCalibration) -> list[str]:
    words = [describe_blind(direction) for direction in calibration.uncertainty.blind]
    more = len(words) - _BLIND_SHOWN
    return words if more <= 0 else [*words[:_BLIND_SHOWN], f"and {more} more blind directions"]


def _held_out_reason(calibration: BodyCalibration) -> str | None:
    """Say when held-out poses fit significantly worse than poses left out in turn."""
    test, turn = calibration.test, calibration.cross_validation
    if test is None or turn is None:
        return None
    found, expected = test.pixel_distances, turn.pixel_distances
    if min(len(found), len(expected)) < _FEWEST:
        return None
    ratio = float(np.median(found) / max(np.median(expected), 1e-12))
    if rank_score(expected, found) < _SIGNIFICANT or ratio < _NOTABLE:
        return None
    return (
        f"the held-out error (median {np.median(found):.2f} px) is significantly above that of the "
        f"training poses in cross-validation ({np.median(expected):.2f} px): the training poses do "
        "not cover where the arm is used, or something moved between recordings"
    )


def _bound_reason(calibration: BodyCalibration, bound: float | None, unit: str) -> str | None:
    if bound is None:
        return None
    test = calibration.test
    found = None if test is None else (test.statistics if unit == "mm" else test.pixel_statistics)
    if found is None:
        return f"--require-test-{unit} was given but nothing was held out"
    mean = found.mean * (1e3 if unit == "mm" else 1.0)
    if mean <= bound:
        return None
    return f"mean held-out error {mean:.3f} {unit}, required at most {bound:g} {unit}"
