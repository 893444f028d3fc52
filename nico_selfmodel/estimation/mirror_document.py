"""Mirrors as plain data: what goes into `result.json`."""

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.error_statistics import ErrorStatistics
from nico_selfmodel.estimation.mirror import MirrorCalibration
from nico_selfmodel.estimation.mirror_cameras import fit_mirror_cameras
from nico_selfmodel.estimation.mirror_evaluation import MirrorEvaluation
from nico_selfmodel.estimation.verdict import Verdict
from nico_selfmodel.model.mirror import MIRROR_UNITS, Mirror, plane_of_values

_STATISTICS = ("mean", "sd", "rms", "median", "p95", "max")


def mirror_document(calibration: MirrorCalibration, verdict: Verdict) -> dict[str, Any]:
    """Return the content of `result.json`; numbers that do not exist are null.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.

    Returns:
        A mapping of plain Python values.
    """
    solution = calibration.solution
    outliers = solution.reflections.sample[solution.outliers]
    turn = calibration.cross_validation
    return {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "warnings": list(verdict.warnings),
        "method": "mirror",
        "train": _block(calibration.train.select(~solution.outliers)),
        "test": None if calibration.test is None else _block(calibration.test),
        "cross_validation": None if turn is None else _pixels(turn.distances_px),
        "parameters": mirror_parameters(calibration),
        "not_identifiable": [", ".join(d.names) for d in solution.uncertainty.blind],
        "outliers": sorted(set(outliers.tolist())),
        "misplaced": calibration.misplaced.tolist(),
        "mirrors": {name: _mirror(calibration, name) for name in calibration.mirrors},
        "angles_deg": {
            f"{a}, {b}": float(np.degrees(calibration.mirrors[a].angle_to(calibration.mirrors[b])))
            for a, b in combinations(calibration.mirrors, 2)
        },
        "loss": calibration.loss,
        "pixel_sigma_px": solution.noise.pixel_sigma,
        "joint_sigma_deg": float(np.degrees(solution.noise.joint_sigma)),
        "noise_ratio": float(np.sqrt(solution.uncertainty.variance_factor)),
        "seconds": calibration.seconds,
        "iterations": solution.iterations,
        "converged": solution.converged,
    }


def mirror_parameters(calibration: MirrorCalibration) -> dict[str, Mapping[str, Any]]:
    """Return every mirror's parameters with sigma and unit; the derived normal after them."""
    uncertainty = calibration.solution.uncertainty
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    table: dict[str, Mapping[str, Any]] = {}
    for name, mirror in calibration.mirrors.items():
        named = zip(Mirror.names_of(name), mirror.values.tolist(), MIRROR_UNITS, strict=True)
        for key, value, unit in named:
            table[key] = {"value": value, "sigma": _finite(sigma[key]), "unit": unit, "free": True}
        slopes = plane_of_values(mirror.values)[1][:3]
        covariance = np.zeros((3, 3)) if mirror.covariance is None else mirror.covariance
        spread = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
        for axis, value, known in zip("xyz", mirror.normal.tolist(), spread.tolist(), strict=True):
            key = f"mirror.{name}.normal_{axis}"
            table[key] = {"value": value, "sigma": known, "unit": "1", "free": False}
    return table


def _mirror(calibration: MirrorCalibration, name: str) -> dict[str, Any]:
    """Return what is known of one mirror: its rows, whether it is flat, the thesis' cameras."""
    solution, mirror = calibration.solution, calibration.mirrors[name]
    rows = solution.reflections.mirror == solution.reflections.mirrors.index(name)
    believed, test = rows & ~solution.outliers, calibration.flatness[name]
    distances = solution.distances[believed]
    found: dict[str, Any] = {
        "rows": int(rows.sum()),
        "poses": int(np.unique(solution.reflections.pose[rows]).size),
        "distance_mm": 1e3 * mirror.distance,
        "normal_sigma_deg": float(np.degrees(mirror.normal_sigma or 0.0)),
        "hand_in_front_mm": [1e3 * float(f(solution.in_front_by[rows])) for f in (np.min, np.max)],
        "pixels": _pixels(distances[np.isfinite(distances)]),
        "start": {
            "angle_deg": float(np.degrees(mirror.angle_to(calibration.starts[name]))),
            "distance_mm": 1e3 * calibration.starts[name].distance,
        },
        "flatness": None,
        "free_cameras": None,
    }
    if test is not None:
        found["flatness"] = {
            "flat": bool(test.flat),
            "chi_square": test.chi_square,
            "freedom": test.freedom,
            "redundancy": test.redundancy,
            "by_chance": test.by_chance,
        }
    try:
        own = solution.reflections.select(believed).of(name)
        found["free_cameras"] = _pixels(fit_mirror_cameras(own).evaluate(own).distances_px)
    except NotIdentifiableError:
        pass
    return found


def _block(evaluation: MirrorEvaluation) -> dict[str, Any] | None:
    """Return errors in pixels and of the rebuilt points."""
    block = _pixels(evaluation.distances_px)
    if block is not None and len(evaluation.distances):
        statistics = ErrorStatistics.from_distances(evaluation.distances)
        block["position_mm"] = statistics.as_mm()
    return block


def _pixels(distances: NDArray) -> dict[str, Any] | None:
    if len(distances) == 0:
        return None
    statistics = ErrorStatistics.from_distances(distances)
    return {"n": statistics.n, "pixels": {k: getattr(statistics, k) for k in _STATISTICS}}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
