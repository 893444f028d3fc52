"""Cameras that were learned from boards as the result of a calibration."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.board_accuracy import PairAccuracy, Reconstruction
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_findings import camera_findings, rms_of_boards
from nico_selfmodel.estimation.cameras.pair_checks import baseline
from nico_selfmodel.estimation.results.calibration_result import (
    CalibrationResult,
    Errors,
    Parameter,
    Terms,
    finite,
    parameter_table,
)
from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.estimation.results.verdict import FEWEST_BOARDS
from nico_selfmodel.model.cameras.rig_parameters import rig_names, rig_units, rig_values
from nico_selfmodel.optimization.uncertainty import UnobservableDirection

_TERMS = Terms(
    held_out="boards",
    observed="boards",
    outlier_cause="is the board flat and of the size given, and were the images of a pair taken "
    "together?",
    worse_cause="the boards learned from do not cover where the others were, or a camera changed",
    fewest=FEWEST_BOARDS,
    bounded="rms",
)


def camera_result(assessment: CameraAssessment) -> CalibrationResult:
    """Return cameras with all that they are judged by and that is written down of them."""
    calibration, test = assessment.calibration, assessment.test_views
    named = zip(calibration.views.names, calibration.outliers, strict=True)
    left_out = rms_of_boards(assessment.left_out_residuals)
    held_out = None
    if test is not None and assessment.test_residuals is not None:
        rms = rms_of_boards(assessment.test_residuals)
        held_out = _errors(assessment.test_distances, len(test), rms)
    return CalibrationResult(
        method={1: "camera", 2: "stereo"}.get(len(calibration.cameras), "cameras"),
        parameters=_camera_parameters(assessment),
        train=_errors(assessment.train_distances),
        test=held_out,
        cross_validation=_errors(assessment.cross_validation, None, left_out),
        outliers=calibration.outliers,
        outlier_names=tuple(name for name, out in named if out),
        unobservable=tuple(map(_describe, calibration.uncertainty.unobservable)),
        converged=calibration.converged,
        iterations=calibration.iterations,
        seconds=calibration.seconds,
        findings=camera_findings(assessment),
        details=_details(assessment),
        terms=_TERMS,
    )


def _errors(
    distances: NDArray | None, boards: int | None = None, rms: NDArray | None = None
) -> Errors:
    compared = np.zeros(0) if rms is None else rms
    return Errors(pixels=distances, poses=boards, compared=compared, unit="px")


def _describe(direction: UnobservableDirection) -> str:
    """Say what the boards leave open, and what would cure it."""
    return (
        f"the boards do not determine {', '.join(f'`{name}`' for name in direction.names)}: "
        "tilt the board more, bring it nearer to the image's edges and to other distances, or fix "
        f"a value with --fix {direction.names[0]}"
    )


def _camera_parameters(assessment: CameraAssessment) -> dict[str, Parameter]:
    """Return every parameter of the cameras; the derived baseline last."""
    calibration = assessment.calibration
    sigma = dict(zip(calibration.names, calibration.uncertainty.sigma.tolist(), strict=True))
    cameras, lenses = calibration.views.cameras, [c.lens for c in calibration.cameras]
    names, units = rig_names(cameras, lenses), rig_units(len(cameras), lenses)
    table = parameter_table(names, rig_values(calibration.cameras), units, sigma)
    if len(cameras) != 2:
        return table
    apart = calibration.rig.X_LR[:3, 3]
    return table | {"baseline": baseline(apart, calibration.uncertainty, cameras)}


def _details(assessment: CameraAssessment) -> dict[str, Any]:
    calibration, pairs = assessment.calibration, assessment.pairs
    details: dict[str, Any] = {
        "views": dict(zip(calibration.views.names, calibration.view_rms.tolist(), strict=True)),
        "pixel_sigma_px": finite(calibration.pixel_sigma),
        "cost_px2": calibration.cost,
        "projection_sigma_px": {
            found.camera: {"middle": finite(found.middle), "corner": finite(found.corner)}
            for found in assessment.projection
        },
    }
    if assessment.known is not None:
        learned, table = calibration.self_model("learned"), _camera_parameters(assessment)
        told = [name for name, one in table.items() if one.sigma is not None]
        details["before"] = assessment.known.changes(learned, told)
    pair = assessment.pair
    if pair is None:
        return details | ({"pairs": [_of_pair(assessment, p) for p in pairs]} if pairs else {})
    details["epipolar_px"] = _epipolar(assessment, pair).to_json()
    details["reconstruction"] = None
    if len(pair.reconstruction.views):
        held_out = assessment.test_views is not None
        details["reconstruction"] = {"held_out": held_out, **rebuilt_block(pair.reconstruction)}
    return details


def _epipolar(assessment: CameraAssessment, pair: PairAccuracy) -> Errors:
    inliers = pair.epipolar[~assessment.calibration.outliers].ravel()
    return _errors(inliers[np.isfinite(inliers)])


def _of_pair(assessment: CameraAssessment, pair: PairAccuracy) -> dict[str, Any]:
    """Return what `result.json` tells of two cameras of a larger rig."""
    calibration = assessment.calibration
    left, right = calibration.pair(*pair.cameras).cameras
    apart = right.X_WC[:3, 3] - left.X_WC[:3, 3]
    rebuilt = pair.reconstruction
    return {
        "cameras": list(pair.cameras),
        "boards": pair.boards,
        "baseline": baseline(apart, calibration.uncertainty, pair.cameras).to_json(),
        "epipolar_px": _epipolar(assessment, pair).to_json(),
        "reconstruction": rebuilt_block(rebuilt) if len(rebuilt.views) else None,
    }


def rebuilt_block(found: Reconstruction) -> dict[str, Any]:
    """Return how true boards were that two cameras rebuilt."""
    statistics = ErrorStatistics.from_distances(found.errors.ravel())
    return {
        "boards": len(found.views),
        "edge_mm": {"true": 1e3 * found.square, "mean": 1e3 * float(found.edges.mean())}
        | {"sd": 1e3 * found.edge_sd},
        "scale": {"mean": float(found.scale.mean()), "sd": float(found.scale.std())},
        "position_mm": statistics.as_mm(),
    }
