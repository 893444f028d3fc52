"""Cameras that were learned from boards as the result of a calibration."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.board_accuracy import Reconstruction
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.camera_findings import camera_findings, rms_of_boards
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
from nico_selfmodel.model.cameras.projection import intrinsic_units
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
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
    """Return cameras with all that they are judged by and that is written down of them.

    Args:
        assessment: What was learned and what it is worth.
    """
    calibration, test = assessment.calibration, assessment.test_views
    named = zip(calibration.views.names, calibration.outliers, strict=True)
    left_out = rms_of_boards(assessment.left_out_residuals)
    held_out = None
    if test is not None and assessment.test_residuals is not None:
        rms = rms_of_boards(assessment.test_residuals)
        held_out = _errors(assessment.test_distances, len(test), rms)
    return CalibrationResult(
        method="stereo" if len(calibration.cameras) == 2 else "camera",
        parameters=camera_parameters(assessment),
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


def camera_parameters(assessment: CameraAssessment) -> dict[str, Parameter]:
    """Return every parameter of the cameras; the derived baseline last."""
    calibration = assessment.calibration
    sigma = dict(zip(calibration.names, calibration.uncertainty.sigma.tolist(), strict=True))
    first = calibration.cameras[0]
    names = StereoRig.names_of(calibration.views.cameras, first.lens)
    if len(calibration.cameras) == 1:
        return parameter_table(names, first.values, intrinsic_units(first.lens), sigma)
    rig, covariance = calibration.rig, calibration.uncertainty.covariance
    table = parameter_table(names, rig.values, rig.units, sigma)
    return table | {"baseline": baseline(rig, calibration.names, covariance)}


def baseline(rig: StereoRig, names: tuple[str, ...], covariance: NDArray) -> Parameter:
    """Return |p_LR|, whose slope by the position is its direction.

    Args:
        rig: Two cameras.
        names: Of the free parameters. Length k.
        covariance: Of these. Shape (k, k).
    """
    slope = np.zeros(len(names))
    for axis, share in zip("xyz", rig.X_LR[:3, 3] / rig.baseline, strict=True):
        slope[np.array(names) == f"right.pose.{axis}"] = share
    return Parameter(rig.baseline, finite(float(np.sqrt(slope @ covariance @ slope))), "m")


def _details(assessment: CameraAssessment) -> dict[str, Any]:
    calibration, found = assessment.calibration, assessment.reconstruction
    details: dict[str, Any] = {
        "views": dict(zip(calibration.views.names, calibration.view_rms.tolist(), strict=True)),
        "pixel_sigma_px": finite(calibration.pixel_sigma),
        "cost_px2": calibration.cost,
        "projection_sigma_px": {
            found.camera: {"middle": finite(found.middle), "corner": finite(found.corner)}
            for found in assessment.projection
        },
    }
    if assessment.epipolar is None or found is None:
        return details
    inliers = assessment.epipolar[~calibration.outliers].ravel()
    details["epipolar_px"] = _errors(inliers[np.isfinite(inliers)]).to_json()
    details["reconstruction"] = None
    if len(found.views):
        held_out = assessment.test_views is not None
        details["reconstruction"] = {"held_out": held_out, **rebuilt_block(found)}
    return details


def rebuilt_block(found: Reconstruction) -> dict[str, Any]:
    """Return how true boards were that two cameras rebuilt.

    Args:
        found: The boards.
    """
    statistics = ErrorStatistics.from_distances(found.errors.ravel())
    return {
        "boards": len(found.views),
        "edge_mm": {"true": 1e3 * found.square, "mean": 1e3 * float(found.edges.mean())}
        | {"sd": 1e3 * found.edge_sd},
        "scale": {"mean": float(found.scale.mean()), "sd": float(found.scale.std())},
        "position_mm": statistics.as_mm(),
    }
