"""What an experiment leaves behind: tables in Markdown, charts, and `result.json`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.files import folder_written_whole
from nico_selfmodel.viz.experiment_charts import save_figure

Table = tuple[tuple[str, ...], list[list[str]]]
"""Headings and rows."""


def bodies(count: int) -> str:
    """Say how many simulated bodies something is averaged over."""
    return "1 simulated body" if count == 1 else f"{count} simulated bodies"


def spread(pair: tuple[float, float] | None) -> str:
    """Return a mean and its SD, or a dash where there is none."""
    return "-" if pair is None else f"{pair[0]:.2f} ({pair[1]:.2f})"


def as_markdown(table: Table) -> str:
    """Return a table as Markdown."""
    headings, rows = table
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def write_experiment(
    out: Path,
    document: Mapping[str, Any],
    markdown: str,
    charts: Mapping[str, Any],
    *,
    force: bool = False,
) -> None:
    """Write `tables.md`, the charts (PNG) and `result.json`, whole or not at all.

    Args:
        out: Folder to make.
        document: Results as plain data.
        markdown: The tables.
        charts: Name -> figure.
        force: Replace an earlier result.

    Raises:
        OSError: If the folder exists and `force` is not set, or cannot be written to.
    """
    with folder_written_whole(out, force=force) as folder:
        text = json.dumps(document, indent=1, allow_nan=False)
        (folder / "result.json").write_text(text + "\n", encoding="utf-8")
        (folder / "tables.md").write_text(markdown, encoding="utf-8")
        for name, figure in charts.items():
            save_figure(figure, folder / f"{name}.png")
