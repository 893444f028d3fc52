"""What a command that learns leaves behind: a result folder with its report."""

import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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


def judged_document(
    found: "Calibration",
    bounds: Bounds = NO_BOUNDS,
    command: str | None = None,
    verdict: "Verdict | None" = None,
) -> dict[str, Any]:
    """Return the content of `result.json` of what a command learned, judged.

    Args:
        found: What was learned.
        bounds: Held-out errors above which it fails.
        command: The command line; this process' own if omitted.
        verdict: What is thought of it, where that is known already.
    """
    from nico_selfmodel.estimation.judging import judge, result_of, to_json

    result = result_of(found)
    verdict = verdict or judge(result, bounds.require_test_mm, bounds.require_test_px)
    return stamped(to_json(result, verdict), command)


@dataclass(frozen=True, eq=False)
class NoReport:
    """In place of a report where none is wanted: drawing takes longer than most calibrations."""

    document: Mapping[str, Any]
    """Content of `result.json`."""

    def files(self) -> dict[str, str]:
        """Return no files."""
        return {}


def judge_and_write(
    found: "Calibration",
    model: "SelfModel | BodyModel",
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
        found: What was learned.
        model: The self-model of it.
        draw: Returns the report of a `result.json`; drawing is slow to load, and is not called
            where no report is wanted.
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
    document = {**judged_document(found, bounds, command, verdict), **more}
    progress("writing the result", 0, 1)
    unseen = isinstance(output, NamedOutput) and output.no_report
    report = NoReport(document) if unseen else draw(document)
    write_with_report(output.out, model, report, force=output.force, **beside)
    progress("writing the result", 1, 1)
    return document


def write_with_report(
    out: Path, model: "SelfModel | BodyModel", report: "Report | NoReport", **beside: Any
) -> None:
    """Write a result folder with its report and scene, or nothing.

    Args:
        out: The folder to make.
        model: The self-model.
        report: With the content of `result.json`.
        beside: What else is kept, and whether by `force`, see `write_result`.

    Raises:
        SelfModelError: If Drake's page for scenes is not one that is known; else as `write_result`.
    """
    from nico_selfmodel.result_folder.writing import write_result

    write_result(out, model, report.document, report.files(), **beside)
