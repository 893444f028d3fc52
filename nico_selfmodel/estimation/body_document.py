"""A refined body as plain data: what goes into `result.json`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.blind_words import describe_blind
from nico_selfmodel.estimation.board_accuracy import Reconstruction
from nico_selfmodel.estimation.body import BodyCalibration
from nico_selfmodel.estimation.error_statistics import ErrorStatistics
from nico_selfmodel.estimation.model_changes import links_of, parameter_changes
from nico_selfmodel.estimation.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.verdict import Verdict
from nico_selfmodel.estimation.workspace_accuracy import WorkspaceAccuracy, workspace_accuracy
from nico_selfmodel.model.self_model import SelfModel


def body_document(calibration: BodyCalibration, verdict: Verdict) -> dict[str, Any]:
    """Return the content of `result.json`; numbers that do not exist are null.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.

    Returns:
        A mapping of plain Python values.
    """
    outliers = calibration.train.observations.arm.sample[calibration.outliers]
    return {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "warnings": list(verdict.warnings),
        "method": "body",
        "stage": calibration.options.stage,
        "variant": calibration.options.variant,
        "start": {"model": calibration.start.name, "arm": calibration.start_label},
        "train": pixel_block(calibration.train, ~calibration.outliers),
        "test": pixel_block(calibration.test),
        "cross_validation": pixel_block(calibration.cross_validation),
        "before": _before(calibration),
        "parameters": body_parameters(calibration),
        "not_identifiable": [describe_blind(d) for d in calibration.uncertainty.blind],
        "scale_from": calibration.scale_from,
        "outliers": sorted(set(outliers.tolist())),
        "pixel_sigma_px": calibration.noise.sensor_sigma,
        "joint_sigma_deg": float(np.degrees(calibration.noise.joint_sigma)),
        "noise_known_to": _noise_known_to(calibration),
        "corner_sigma_px": calibration.corner_sigma,
        "noise_sigma_mm": None
        if calibration.model.noise_sigma is None
        else 1e3 * calibration.model.noise_sigma,
        "boards": _boards(calibration),
        "board_outliers": int(calibration.board_outliers.sum()),
        "workspace": _workspace(calibration),
        "seconds": calibration.seconds,
        "iterations": calibration.iterations,
        "converged": calibration.converged,
    }


def refinement_block(
    before: PixelEvaluation, calibration: BodyCalibration | None, verdict: Verdict
) -> dict[str, Any]:
    """Return what the refinement of a known body did, whether it is kept or not.

    Args:
        before: The body before it, on held-out data.
        calibration: What was learned; None where that came to no end.
        verdict: What is thought of it.
    """
    refused = verdict.status == "FAIL"
    return {
        "accepted": not refused,
        "reasons": list(verdict.reasons) if refused else [],
        "kept": "arm learned after the eyes" if refused else "arm and eyes refined together",
        "before": pixel_block(before),
        "after": None if calibration is None else pixel_block(calibration.test),
        "boards": None if calibration is None else _boards(calibration),
    }


def body_parameters(calibration: BodyCalibration) -> dict[str, Mapping[str, Any]]:
    """Return every parameter with value, sigma, unit and whether it was free; derived ones last."""
    uncertainty = calibration.uncertainty
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    table = model_parameters(calibration.model, sigma)
    # |p_LR|: its slope by the position is its direction.
    rig = calibration.model.rig
    slope = np.zeros(len(uncertainty.names))
    for axis, share in zip("xyz", rig.X_LR[:3, 3] / rig.baseline, strict=True):
        slope[np.array(uncertainty.names) == f"right.pose.{axis}"] = share
    spread = float(np.sqrt(slope @ uncertainty.covariance @ slope))
    table["baseline"] = {"value": rig.baseline, "sigma": spread, "unit": "m", "free": False}
    for name, length in links_of(calibration.model):
        table[name] = {"value": length, "sigma": None, "unit": "m", "free": False}
    return table


def model_parameters(model: SelfModel, sigma: Mapping[str, float]) -> dict[str, Mapping[str, Any]]:
    """Return the parameters of arm and eyes.

    Args:
        model: The self-model.
        sigma: Standard deviations of those that were free.
    """
    arm, rig = model.parameters, model.rig
    names, units = (*arm.names, *rig.names), (*arm.units, *rig.units)
    values = np.concatenate([arm.values, rig.values]).tolist()
    table: dict[str, Mapping[str, Any]] = {}
    for name, value, unit in zip(names, values, units, strict=True):
        free = name in sigma
        if not free and name.endswith(".beta") and value == 0.0:
            continue  # an ordinary row has no second twist
        known = _finite(sigma[name]) if free else 0.0
        table[name] = {"value": value, "sigma": known, "unit": unit, "free": free}
    return table


def pixel_block(
    evaluation: PixelEvaluation | None, believed: NDArray | None = None
) -> dict[str, Any] | None:
    """Return errors in the images and against the eyes' own reconstruction.

    Args:
        evaluation: Predictions beside what was seen.
        believed: Rows to take; all if omitted. Shape (N,).
    """
    if evaluation is None:
        return None
    if believed is not None:
        evaluation = evaluation.select(believed)
    pixels, points = evaluation.pixel_statistics, evaluation.statistics
    if pixels is None:
        return None
    names = ("mean", "sd", "rms", "median", "p95", "max")
    block: dict[str, Any] = {
        "n": len(evaluation.observations),
        "poses": evaluation.pose_count,
        "pixels": {name: getattr(pixels, name) for name in names},
    }
    if points is not None:
        block["position_mm"] = points.as_mm()
    return block


def _noise_known_to(calibration: BodyCalibration) -> dict[str, float | None]:
    """Return the standard deviations of both noises' estimates; null where the data do not tell."""
    sensor, joint = calibration.noise_sigmas
    return {
        "pixel_sigma_px": _finite(sensor),
        "joint_sigma_deg": _finite(float(np.degrees(joint))),
    }


def noise_words(document: Mapping[str, Any]) -> tuple[str, str]:
    """Return tracker noise and joint play of a document in words, with their error bars."""
    words = []
    for name, unit in (("pixel_sigma_px", "px"), ("joint_sigma_deg", "deg")):
        known = document["noise_known_to"][name]
        bar = "" if known is None else f" +- {known:.2f}"
        words.append(f"{document[name]:.2f}{bar} {unit}")
    return words[0], words[1]


def _before(calibration: BodyCalibration) -> dict[str, Any]:
    """Return how the start fared on the same data, and how far its parameters moved."""
    start, model = calibration.start, calibration.model
    shown = [*body_parameters(calibration)]
    return {
        "model": start.name,
        "on": "train" if calibration.test is None else "test",
        **(pixel_block(calibration.before) or {"n": 0}),
        "changes": parameter_changes(start, model, shown),
    }


def _boards(calibration: BodyCalibration) -> dict[str, Any] | None:
    check = calibration.boards
    if check is None:
        return None
    return {
        "held_out": check.held_out,
        "before": _rebuilt(check.before),
        "after": None if check.after is None else _rebuilt(check.after),
    }


def _rebuilt(found: Reconstruction) -> dict[str, Any]:
    statistics = ErrorStatistics.from_distances(found.errors.ravel())
    return {
        "boards": len(found.views),
        "edge_mm": {"true": 1e3 * found.square, "mean": 1e3 * float(found.edges.mean())}
        | {"sd": 1e3 * found.edge_sd},
        "scale": {"mean": float(found.scale.mean()), "sd": float(found.scale.std())},
        "position_mm": statistics.as_mm(),
    }


def _workspace(calibration: BodyCalibration) -> dict[str, Any]:
    """Return how surely the hand is known at the training poses, and what would cure the rest."""
    arm = calibration.train.observations.arm
    readings = arm.angles / calibration.model.servos.radians_per_unit
    return accuracy_block(workspace_accuracy(calibration.model, readings))


def accuracy_block(found: WorkspaceAccuracy) -> dict[str, Any]:
    """Return the mean, and the largest value, of each part of a hand's uncertainty.

    Args:
        found: Figures at poses.
    """
    parts = {"learned_mm": found.learned, "mechanics_mm": found.mechanics, "total_mm": found.total}
    block: dict[str, Any] = {
        name: {"mean": 1e3 * float(part.mean()), "max": 1e3 * float(part.max())}
        for name, part in parts.items()
    }
    for name, part in (("learned_px", found.learned_px), ("mechanics_px", found.mechanics_px)):
        if part is not None and np.isfinite(part).any():
            block[name] = {"mean": float(np.nanmean(part)), "max": float(np.nanmax(part))}
    return {"poses": len(found.total), "curable_share": found.curable, **block}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
