"""Tools, new zeros and health as plain data: what goes into `result.json`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.block_update import BlockUpdate
from nico_selfmodel.estimation.error_statistics import ErrorStatistics
from nico_selfmodel.estimation.health import HealthReport
from nico_selfmodel.estimation.model_changes import parameter_changes
from nico_selfmodel.estimation.tool import Rezeroing, ToolCalibration
from nico_selfmodel.estimation.update_evaluation import UpdateEvaluation
from nico_selfmodel.estimation.verdict import Verdict
from nico_selfmodel.model.self_model import SelfModel

_CAUSES_SHOWN = 5


def judge_tool(calibration: ToolCalibration) -> Verdict:
    """Judge a tool: FAIL where something speaks against it, PASS where it was held out."""
    if calibration.reasons:
        return Verdict("FAIL", calibration.reasons)
    if calibration.test is None:
        return Verdict("NOT_EVALUATED", ("nothing was held out: give --test or --test-fraction",))
    mean, unit = _mean(calibration.test, calibration.sensor)
    return Verdict("PASS", (f"{mean:.2f} {unit} mean error on held-out sightings",))


def judge_update(update: BlockUpdate) -> Verdict:
    """Judge parameters learned anew: FAIL where the rest of the body no longer fits."""
    if not update.converged:
        return Verdict("FAIL", ("the solver stopped without reaching a minimum",))
    words = f"misfit {update.misfit:.0f}, {update.expected:.0f} was to be expected"
    if update.fits:
        return Verdict("NOT_EVALUATED", (f"the rest of the body fits ({words})",))
    return Verdict("FAIL", (f"the rest of the body no longer fits ({words}): run `monitor`",))


def tool_document(
    calibration: ToolCalibration, verdict: Verdict, evaluation: UpdateEvaluation | None = None
) -> dict[str, Any]:
    """Return the content of a tool's `result.json`.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.
        evaluation: What it was worth, if that was asked.
    """
    return {
        **_document("tool", calibration.update, verdict, calibration.model),
        "tool": calibration.tool,
        "known": calibration.known,
        "reach_mm": {
            "value": 1e3 * calibration.reach,
            "sigma": 1e3 * calibration.reach_sigma,
        },
        "train": _errors(calibration.train, calibration.sensor),
        "test": None if calibration.test is None else _errors(calibration.test, calibration.sensor),
        "seconds": calibration.seconds,
        **_worth(evaluation),
    }


def rezero_document(
    found: Rezeroing, verdict: Verdict, evaluation: UpdateEvaluation | None = None
) -> dict[str, Any]:
    """Return the content of the `result.json` of new zeros.

    Args:
        found: What was found.
        verdict: What is thought of it.
        evaluation: What it was worth, if that was asked.
    """
    shifts = np.degrees(found.shifts).tolist()
    return {
        **_document("rezero", found.update, verdict, found.model),
        "shift_deg": dict(zip(found.model.joints, shifts, strict=True)),
        "train": None,
        "test": None,
        "seconds": found.seconds,
        **_worth(evaluation),
    }


def relearned_document(
    update: BlockUpdate, cause: str, verdict: Verdict, evaluation: UpdateEvaluation | None = None
) -> dict[str, Any]:
    """Return the content of the `result.json` of what `monitor` learned anew.

    Args:
        update: What was learned.
        cause: What had changed, in words.
        verdict: What is thought of it.
        evaluation: What it was worth, if that was asked.
    """
    document = _document("relearn", update, verdict, update.model)
    document |= {"cause": cause, "train": None, "test": None, "seconds": None}
    return document | _worth(evaluation)


def health_document(report: HealthReport) -> dict[str, Any]:
    """Return a health report as plain data; `status` is FAIL where something changed."""
    chance = report.false_alarm_chance
    reasons = [
        f"{len(report.nis)} poses fit what is known of the body; with noise as in the "
        f"{report.noise.poses} poses that it was learned from, at most {100.0 * chance:.2g} % of "
        "such recordings raise a false alarm"
    ]
    if report.alarm_at is not None and report.changed_at is not None:
        best = report.diagnoses[0]
        reasons = [
            f"something changed at sample {int(report.sample[report.changed_at])}, seen at sample "
            f"{int(report.sample[report.alarm_at])}: {best.hypothesis.cause} (likelihood ratio "
            f"{best.statistic:.0f}, chi-square of {best.dof})"
        ]
        if not report.sure:
            reasons.append("few poses since: the cause may be another, record 10 or more")
    return {
        "status": "PASS" if report.healthy else "FAIL",
        "reasons": reasons,
        "poses": len(report.nis),
        "nis_per_coordinate": float(report.nis.sum() / report.dof.sum()),
        "log_ratio": {"largest": float(report.log_ratio.max()), "threshold": report.threshold},
        "false_alarm_chance": chance,
        "changed_at": _sample(report, report.changed_at),
        "alarm_at": _sample(report, report.alarm_at),
        "causes": [
            {
                "cause": found.hypothesis.cause,
                "statistic": found.statistic,
                "dof": found.dof,
                "score": float(found.score),
                "parameters": list(found.hypothesis.names),
            }
            for found in report.diagnoses[:_CAUSES_SHOWN]
        ],
    }


def _document(
    method: str, update: BlockUpdate, verdict: Verdict, model: SelfModel
) -> dict[str, Any]:
    return {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "method": method,
        "cross_validation": None,
        "parameters": _parameters(model, update.learned),
        "not_identifiable": [],
        "outliers": np.flatnonzero(update.outliers).tolist(),
        "misfit": {"value": update.misfit, "expected": update.expected},
        "body_fits": update.fits,
        "iterations": update.iterations,
        "converged": update.converged,
    }


def _worth(evaluation: UpdateEvaluation | None) -> dict[str, Any]:
    """Return errors before and after, and what moved by how much."""
    if evaluation is None:
        return {}
    sensor, held = evaluation.sensor, evaluation.held
    crossed = evaluation.cross_validation
    return {
        "before": {name: _errors(pair[0].errors, sensor) for name, pair in held.items()},
        **{name: _errors(pair[1].errors, sensor) for name, pair in held.items()},
        "cross_validation": None if crossed is None else _errors(crossed, sensor),
        "changes": parameter_changes(
            evaluation.before, evaluation.after, evaluation.update.learned
        ),
    }


def _parameters(model: SelfModel, learned: tuple[str, ...]) -> dict[str, Mapping[str, Any]]:
    """Return the parameters that were learned, with what they are uncertain by in all."""
    values = dict(zip(model.parameters.names, model.parameters.values.tolist(), strict=True))
    units = dict(zip(model.parameters.names, model.parameters.units, strict=True))
    if len(model.cameras) == 2:
        values |= dict(zip(model.rig.names, model.rig.values.tolist(), strict=True))
        units |= dict(zip(model.rig.names, model.rig.units, strict=True))
    covariance = model.covariance
    assert covariance is not None
    sigma = dict(zip(covariance.names, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    return {
        name: {"value": values[name], "sigma": sigma[name], "unit": units[name], "free": True}
        for name in learned
    }


def _errors(errors: NDArray, sensor: str) -> dict[str, Any]:
    statistics = ErrorStatistics.from_distances(errors)
    if sensor == "points":
        return {"n": statistics.n, "position_mm": statistics.as_mm()}
    names = ("mean", "sd", "rms", "median", "p95", "max")
    return {"n": statistics.n, "pixels": {name: getattr(statistics, name) for name in names}}


def _mean(errors: NDArray, sensor: str) -> tuple[float, str]:
    scale, unit = (1e3, "mm") if sensor == "points" else (1.0, "px")
    return scale * float(errors.mean()), unit


def _sample(report: HealthReport, row: int | None) -> int | None:
    return None if row is None else int(report.sample[row])
