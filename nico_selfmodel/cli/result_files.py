"""What a command that learns leaves behind: a result folder with its report."""

import shlex
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from nico_selfmodel import __version__
from nico_selfmodel.cli.option_groups import Bounds, NamedOutput, Output
from nico_selfmodel.progress import Progress, telling_nobody

if TYPE_CHECKING:
    from nico_selfmodel.estimation.judging import Calibration
    from nico_selfmodel.estimation.results.verdict import Verdict
    from nico_selfmodel.model.response.servo_response import ServoResponses
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.model.tree.body_model import BodyModel
    from nico_selfmodel.viz.reports.page import Report

NO_BOUNDS = Bounds()
"""Where the user gave none."""


def command_line() -> str:
    """Return the words that this process was started with."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def stamped(document: Mapping[str, Any], command: str | None = None) -> dict[str, Any]:
    """Return the content of a `result.json` with `run`: when it was made, by which command.

    What must be the same to the byte for the same data, `self_model.yaml`, holds none of it.

    Args:
        document: `estimation.judging.to_json` of what was learned.
        command: The command line; this process' own if omitted.
    """
    words = command_line() if command is None else command
    date = datetime.now(UTC).isoformat(timespec="seconds")
    return {**document, "run": {"date": date, "command": words, "version": __version__}}


def judge_and_write(
    found: "Calibration",
    model: "SelfModel | BodyModel | ServoResponses",
    draw: "Callable[[dict[str, Any]], Report]",
    output: Output,
    progress: Progress = telling_nobody,
    *,
    bounds: Bounds = NO_BOUNDS,
    verdict: "Verdict | None" = None,
    command: str | None = None,
    more: Mapping[str, Any] = MappingProxyType({}),
    **beside: Any,
) -> dict[str, Any]:
    """Judge what a command has learned, and leave its folder.

    Args:
        draw: Returns the report of a `result.json`; not called where none is wanted: drawing takes
            longer than most calibrations.
        output: Where to, and whether with a report.
        progress: Told that writing begins and ends.
        bounds: Held-out errors above which it fails.
        verdict: What is thought of it, where that is known already.
        command: The command line; this process' own if omitted.
        more: What the command itself adds to `result.json`.
        beside: What else is kept: `robot`, `recordings`, `shape` of `write_result`.

    Returns:
        The content of `result.json`.

    Raises:
        FileExistsError, OSError, ModelError, SelfModelError: As `write_with_report`.
    """
    from nico_selfmodel.estimation.judging import judge, result_of, to_json
    from nico_selfmodel.result_folder.writing import write_result

    result = result_of(found)
    verdict = verdict or judge(result, bounds.require_test_mm, bounds.require_test_px)
    document = {**stamped(to_json(result, verdict), command), **more}
    progress("writing the result", 0, 1)
    if isinstance(output, NamedOutput) and output.no_report:
        write_result(output.out, model, document, force=output.force, **beside)
    else:
        write_with_report(output.out, model, draw(document), force=output.force, **beside)
    progress("writing the result", 1, 1)
    return document


def write_with_report(
    out: Path, model: "SelfModel | BodyModel | ServoResponses", report: "Report", **beside: Any
) -> None:
    """Write a result folder with its report and scene, or nothing.

    Args:
        out: The folder to make.
        report: With the content of `result.json`.
        beside: What else is kept, and whether by `force`, see `write_result`.

    Raises:
        SelfModelError: If Drake's page for scenes is not one that is known; else as `write_result`.
    """
    from nico_selfmodel.result_folder.writing import write_result

    write_result(out, model, report.document, report.files(), **beside)
