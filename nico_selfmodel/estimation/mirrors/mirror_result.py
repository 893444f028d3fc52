"""Mirrors as the result of a calibration."""

from itertools import combinations
from typing import Any

import numpy as np

from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration
from nico_selfmodel.estimation.mirrors.mirror_evaluation import MirrorEvaluation
from nico_selfmodel.estimation.mirrors.mirror_findings import mirror_findings
from nico_selfmodel.estimation.results.calibration_result import (
    CalibrationResult,
    Errors,
    Parameter,
    Terms,
    finite,
    parameter_table,
)
from nico_selfmodel.model.cameras.mirror import MIRROR_UNITS, Mirror, plane_of_values
from nico_selfmodel.optimization.uncertainty import UnobservableDirection

_TERMS = Terms(
    observed="reflections",
    outlier_cause="did the mirror move, or were other things taken for the hand?",
    worse_cause="the mirror moved, or the poses learned from do not cover where it is used",
)


def mirror_result(calibration: MirrorCalibration) -> CalibrationResult:
    """Return mirrors with all that they are judged by and that is written down of them."""
    solution, crossed = calibration.solution, calibration.cross_validation
    return CalibrationResult(
        method="mirror",
        parameters=_mirror_parameters(calibration),
        train=_errors(calibration.train.select(~solution.outliers)),
        test=None if calibration.test is None else _errors(calibration.test),
        cross_validation=None if crossed is None else _errors(crossed),
        outliers=solution.outliers,
        outlier_names=tuple(sorted(set(solution.reflections.sample[solution.outliers].tolist()))),
        unobservable=tuple(map(_describe, solution.uncertainty.unobservable)),
        converged=solution.converged,
        iterations=solution.iterations,
        seconds=calibration.seconds,
        findings=mirror_findings(calibration),
        details=_details(calibration),
        terms=_TERMS,
    )


def _errors(evaluation: MirrorEvaluation) -> Errors:
    """Return errors in the images, and of the points rebuilt from reflections."""
    compared = evaluation.by_pose_px
    return Errors(
        evaluation.distances,
        evaluation.distances_px,
        poses=len(compared),
        compared=compared,
        unit="px",
    )


def _describe(direction: UnobservableDirection) -> str:
    """Say what the reflections leave open, and what would cure it."""
    return (
        f"the reflections do not determine {', '.join(f'`{n}`' for n in direction.names)}: record "
        "poses that both cameras see, farther apart from each other and from the glass"
    )


def _details(calibration: MirrorCalibration) -> dict[str, Any]:
    solution, mirrors = calibration.solution, calibration.mirrors
    return {
        "misplaced": calibration.misplaced.tolist(),
        "mirrors": {name: _mirror(calibration, name) for name in mirrors},
        "angles_deg": {
            f"{a}, {b}": float(np.degrees(mirrors[a].angle_to(mirrors[b])))
            for a, b in combinations(mirrors, 2)
        },
        "loss": calibration.loss,
        "pixel_sigma_px": solution.noise.pixel_sigma,
        "joint_sigma_deg": float(np.degrees(solution.noise.joint_sigma)),
        "noise_ratio": float(np.sqrt(solution.uncertainty.variance_factor)),
    }


def _mirror_parameters(calibration: MirrorCalibration) -> dict[str, Parameter]:
    """Return every mirror's parameters with sigma and unit; the derived normal after them."""
    uncertainty = calibration.solution.uncertainty
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    table: dict[str, Parameter] = {}
    for name, mirror in calibration.mirrors.items():
        table |= parameter_table(Mirror.names_of(name), mirror.values, MIRROR_UNITS, sigma)
        spread = _normal_spread(calibration, name)
        for axis, value, known in zip("xyz", mirror.normal.tolist(), spread, strict=True):
            table[f"mirror.{name}.normal_{axis}"] = Parameter(value, finite(known), "1")
    return table


def _normal_spread(calibration: MirrorCalibration, name: str) -> list[float]:
    """Return the standard deviations of a normal's x, y, z; inf where nothing tells of it."""
    uncertainty = calibration.solution.uncertainty
    own = [uncertainty.names.index(part) for part in Mirror.names_of(name)]
    slopes = np.zeros((3, len(uncertainty.names)))
    slopes[:, own] = plane_of_values(calibration.mirrors[name].values)[1][:3]
    return [uncertainty.sigma_of(slope) for slope in slopes]


def _mirror(calibration: MirrorCalibration, name: str) -> dict[str, Any]:
    """Return what is known of one mirror: its rows, whether it is flat, the thesis' cameras."""
    solution, mirror = calibration.solution, calibration.mirrors[name]
    rows = solution.reflections.mirror == solution.reflections.mirrors.index(name)
    inliers, test = rows & ~solution.outliers, calibration.flatness[name]
    distances, spread = solution.distances[inliers], _normal_spread(calibration, name)
    found: dict[str, Any] = {
        "rows": int(rows.sum()),
        "poses": int(np.unique(solution.reflections.pose[rows]).size),
        "distance_mm": 1e3 * mirror.distance,
        "normal_sigma_deg": finite(float(np.degrees(np.linalg.norm(spread)))),
        "hand_in_front_mm": [1e3 * float(f(solution.in_front_by[rows])) for f in (np.min, np.max)],
        "pixels": Errors(pixels=distances[np.isfinite(distances)], unit="px").to_json(),
        "start": {
            "angle_deg": float(np.degrees(mirror.angle_to(calibration.starts[name]))),
            "distance_mm": 1e3 * calibration.starts[name].distance,
        },
        "flatness": None if test is None else test.to_json(),
        "free_cameras": None,
    }
    cameras = calibration.free_cameras[name]
    if cameras is not None:
        found["free_cameras"] = Errors(pixels=cameras.distances_px, unit="px").to_json()
    return found
