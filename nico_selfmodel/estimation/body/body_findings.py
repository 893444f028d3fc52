"""What speaks for and against arm and cameras that were refined together."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.what_bends import bending_warnings, kept_words
from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.cameras.lenses.lens_folds import folds_of
from nico_selfmodel.estimation.diagnosis.gear_check import gear_words
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_JOINT_NOISE
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.results.calibration_result import (
    FAILURE,
    NOTE,
    WARNING,
    Finding,
    findings,
)
from nico_selfmodel.model.cameras.projection import EVERY_INTRINSIC
from nico_selfmodel.model.cameras.rig_parameters import SIDES

_MOST_LOST = 0.02
"""Share of inlier poses that may lack a point in front of both cameras."""


def body_findings(calibration: BodyCalibration) -> tuple[Finding, ...]:
    """Return what speaks for and against a body beyond what every calibration is asked.

    Above all whether the cameras measure boards worse than before, or lost their scale.
    """
    test = calibration.test
    failures = [
        *(calibration.boards.reasons if calibration.boards else ()),
        _ray_reason(calibration),
        _noise_reason(calibration),
        *gear_words(calibration.ladder.doubtful_gears),
    ]
    said = [] if test is None or test.statistics is None else [_held_out_words(test)]
    ladder, at = calibration.ladder, calibration.at
    said += kept_words(ladder, calibration.model.bending, at)
    return (
        *findings(FAILURE, failures),
        *findings(WARNING, [*bending_warnings(ladder, at), *_warnings(calibration)]),
        *findings(NOTE, said),
    )


def _held_out_words(test: PixelEvaluation) -> str:
    """State the held-out errors, and of how many poses where one camera alone saw some."""
    points, pixels, n = test.statistics, test.pixel_statistics, test.pose_count
    assert points is not None
    assert pixels is not None
    words = f"{1e3 * points.mean:.2f} mm and {pixels.mean:.2f} px mean error on {n} poses that were"
    rebuilt = np.flatnonzero(np.isfinite(test.p_LH_seen).all(axis=1))
    both = test.select(rebuilt).pose_count
    return f"{words} held out" + ("" if both == n else f", {both} of them seen by both cameras")


def _warnings(calibration: BodyCalibration) -> tuple[str, ...]:
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
        words.append(
            "no board was held out: the check of the cameras used boards they learned from"
        )
    if calibration.boards is not None and calibration.boards.doubt is not None:
        words.append(calibration.boards.doubt)
    if calibration.start.bending is not None:
        words.append(
            f"what bends in the arm of {calibration.start.name!r} is not kept: a body of an arm "
            "and two cameras is rigid so far"
        )
    if calibration.board_outliers.any():
        words.append(
            f"{int(calibration.board_outliers.sum())} boards contradict the rest: left out"
        )
    rig = calibration.model.rig
    words += folds_of(SIDES, rig.cameras).values()
    return tuple(words)


def _gives_way(calibration: BodyCalibration) -> str:
    """Say what inside the cameras was free to fit the arm, if anything."""
    free = {n.partition(".")[2] for n in calibration.free if n.partition(".")[0] in SIDES}
    if free & set(EVERY_INTRINSIC[5:]):
        return ", and lenses bend to fit the arm"
    if free & set(EVERY_INTRINSIC):
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
        f"in {100 * share:.0f} % of the poses no point in front of the refined cameras could be "
        "what they saw: their lenses fold the image, or they do not face the same way"
    )


def _noise_reason(calibration: BodyCalibration) -> str | None:
    noise = calibration.noise.joint_sigma
    if noise <= LARGEST_JOINT_NOISE:
        return None
    return (
        f"joint noise would have to be {np.degrees(noise):.1f} deg to explain the pixels: check "
        "the pairing of readings and images, marker labels, and whether something moved"
    )


def _share_of_poses(calibration: BodyCalibration, rows: NDArray) -> float:
    """Return the share of the training poses that have one of some rows. Boolean, shape (N,)."""
    return calibration.train.select(rows).pose_count / calibration.train.pose_count
