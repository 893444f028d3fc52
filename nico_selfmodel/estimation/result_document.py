"""A calibration as plain data: what goes into `result.json`."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from nico_selfmodel.estimation.blind_words import describe_blind
from nico_selfmodel.estimation.error_statistics import ErrorStatistics, Evaluation
from nico_selfmodel.estimation.kinematics import KinematicCalibration
from nico_selfmodel.estimation.verdict import Verdict


def result_document(calibration: KinematicCalibration, verdict: Verdict) -> dict[str, Any]:
    """Return the content of `result.json`; numbers that do not exist are null.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.

    Returns:
        A mapping of plain Python values.
    """
    search = calibration.search
    return {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "warnings": list(verdict.warnings),
        "method": calibration.method,
        "train": _statistics(calibration.train, ~calibration.outliers),
        "test": _statistics(calibration.test),
        "cross_validation": _block(calibration.cross_validation),
        "parameters": parameter_table(calibration),
        "not_identifiable": _blind(calibration),
        "outliers": sorted(
            set(calibration.train.observations.sample[calibration.outliers].tolist())
        ),
        "noise_sigma_mm": _finite(calibration.model.noise_sigma, 1e3),
        "starts": None
        if search is None
        else {
            "tried": len(search.labels),
            "agreeing": search.agreeing,
            "best": search.best_label,
        },
        "circles": [] if calibration.circles is None else _circles(calibration),
        "seconds": calibration.seconds,
        "iterations": calibration.iterations,
        "converged": calibration.converged,
    }


def parameter_table(calibration: KinematicCalibration) -> dict[str, Mapping[str, Any]]:
    """Return every parameter with value, sigma, unit and whether it was free; derived ones last."""
    parameters = calibration.model.parameters
    sigma: dict[str, float] = {}
    if calibration.uncertainty is not None:
        uncertainty = calibration.uncertainty
        sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    table: dict[str, Mapping[str, Any]] = {}
    for name, value, unit in zip(
        parameters.names, parameters.values.tolist(), parameters.units, strict=True
    ):
        free = name in calibration.free
        if not free and name.endswith(".beta") and value == 0.0:
            continue  # an ordinary row has no second twist
        known = _finite(sigma.get(name)) if free else 0.0
        table[name] = {"value": value, "sigma": known, "unit": unit, "free": free}
    table["noise_sigma"] = {
        "value": calibration.model.noise_sigma,
        "sigma": None,
        "unit": "m",
        "free": False,
    }
    return table


def _blind(calibration: KinematicCalibration) -> list[str]:
    if calibration.uncertainty is None:
        return []
    return [describe_blind(direction) for direction in calibration.uncertainty.blind]


def _statistics(evaluation: Evaluation | None, believed: Any = None) -> dict[str, Any] | None:
    if evaluation is None:
        return None
    distances = evaluation.distances
    return _block(distances if believed is None else distances[believed])


def _block(distances: Any) -> dict[str, Any] | None:
    if len(distances) == 0:
        return None
    statistics = ErrorStatistics.from_distances(distances)
    return {"n": statistics.n, "position_mm": statistics.as_mm()}


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


def _finite(value: float | None, scale: float = 1.0) -> float | None:
    return float(value) * scale if value is not None and np.isfinite(value) else None
