"""Arm and cameras refined together as the result of a calibration."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from nico_selfmodel.estimation.arm.arm_findings import WHAT_CHANGED
from nico_selfmodel.estimation.bending.what_bends import bending_json
from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.body.body_findings import body_findings
from nico_selfmodel.estimation.body.workspace_accuracy import WorkspaceAccuracy
from nico_selfmodel.estimation.cameras.camera_result import rebuilt_block
from nico_selfmodel.estimation.cameras.pair_checks import baseline
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.results.calibration_result import (
    CalibrationResult,
    Errors,
    Parameter,
    Terms,
    finite,
    parameter_table,
)
from nico_selfmodel.estimation.results.model_changes import links_of, parameter_changes
from nico_selfmodel.estimation.results.unobservable_words import describe_unobservable
from nico_selfmodel.estimation.results.verdict import Verdict

_TERMS = Terms(
    outlier_cause="arm, cameras, or what was recorded are not what the data set says",
    worse_cause=WHAT_CHANGED,
    decisive="mm",
)


def body_result(calibration: BodyCalibration) -> CalibrationResult:
    """Return a body with all that it is judged by and that is written down of it."""
    outliers, crossed = calibration.outliers, calibration.cross_validation
    samples = calibration.train.observations.arm.sample[outliers]
    return CalibrationResult(
        method="body",
        parameters=_body_parameters(calibration),
        train=pixel_errors(calibration.train.select(~outliers)),
        test=None if calibration.test is None else pixel_errors(calibration.test),
        cross_validation=None if crossed is None else pixel_errors(crossed),
        outliers=outliers,
        outlier_names=tuple(sorted(set(samples.tolist()))),
        unobservable=tuple(
            describe_unobservable(direction) for direction in calibration.uncertainty.unobservable
        ),
        converged=calibration.converged,
        iterations=calibration.iterations,
        seconds=calibration.seconds,
        findings=body_findings(calibration),
        details=_details(calibration),
        terms=_TERMS,
    )


def pixel_errors(evaluation: PixelEvaluation) -> Errors:
    """Return errors in the images and against the cameras' own reconstruction."""
    return Errors(
        evaluation.distances,
        evaluation.pixel_distances,
        len(evaluation.observations),
        evaluation.pose_count,
        evaluation.pixels_by_pose,
        "px",
    )


def _details(calibration: BodyCalibration) -> dict[str, Any]:
    noise = calibration.noise
    return {
        "stage": calibration.options.stage,
        "variant": calibration.options.variant,
        "start": {"model": calibration.start.name, "arm": calibration.start_label},
        "before": _before(calibration),
        "scale_from": calibration.scale_from,
        "pixel_sigma_px": noise.sensor_sigma,
        "joint_sigma_deg": float(np.degrees(noise.joint_sigma)),
        "noise_known_to": _noise_known_to(calibration),
        "corner_sigma_px": calibration.corner_sigma,
        "noise_sigma_mm": finite(calibration.model.noise_sigma, 1e3),
        "boards": _boards(calibration),
        "board_outliers": int(calibration.board_outliers.sum()),
        "workspace": _accuracy_block(calibration.workspace),
        "bending": bending_json(
            calibration.ladder,
            calibration.model.bending,
            calibration.at,
            calibration.model.joints,
        ),
    }


def refinement_block(
    before: PixelEvaluation, calibration: BodyCalibration | None, verdict: Verdict
) -> dict[str, Any]:
    """Return what the refinement of a known body did, whether it is kept or not.

    Args:
        before: The body before it, on held-out data.
        calibration: What was learned; None where that came to no end.
    """
    test = None if calibration is None else calibration.test
    refused = verdict.status == "FAIL"
    return {
        "accepted": not refused,
        "reasons": list(verdict.reasons) if refused else [],
        "kept": "arm learned after the cameras" if refused else "arm and cameras refined together",
        "before": pixel_errors(before).to_json(),
        "after": None if test is None else pixel_errors(test).to_json(),
        "boards": None if calibration is None else _boards(calibration),
    }


def _body_parameters(calibration: BodyCalibration) -> dict[str, Parameter]:
    """Return every parameter of arm and cameras; the derived baseline and lengths last."""
    uncertainty, model = calibration.uncertainty, calibration.model
    arm, rig = model.parameters, model.rig
    sigma = dict(zip(uncertainty.names, uncertainty.sigma.tolist(), strict=True))
    values = np.concatenate([arm.values, rig.values])
    names, units = (*arm.names, *rig.names), (*arm.units, *rig.units)
    table = parameter_table(names, values, units, sigma)
    table["baseline"] = baseline(rig.X_LR[:3, 3], uncertainty)
    return table | {name: Parameter(length, None, "m") for name, length in links_of(model)}


def _noise_known_to(calibration: BodyCalibration) -> dict[str, float | None]:
    """Return the standard deviations of both noises' estimates; null where the data do not tell."""
    sensor, joint = calibration.noise_sigmas
    return {
        "pixel_sigma_px": finite(sensor),
        "joint_sigma_deg": finite(float(np.degrees(joint))),
    }


def noise_words(document: Mapping[str, Any]) -> tuple[str, str]:
    """Return tracker noise and joint noise of a document in words, with their error bars."""
    words = []
    for name, unit in (("pixel_sigma_px", "px"), ("joint_sigma_deg", "deg")):
        known = document["noise_known_to"][name]
        bar = "" if known is None else f" +- {known:.1g}"
        words.append(f"{document[name]:.3g}{bar} {unit}")
    return words[0], words[1]


def _before(calibration: BodyCalibration) -> dict[str, Any]:
    """Return how the start fared on the same data, and how far its parameters moved."""
    start, model = calibration.start, calibration.model
    shown = [*_body_parameters(calibration)]
    return {
        "model": start.name,
        "on": "train" if calibration.test is None else "test",
        **(pixel_errors(calibration.before).to_json() or {"n": 0}),
        "changes": parameter_changes(start, model, shown),
    }


def _boards(calibration: BodyCalibration) -> dict[str, Any] | None:
    check = calibration.boards
    if check is None:
        return None
    return {
        "held_out": check.held_out,
        "before": rebuilt_block(check.before),
        "after": None if check.after is None else rebuilt_block(check.after),
    }


def _accuracy_block(found: WorkspaceAccuracy) -> dict[str, Any]:
    """Return the mean, and the largest value, of each part of a hand's uncertainty."""
    parts = {"learned_mm": found.learned, "mechanics_mm": found.mechanics, "total_mm": found.total}
    block: dict[str, Any] = {
        name: {"mean": 1e3 * float(part.mean()), "max": 1e3 * float(part.max())}
        for name, part in parts.items()
    }
    for name, part in (("learned_px", found.learned_px), ("mechanics_px", found.mechanics_px)):
        if part is not None and np.isfinite(part).any():
            block[name] = {"mean": float(np.nanmean(part)), "max": float(np.nanmax(part))}
    return {"poses": len(found.total), "curable_share": found.curable, **block}
