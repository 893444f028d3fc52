"""A learned arm as the result of a calibration."""

from typing import Any

import numpy as np

from nico_selfmodel.estimation.arm.arm_findings import WHAT_CHANGED, arm_findings
from nico_selfmodel.estimation.arm.evaluation import Evaluation
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.estimation.bending.what_bends import bending_json
from nico_selfmodel.estimation.observations.outlier_words import describe_outliers
from nico_selfmodel.estimation.results.calibration_result import (
    CalibrationResult,
    Errors,
    Parameter,
    Terms,
    finite,
    parameter_table,
)
from nico_selfmodel.estimation.results.unobservable_words import describe_unobservable

_TERMS = Terms(
    observed="training points",
    outlier_cause="the arm, or what was recorded, is not what the data set says",
    worse_cause=WHAT_CHANGED,
)


def arm_result(calibration: KinematicCalibration) -> CalibrationResult:
    """Return a learned arm with all that it is judged by and that is written down of it."""
    rows, outliers, known = calibration.train.observations, calibration.outliers, None
    if calibration.uncertainty is not None:
        known = calibration.uncertainty.unobservable
    return CalibrationResult(
        method=calibration.method,
        parameters=_parameters(calibration),
        train=Errors(calibration.train.distances[~outliers]),
        test=None if calibration.test is None else _held_out(calibration.test),
        cross_validation=_cross_validated(calibration),
        outliers=outliers,
        outlier_names=tuple(sorted(set(rows.sample[outliers].tolist()))),
        outlier_words=describe_outliers(rows, outliers) if outliers.any() else "",
        unobservable=tuple(describe_unobservable(direction) for direction in known or ()),
        converged=calibration.converged,
        iterations=calibration.iterations,
        seconds=calibration.seconds,
        findings=arm_findings(calibration),
        details=_details(calibration),
        terms=_TERMS,
    )


def _held_out(test: Evaluation) -> Errors:
    """Return held-out errors; poses are compared by their inliers."""
    compared = test.observations.by_pose(test.distances, ~test.outliers)
    return Errors(test.distances, poses=len(test.observations.poses), compared=compared)


def _cross_validated(calibration: KinematicCalibration) -> Errors:
    """Return cross-validated errors; held-out poses are free ones, to be compared with free ones.

    Sweeps say less of other poses.
    """
    errors, inliers = calibration.cross_validation, ~calibration.outliers
    if not len(errors):
        return Errors(errors)
    free = calibration.free_poses[inliers]
    rows = calibration.train.observations.select(inliers)
    told = np.isfinite(errors)
    free = free if free.any() else ~free
    return Errors(errors[told], compared=rows.by_pose(errors, free & told))


def _parameters(calibration: KinematicCalibration) -> dict[str, Parameter]:
    """Return every parameter of the arm, and the noise that it leaves."""
    parameters, uncertainty = calibration.model.parameters, calibration.uncertainty
    sigma: dict[str, float] = dict.fromkeys(calibration.free, np.inf)
    if uncertainty is not None:
        sigma |= dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
        sigma = {name: value for name, value in sigma.items() if name in calibration.free}
    table = parameter_table(parameters.names, parameters.values, parameters.units, sigma)
    return table | {"noise_sigma": Parameter(calibration.model.noise_sigma, None, "m")}


def _details(calibration: KinematicCalibration) -> dict[str, Any]:
    search, model = calibration.search, calibration.model
    observations, starts = calibration.train.observations, None
    if search is not None:
        starts = {
            "tried": len(search.labels),
            "agreeing": search.agreeing,
            "best": search.best_label,
        }
    return {
        "noise_sigma_mm": finite(model.noise_sigma, 1e3),
        "starts": starts,
        "circles": [] if calibration.circles is None else _circles(calibration),
        "bending": bending_json(
            calibration.ladder, model.bending, calibration.at, observations.joints
        ),
    }


def _circles(calibration: KinematicCalibration) -> list[dict[str, Any]]:
    assert calibration.circles is not None
    joints = calibration.model.joints
    return [
        {
            "joint": joints[fit.joint],
            "points": int(fit.inliers.sum()),
            "radius_mm": 1e3 * fit.circle.radius,
            "arc_deg": float(np.degrees(fit.circle.arc)),
            "rms_mm": 1e3 * fit.circle.rms,
            "sagitta_mm": 1e3 * fit.circle.sagitta,
        }
        for fit in calibration.circles.circles
    ]
