"""What commands print: tables, results with their verdict, progress."""

import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from nico_selfmodel.cli.result_facts import derived_rows, fact_rows
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from rich.console import Console

    from nico_selfmodel.cli.option_groups import Output
    from nico_selfmodel.dataset.body.body_dataset import BodyDataset
    from nico_selfmodel.dataset.dataset import Dataset

_WIDEST = 400
"""Width that a table may have where nobody looks at it on a terminal [characters]."""
_MOST_PARAMETERS = 30
"""More of them are read in the report."""
_COLOURS = {"PASS": "green", "FAIL": "red", "NOT_EVALUATED": "yellow"}
_STATISTICS = ("mean", "SD", "rms", "median", "max")
_PARTS = (
    ("held out", "test"),
    ("cross-validated", "cross_validation"),
    ("training", "train"),
    ("epipolar", "epipolar_px"),
)

Block = Mapping[str, Any] | None
"""Errors as in `result.json`: `n`, `position_mm`, `pixels`, `angle_deg`; None for none."""


class Talk(IntEnum):
    """How much is said."""

    QUIET = 0
    """Errors, warnings and why something failed; what was asked for as output."""
    PLAIN = 1
    """And results, and one line a stage where nobody looks at a progress bar."""
    VERBOSE = 2
    """And how long each stage took; of a bug, where it is."""


talk = Talk.PLAIN


@cache
def _console() -> "Console":
    """Return what prints, which commands that print nothing do not load."""
    from rich.console import Console

    return Console(soft_wrap=True)


def set_talk(how: Talk) -> None:
    """Say more or less from now on."""
    global talk
    talk = how


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Show on standard error how far a job is: by bars, or by lines where that is no terminal."""
    if talk is Talk.QUIET:
        yield lambda what, done, total: None
        return
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal or talk is Talk.VERBOSE:
        yield _line_a_stage()
        return
    # Of all that draws on a terminal this is the slowest to load.
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bars(*columns, console=console) as bars:
        tasks: dict[str, Any] = {}

        def progress(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bars.add_task(what, total=total)
            bars.update(tasks[what], completed=done, total=total)

        yield progress


def _line_a_stage() -> Progress:
    """Return what writes one line when a stage ends."""
    begun: dict[str, float] = {}

    def progress(what: str, done: int, total: int) -> None:
        if begun.setdefault(what, time.monotonic()) < 0.0 or done < total:
            return
        took = time.monotonic() - begun[what]
        begun[what] = -1.0
        count = f", {total} steps" if total > 1 else ""
        more = f" ({took:.1f} s{count})" if talk is Talk.VERBOSE else ""
        print(f"nico-selfmodel: {what}: done{more}", file=sys.stderr, flush=True)

    return progress


def line(text: str, end: str = "\n") -> None:
    """Print a line as it is."""
    if talk is Talk.QUIET:
        return
    _console().print(text, markup=False, end=end)


def dataset(data: "Dataset", made: Path) -> None:
    """Say what lies in a folder of a data set."""
    line(f"{len(data)} rows, {len(data.joints)} joints: {made}")


def body_dataset(data: "BodyDataset", made: Path) -> None:
    """Say what lies in a folder of a recording of any body."""
    line(
        f"{len(data.sample)} poses, {len(data.observations)} observations, "
        f"{len(data.joints)} joints: {made}"
    )


def as_json(document: Mapping[str, Any]) -> None:
    """Write a document to standard output for a script to read."""
    sys.stdout.write(json.dumps(document, indent=1, allow_nan=False) + "\n")


def table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; all but the first column are aligned to the right."""
    if talk is Talk.QUIET:
        return
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table
    from rich.text import Text

    # As Text: in a plain string Rich would take [mm] for markup and drop it.
    made = Table(title=Text(title), title_justify="left", title_style="bold", header_style="dim")
    for index, heading in enumerate(headings):
        side = "left" if index == 0 else "right"
        made.add_column(Text(heading), justify=side, overflow="fold")
    for row in rows:
        made.add_row(*map(Text, row))
    console = _console()
    if console.is_terminal:
        console.print(made)
        return
    # A file or a pipe is as wide as the table.
    wide = Console(file=console.file, width=_WIDEST)
    wide.width = max(console.width, Measurement.get(wide, wide.options, made).maximum)
    wide.print(made)


def errors(title: str, parts: Sequence[tuple[str, Block]]) -> None:
    """Print how far predictions are off, in space and in images, as each part has it."""
    rows = []
    for label, block in parts:
        known = [(key, unit) for key, unit in _QUANTITIES if block and block.get(key)]
        for key, unit in known:
            rows.append([f"{label} [{unit}]", *_statistics(block or {}, key)])
        if not known:
            rows.append([label, *["-"] * (1 + len(_STATISTICS))])
    table(f"{title}: error of the prediction", ("", "n", *_STATISTICS), rows)


_QUANTITIES = (("position_mm", "mm"), ("pixels", "px"), ("angle_deg", "deg"))


def _statistics(block: Mapping[str, Any], key: str) -> list[str]:
    found = block[key]
    values = (found.get(name.lower()) for name in _STATISTICS)
    # A pose has one position error, and a pixel error for each corner or camera.
    count = str(block["n"] if key == "pixels" else block.get("poses", block["n"]))
    return [count, *("-" if value is None else f"{value:#.3g}".rstrip(".") for value in values)]


def parameters(document: Mapping[str, Any], made: Path) -> None:
    """Print what was estimated, with sigmas; of many only what follows, and where they are."""
    found = document["parameters"]
    rows = [_parameter(name, entry) for name, entry in found.items() if entry["free"]]
    count, derived = len(rows), derived_rows(found)
    if count > _MOST_PARAMETERS:
        rows = []
    if rows or derived:
        rows += [_parameter(name, found[name]) for name in derived]
        table("parameters", ("", "value", "sigma", "unit"), rows)
    if count > _MOST_PARAMETERS:
        where = "report.html" if (made / "report.html").exists() else "result.json"
        line(f"{count} parameters with their sigmas are in {where}")


def _parameter(name: str, entry: Mapping[str, Any]) -> list[str]:
    sigma = "-" if entry["sigma"] is None else f"{entry['sigma']:.2g}"
    return [name, f"{entry['value']:.6g}", sigma, entry["unit"]]


def verdict(document: Mapping[str, Any]) -> None:
    """Print a verdict with its reasons, and after it what is doubtful though nothing fails.

    Of a quiet command, on standard error, why it failed, if it did: nothing else tells.
    """
    status = document["status"]
    if talk is Talk.QUIET:
        if status == "FAIL":
            reasons = "; ".join(document["reasons"])
            print(f"nico-selfmodel: FAIL: {reasons}", file=sys.stderr)
        return
    _console().print(f"[bold {_COLOURS[status]}]{status}[/]")
    for reason in document["reasons"]:
        line(f"  {reason}")
    for warning in document.get("warnings", ()):
        line(f"  note: {warning}")


def folder(made: Path) -> None:
    """Say what lies in a folder that was made, and how to look at it."""
    inside = sorted(made.iterdir())
    line(f"\nresult   {made}/")
    for path in inside:
        line(f"         {path.name}")
    reports = [str(path) for path in (made / "report.html", *made.glob("*/report.html"))
               if path.exists()]  # fmt: skip
    if reports:
        seen = f", or: nico-selfmodel view {made}" if (made / "scene.json").exists() else ""
        line(f"look     open {' and '.join(reports)}{seen}")


def result(
    name: str,
    document: Mapping[str, Any],
    output: "Output",
    *,
    parts: Sequence[tuple[str, Block]] = (),
    more: Sequence[str] = (),
) -> NoReturn:
    """Print what a calibration found, or its document; end the command as its verdict says.

    Args:
        document: What is in its `result.json`.
        output: The result folder, and whether the document is printed instead.
        parts: Rows of errors, where they are others than those of the document.
        more: Lines to print before the verdict.

    Raises:
        typer.Exit: Always, with 1 where the verdict is FAIL, else with 0.
    """
    if output.as_json:
        as_json(document)
        end(document)
    errors(name, parts or [(label, document[key]) for label, key in _PARTS if key in document])
    parameters(document, output.out)
    facts = fact_rows(document)
    if facts:
        table("what else was found", ("", "value"), facts)
    for text in more:
        line(text)
    _outliers(document)
    verdict(document)
    folder(output.out)
    end(document)


def end(document: Mapping[str, Any]) -> NoReturn:
    """End the command as the verdict of a document says."""
    raise typer.Exit(1 if document["status"] == "FAIL" else 0)


def _outliers(document: Mapping[str, Any]) -> None:
    outliers = document["outliers"]
    if not outliers:
        return
    if "detection" in document:
        files = document["detection"]["files"].values()
        boards = (" and ".join(names[view] for names in files) for view in outliers)
        line(f"boards set aside as outliers: {'; '.join(boards)}")
    else:
        what = "steps" if document["method"] == "servos" else "poses with outliers"
        line(f"training {what} set aside: {len(outliers)} (listed in result.json)")
