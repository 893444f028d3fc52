"""A stage of the mirror test as plain data: what became of it, and why."""

from collections.abc import Sequence
from typing import Any

from nico_selfmodel.estimation.results.calibration_result import finite


def stage_document(
    stage: str, name: str, failed: Sequence[str], lacking: str | None, passed: str, **facts: Any
) -> dict[str, Any]:
    """Return a stage as plain data, with its status: what failed counts before what lacks.

    Args:
        stage: Its number.
        name: What it is about.
        failed: Why it fails; nothing where it does not.
        lacking: What a verdict would take besides; None where there is enough.
        passed: What is said where nothing failed and nothing lacks.
        facts: What else is told, in this order.
    """
    if failed:
        status, reasons = "FAIL", [*failed]
    elif lacking is not None:
        status, reasons = "NOT_EVALUATED", [lacking]
    else:
        status, reasons = "PASS", [passed]
    return {"stage": stage, "name": name, "status": status, "reasons": reasons, **facts}


def as_json(value: Any) -> Any:
    """Return plain data whose numbers that do not exist, nan or infinite, are None."""
    if isinstance(value, dict):
        return {key: as_json(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(one) for one in value]
    return finite(value) if isinstance(value, float) else value
