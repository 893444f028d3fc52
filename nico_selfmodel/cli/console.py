"""Tables, verdicts and progress on the terminal."""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console
from rich.measure import Measurement
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

out = Console(soft_wrap=True)
_WIDEST = 400
"""Width that a table may have where nobody looks at it on a terminal [characters]."""
_COLOURS = {"PASS": "green", "FAIL": "red", "NOT_EVALUATED": "yellow"}


class Stage(Protocol):
    """What long jobs call to tell how far they are."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `what` are done."""
        ...


def print_json(document: Mapping[str, Any]) -> None:
    """Write a document to standard output for a script to read."""
    sys.stdout.write(json.dumps(document, indent=1, allow_nan=False) + "\n")


def print_table(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; all but the first column are aligned to the right."""
    # As Text: in a plain string Rich would take [mm] for markup and drop it.
    table = Table(title=Text(title), title_justify="left", title_style="bold", header_style="dim")
    for index, heading in enumerate(headings):
        side = "left" if index == 0 else "right"
        table.add_column(Text(heading), justify=side, overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    if out.is_terminal:
        out.print(table)
        return
    # A file or a pipe is as wide as the table.
    wide = Console(file=out.file, width=_WIDEST)
    wide.width = max(out.width, Measurement.get(wide, wide.options, table).maximum)
    wide.print(table)


def print_verdict(status: str, reasons: Sequence[str], warnings: Sequence[str] = ()) -> None:
    """Print a verdict with its reasons, and after it what is doubtful though nothing fails."""
    out.print(f"[bold {_COLOURS[status]}]{status}[/]")
    for reason in reasons:
        out.print(f"  {reason}", markup=False)
    for warning in warnings:
        out.print(f"  note: {warning}", markup=False)


def print_outliers(document: Mapping[str, Any]) -> None:
    """Say how many training poses were set aside."""
    if document["outliers"]:
        count = len(document["outliers"])
        poses = "training pose" if count == 1 else "training poses"
        out.print(f"{count} {poses} set aside as outliers (listed in result.json)")


def print_where(folder: Path) -> None:
    """Say what lies in a result folder and how to look at it."""
    out.print(f"\nresult   {folder}/", markup=False)
    for path in sorted(folder.iterdir()):
        out.print(f"         {path.name}", markup=False)
    if (folder / "report.html").exists():
        out.print(f"look     open {folder / 'report.html'}, or: nico-selfmodel view {folder}")


def statistics_row(label: str, block: Mapping[str, Any] | None) -> list[str]:
    """Return a table row of error statistics, dashes where there are none."""
    if block is None:
        return [label, *["-"] * 6]
    mm = block["position_mm"]
    numbers = [three_digits(mm[name]) for name in ("mean", "sd", "rms", "median", "max")]
    return [label, str(block["n"]), *numbers]


def three_digits(value: float) -> str:
    """Return a number with three significant digits, zeros at its end too: 2.00, not 2."""
    return f"{value:#.3g}".rstrip(".")


def print_calibration(name: str, document: Mapping[str, Any], folder: Path) -> None:
    """Print a result document: errors, verdict, and where the result lies."""
    parts = (
        ("held out", "test"),
        ("cross-validation", "cross_validation"),
        ("training", "train"),
    )
    rows = [statistics_row(label, document[key]) for label, key in parts]
    print_table(name, STATISTICS_HEADINGS, rows)
    print_outliers(document)
    print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    print_where(folder)


def print_cameras(name: str, document: Mapping[str, Any], folder: Path) -> None:
    """Print a result document of cameras: errors, parameters, verdict, and where it lies."""
    parts = (
        ("held out", "test"),
        ("cross-validation", "cross_validation"),
        ("training", "train"),
        ("epipolar", "epipolar_px"),
    )
    rows = [_pixel_row(label, document.get(key)) for label, key in parts if key in document]
    print_table(name, ("error [px]", "corners", *_STATISTICS), rows)
    print_table("cameras", ("parameter", "value", "sigma", "unit"), _free_rows(document))
    if document["outliers"]:
        files = document["detection"]["files"]
        names = (" and ".join(f[view] for f in files.values()) for view in document["outliers"])
        out.print(f"boards set aside: {'; '.join(names)}", markup=False)
    print_verdict(document["status"], document["reasons"], document.get("warnings", ()))
    print_where(folder)


def _pixel_row(label: str, block: Mapping[str, Any] | None) -> list[str]:
    if block is None:
        return [label, *["-"] * (1 + len(_STATISTICS))]
    pixels = block["pixels"]
    return [label, str(block["n"]), *(f"{pixels[name.lower()]:.3f}" for name in _STATISTICS)]


def _free_rows(document: Mapping[str, Any]) -> list[list[str]]:
    """Return the parameters that were learned, and those that follow from them."""
    rows = []
    for name, entry in document["parameters"].items():
        if entry["free"] or name == "baseline":
            sigma = "-" if entry["sigma"] is None else f"{entry['sigma']:.2g}"
            rows.append([name, f"{entry['value']:.6g}", sigma, entry["unit"]])
    return rows


_STATISTICS = ("mean", "SD", "rms", "median", "max")
STATISTICS_HEADINGS = ("error [mm]", "n", *_STATISTICS)


@contextmanager
def progress_bar() -> Iterator[Stage]:
    """Show a progress bar on standard error while a job runs; quiet where that is no terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        tasks: dict[str, Any] = {}

        def stage(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done, total=total)

        yield stage
