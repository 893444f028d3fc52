"""Tools, new zeros and what a monitor learned anew, as results of calibrations."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.monitoring.block_update import BlockUpdate
from nico_selfmodel.estimation.monitoring.tool import Rezeroing, ToolCalibration
from nico_selfmodel.estimation.monitoring.update_evaluation import UpdateEvaluation
from nico_selfmodel.estimation.results.calibration_result import (
    FAILURE,
    NOTE,
    CalibrationResult,
    Errors,
    Finding,
    Parameter,
    Terms,
    findings,
)
from nico_selfmodel.estimation.results.model_changes import parameter_changes
from nico_selfmodel.model.self_model import SelfModel

OUTLIER_CAUSE = "were other things taken for the hand, or did the body change in between?"
"""What many outliers of few poses hint at."""


def tool_result(
    calibration: ToolCalibration, evaluation: UpdateEvaluation | None = None
) -> CalibrationResult:
    """Return a tool with all that it is judged by and that is written down of it.

    Args:
        evaluation: What it was worth, if that was asked.
    """
    sensor, test = calibration.sensor, calibration.test
    said = []
    if test is not None:
        scale, unit = (1e3, "mm") if sensor == "points" else (1.0, "px")
        said = [f"{scale * test.mean():.2f} {unit} mean error on held-out observations"]
    result = _result(
        "tool",
        calibration.update,
        calibration.model,
        [*findings(FAILURE, calibration.reasons), *findings(NOTE, said)],
        Terms(outlier_cause=OUTLIER_CAUSE),
        calibration.seconds,
    )
    details = {
        "tool": calibration.tool,
        "known": calibration.known,
        "reach_mm": {"value": 1e3 * calibration.reach, "sigma": 1e3 * calibration.reach_sigma},
    }
    held_out = None
    if test is not None:
        held_out = replace(_update_errors(test, sensor), poses=calibration.test_poses)
    trained = _update_errors(calibration.train, sensor)
    result = replace(result, train=trained, test=held_out)
    return _evaluated(result, details, evaluation)


def rezero_result(
    found: Rezeroing, evaluation: UpdateEvaluation | None = None
) -> CalibrationResult:
    """Return new zeros with all that they are judged by and that is written down of them.

    Args:
        evaluation: What it was worth, if that was asked.
    """
    shifts = np.degrees(found.shifts).tolist()
    details = {"shift_deg": dict(zip(found.model.joints, shifts, strict=True))}
    return _evaluated(_of_update("rezero", found.update, found.seconds), details, evaluation)


def relearned_result(
    update: BlockUpdate, cause: str, evaluation: UpdateEvaluation | None = None
) -> CalibrationResult:
    """Return what a monitor learned anew with all that it is judged by and that is written down.

    Args:
        cause: What had changed, in words.
        evaluation: What it was worth, if that was asked.
    """
    return _evaluated(_of_update("relearn", update, None), {"cause": cause}, evaluation)


def _update_errors(errors: NDArray, sensor: str) -> Errors:
    """Return errors in the images [px], or in space [m]. Shape (n,)."""
    return Errors(position=errors) if sensor == "points" else Errors(pixels=errors, unit="px")


def _of_update(method: str, update: BlockUpdate, seconds: float | None) -> CalibrationResult:
    """Return parameters that were learned anew from few poses, which all take part."""
    words = update.misfit_words
    broken = (
        None if update.fits else f"the rest of the body no longer fits ({words}): run `monitor`"
    )
    terms = Terms(outlier_cause=OUTLIER_CAUSE, untested=f"the rest of the body fits ({words})")
    return _result(method, update, update.model, findings(FAILURE, [broken]), terms, seconds)


def _result(
    method: str,
    update: BlockUpdate,
    model: SelfModel,
    found: list[Finding],
    terms: Terms,
    seconds: float | None,
) -> CalibrationResult:
    return CalibrationResult(
        method=method,
        parameters=_parameters(model, update.learned),
        outliers=update.outliers,
        outlier_names=tuple(np.flatnonzero(update.outliers).tolist()),
        converged=update.converged,
        iterations=update.iterations,
        seconds=seconds,
        findings=tuple(found),
        details={
            "misfit": {"value": update.misfit, "expected": update.expected},
            "body_fits": update.fits,
        },
        terms=terms,
    )


def _evaluated(
    result: CalibrationResult, details: Mapping[str, Any], evaluation: UpdateEvaluation | None
) -> CalibrationResult:
    """Return a result with further details, and with errors before and after where known."""
    details = {**result.details, **details, **_worth(evaluation)}
    if evaluation is None:
        return replace(result, details=details)
    sensor, crossed = evaluation.sensor, evaluation.cross_validation
    after = {name: _update_errors(p[1].errors, sensor) for name, p in evaluation.held.items()}
    test = after.get("test", result.test)
    if test is not None and result.test is not None:
        test = replace(test, poses=result.test.poses)
    return replace(
        result,
        train=after.get("train", result.train),
        test=test,
        cross_validation=None if crossed is None else _update_errors(crossed, sensor),
        details=details,
    )


def _worth(evaluation: UpdateEvaluation | None) -> dict[str, Any]:
    """Return errors before and after, and what moved by how much."""
    if evaluation is None:
        return {}
    sensor, held = evaluation.sensor, evaluation.held
    return {
        "before": {name: _update_errors(p[0].errors, sensor).to_json() for name, p in held.items()},
        "changes": parameter_changes(
            evaluation.before, evaluation.after, evaluation.update.learned
        ),
    }


def _parameters(model: SelfModel, learned: tuple[str, ...]) -> dict[str, Parameter]:
    """Return the parameters that were learned, with what they are uncertain by in all."""
    values = dict(zip(model.parameters.names, model.parameters.values.tolist(), strict=True))
    units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    if len(model.cameras) == 2:
        values |= dict(zip(model.rig.names, model.rig.values.tolist(), strict=True))
        units |= dict(zip(model.rig.names, model.rig.units, strict=True))
    covariance = model.covariance
    assert covariance is not None
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    return {name: Parameter(values[name], sigma[name], units[name], free=True) for name in learned}
