"""PASS, FAIL or NOT_EVALUATED for cameras that were learned from boards."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.camera_assessment import (
    CameraAssessment,
    fails_the_lens,
    words_of_misfit,
)
from nico_selfmodel.estimation.lens_folds import folds_by_chance, folds_of
from nico_selfmodel.estimation.verdict import (
    FEWEST_BOARDS,
    Verdict,
    bound_reason,
    conclude,
    held_out_is_worse,
    outliers_are_many,
)

_EXCESSIVE = 3.0
"""Ratio of root mean squares that needs no statistics: of a handful of boards, or one wrong one."""
_WORST_PX, _WORST = 6.0, 20.0
"""A corner further off than both, in pixels and in standard deviations, is no corner of the board:
a detector's corner lies within, whatever its window holds."""


def judge_cameras(assessment: CameraAssessment, require_test_px: float | None = None) -> Verdict:
    """Judge a camera calibration.

    Args:
        assessment: What it is worth.
        require_test_px: Largest rms reprojection error of held-out boards allowed [px].

    Returns:
        FAIL where a check fails; PASS where enough boards were held out and nothing failed; else
        NOT_EVALUATED.
    """
    calibration, distances = assessment.calibration, assessment.test_distances
    rms = None if distances is None else float(np.sqrt(np.mean(distances**2)))
    checks = [
        None if calibration.converged else "the solver stopped without reaching a minimum",
        *_blind_reasons(calibration),
        _outlier_reason(calibration),
        *(words_of_misfit(misfit) for misfit in assessment.misfits if fails_the_lens(misfit)),
        _worst_reason(assessment),
        *_fold_reasons(assessment),
        _held_out_reason(assessment),
        bound_reason(rms, require_test_px, "px"),
    ]
    boards = 0 if assessment.test_views is None else len(assessment.test_views)
    said = [] if rms is None else [f"{rms:.3f} px rms on {boards} boards that were held out"]
    warned = assessment.warnings
    return conclude(checks, boards, "boards", said, warned, fewest=FEWEST_BOARDS)


def _blind_reasons(calibration: CameraCalibration) -> list[str]:
    return [
        f"the boards do not determine {', '.join(f'`{name}`' for name in direction.names)}: "
        "tilt the board more, bring it nearer to the image's edges and to other distances, or hold "
        f"a value with --fix {direction.names[0]}"
        for direction in calibration.uncertainty.blind
    ]


def _outlier_reason(calibration: CameraCalibration) -> str | None:
    share = outliers_are_many(calibration.outliers)
    if share is None:
        return None
    return (
        f"{100 * share:.0f} % of the boards contradict the rest: is the board flat and of the size "
        "given, and were the images of a pair taken together?"
    )


def _worst_reason(assessment: CameraAssessment) -> str | None:
    """Say where a corner of a believed or held-out board is none."""
    calibration = assessment.calibration
    sigma = float(np.median(assessment.train_distances)) / np.sqrt(2.0 * np.log(2.0))
    shown = [("", calibration.views.names, calibration.distances, ~calibration.outliers)]
    if assessment.test_views is not None and assessment.test_residuals is not None:
        names, r = assessment.test_views.names, assessment.test_residuals
        pairs = np.linalg.norm(r.reshape(len(r), -1, r.shape[2] // 2, 2), axis=3)
        everything = np.ones(len(r), dtype=bool)
        shown.append(("held-out ", names, np.moveaxis(pairs, 2, 1), everything))
    for kind, names, distances, counts in shown:
        worst = np.where(counts, np.nanmax(distances, axis=(1, 2), initial=0.0), 0.0)
        view = int(np.argmax(worst))
        if worst[view] > max(_WORST_PX, _WORST * sigma):
            return (
                f"a corner of {kind}board {names[view]} lies {worst[view]:.1f} px off, typical are "
                f"{sigma:.2f}: is it a plain chessboard (no ChArUco board), flat and sharp, and "
                "the lens no fisheye?"
            )
    return None


def _fold_reasons(assessment: CameraAssessment) -> list[str]:
    """Say where a lens folds its image and the boards say so; what is by chance is a warning."""
    calibration = assessment.calibration
    views, by_chance = calibration.views, folds_by_chance(calibration)
    folds = folds_of(views.eyes, calibration.cameras, views.image_size)
    if any(map(fails_the_lens, assessment.misfits)):
        return [fold.partition(": ")[0] for fold in folds.values()]  # pins would cure nothing
    return [fold for eye, fold in folds.items() if eye not in by_chance]


def _held_out_reason(assessment: CameraAssessment) -> str | None:
    """Compare boards, not corners: what is wrong with one corner of a board is with all."""
    if assessment.test_residuals is None or len(assessment.left_out_residuals) == 0:
        return None
    found = _rms_of_boards(assessment.test_residuals)
    expected = _rms_of_boards(assessment.left_out_residuals)
    rms, before = (float(np.sqrt(np.mean(r**2))) for r in (found, expected))
    if held_out_is_worse(expected, found):
        return (
            f"held-out boards fit significantly worse (median rms {np.median(found):.3f} px) than "
            f"boards left out in turn ({np.median(expected):.3f} px)"
        )
    if rms < _EXCESSIVE * before:
        return None
    return (
        f"held-out boards fit to {rms:.3f} px rms, boards left out in turn to {before:.3f} px: some"
        " of them contradict the others"
    )


def _rms_of_boards(residuals: NDArray) -> NDArray:
    """Return the root mean square error of each board. Shape (V, P, 2 C) -> (V,)."""
    return np.sqrt(2.0 * np.nanmean(residuals**2, axis=(1, 2)))
