"""A calibration as plain data: what goes into `result.json`, once for all of them."""

from typing import Any

from nico_selfmodel.estimation.results.calibration_result import CalibrationResult, Errors
from nico_selfmodel.estimation.results.verdict import Verdict


def document_of(result: CalibrationResult, verdict: Verdict) -> dict[str, Any]:
    """Return the content of `result.json`; numbers that do not exist are null.

    Args:
        result: What was learned.
        verdict: What is thought of it.

    Returns:
        A mapping of plain Python values.
    """
    return {
        "status": verdict.status,
        "reasons": list(verdict.reasons),
        "warnings": list(verdict.warnings),
        "method": result.method,
        "train": _block(result.train),
        "test": _block(result.test),
        "cross_validation": _block(result.cross_validation),
        "parameters": {name: known.to_json() for name, known in result.parameters.items()},
        "not_identifiable": list(result.unobservable),
        "outliers": list(result.outlier_names),
        **result.details,
        "seconds": result.seconds,
        "iterations": result.iterations,
        "converged": result.converged,
    }


def _block(errors: Errors | None) -> dict[str, Any] | None:
    return None if errors is None else errors.to_json()
