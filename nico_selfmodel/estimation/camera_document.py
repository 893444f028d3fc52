"""A camera calibration as plain data: what goes into `result.json`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.error_statistics import ErrorStatistics
from nico_selfmodel.estimation.verdict import Verdict
from nico_selfmodel.model.camera import INTRINSIC_UNITS
from nico_selfmodel.model.stereo_rig import StereoRig


def camera_document(assessment: CameraAssessment, verdict: Verdict) -> dict[str, Any]:
    """Return the content of `result.json`; numbers that do not exist are null.

    Args:
        assessment: What was learned and what it is worth.
        verdict: What is thought of it.

    Returns:
        A mapping of plain Python values.
    """
    calibration = assessment.calibration
    document = {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "warnings": list(verdict.warnings),
        "method": "stereo" if len(calibration.cameras) == 2 else "camera",
        "train": _block(assessment.train_distances),
        "test": _block(assessment.test_distances),
        "cross_validation": _block(assessment.cross_validation),
        "parameters": camera_parameters(assessment),
        "not_identifiable": [
            ", ".join(direction.names) for direction in calibration.uncertainty.blind
        ],
        "outliers": [
            name
            for name, out in zip(calibration.views.names, calibration.outliers, strict=True)
            if out
        ],
        "views": dict(zip(calibration.views.names, calibration.view_rms.tolist(), strict=True)),
        "pixel_sigma_px": _finite(calibration.pixel_sigma),
        "cost_px2": calibration.cost,
        "seconds": calibration.seconds,
        "iterations": calibration.iterations,
        "converged": calibration.converged,
    }
    if assessment.epipolar is not None and assessment.reconstruction is not None:
        document |= {
            "epipolar_px": _block(_believed(assessment.epipolar, calibration.outliers)),
            "reconstruction": _reconstruction(assessment),
        }
    return document


def camera_parameters(assessment: CameraAssessment) -> dict[str, Mapping[str, Any]]:
    """Return every camera parameter with value, sigma, unit and whether it was free."""
    calibration = assessment.calibration
    sigma = dict(zip(calibration.names, calibration.uncertainty.sigma.tolist(), strict=True))
    names = StereoRig.names_of(calibration.views.eyes)
    pair = len(calibration.cameras) == 2
    values = calibration.rig.values if pair else calibration.cameras[0].values
    units = calibration.rig.units if pair else INTRINSIC_UNITS
    table: dict[str, Mapping[str, Any]] = {}
    for name, value, unit in zip(names, values.tolist(), units, strict=True):
        free = name in sigma
        known = _finite(sigma[name]) if free else 0.0
        table[name] = {"value": value, "sigma": known, "unit": unit, "free": free}
    if pair:
        table["baseline"] = {
            "value": calibration.rig.baseline,
            "sigma": _finite(baseline_sigma(assessment)),
            "unit": "m",
            "free": False,
        }
    return table


def baseline_sigma(assessment: CameraAssessment) -> float:
    """Return the standard deviation of the baseline, |p_LR|, from that of its components [m]."""
    calibration = assessment.calibration
    direction = calibration.rig.X_LR[:3, 3] / calibration.rig.baseline
    slope = np.zeros(len(calibration.names))
    for axis, share in zip("xyz", direction, strict=True):
        if f"right.pose.{axis}" in calibration.names:
            slope[calibration.names.index(f"right.pose.{axis}")] = share
    return float(np.sqrt(slope @ calibration.uncertainty.covariance @ slope))


def _reconstruction(assessment: CameraAssessment) -> dict[str, Any] | None:
    found = assessment.reconstruction
    if found is None or len(found.views) == 0:
        return None
    statistics = ErrorStatistics.from_distances(found.errors.ravel())
    return {
        "boards": len(found.views),
        "held_out": assessment.test_views is not None,
        "edge_mm": {"true": 1e3 * found.square, "mean": 1e3 * float(found.edges.mean())}
        | {"sd": 1e3 * found.edge_sd},
        "scale": {"mean": float(found.scale.mean()), "sd": float(found.scale.std())},
        "position_mm": statistics.as_mm(),
    }


def _believed(values: NDArray, outliers: NDArray) -> NDArray:
    """Return the numbers of the believed views that exist. Shape (n,)."""
    kept = values[~outliers].ravel()
    return kept[np.isfinite(kept)]


def _block(distances: NDArray | None) -> dict[str, Any] | None:
    if distances is None or len(distances) == 0:
        return None
    statistics = ErrorStatistics.from_distances(distances)
    names = ("mean", "sd", "rms", "median", "p95", "max")
    return {"n": statistics.n, "pixels": {name: getattr(statistics, name) for name in names}}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
