"""What an experiment leaves behind: tables in Markdown, charts, and `result.json`."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.files.whole import folder_written_whole
from nico_selfmodel.viz.figures.experiment_charts import BarSeries, save_figure
from nico_selfmodel.viz.reports.experiment_page import ExperimentPage
from nico_selfmodel.viz.reports.page import REPORT_FILE

Pair = tuple[float, float] | None
"""A mean and its SD; None where there is none."""


@dataclass(frozen=True)
class Table:
    """Rows of text."""

    title: str
    """What stands above it in a terminal."""
    headings: Sequence[str]
    """Of the columns."""
    rows: Sequence[Sequence[str]]
    """Cells."""
    before: str = ""
    """Markdown between what comes before it and the table."""

    @property
    def markdown(self) -> str:
        """The table as Markdown."""
        lines = ["| " + " | ".join(self.headings) + " |", "|" + "---|" * len(self.headings)]
        lines += ["| " + " | ".join(row) + " |" for row in self.rows]
        return self.before + "\n".join(lines) + "\n"


@dataclass(frozen=True, eq=False)
class ExperimentReport:
    """Ours beside the published figures."""

    head: str
    """Markdown: title, and how it was done."""
    tables: tuple[Table, ...]
    """In the order of the page."""
    charts: Mapping[str, Any]
    """File name -> figure."""
    document: Mapping[str, Any]
    """Results as plain data."""
    page: ExperimentPage | None = None
    """The same to read in a browser, if the experiment has such a page."""

    def write(self, out: Path, *, force: bool = False) -> None:
        """Write `tables.md`, charts (PNG), `result.json` and any page, whole or not at all.

        Raises:
            OSError: If the folder exists and `force` is not set, or cannot be written to.
        """
        with folder_written_whole(out, force=force) as folder:
            text = json.dumps(self.document, indent=1, allow_nan=False)
            (folder / "result.json").write_text(text + "\n", encoding="utf-8")
            markdown = self.head + "".join(table.markdown for table in self.tables)
            (folder / "tables.md").write_text(markdown, encoding="utf-8")
            for name, figure in self.charts.items():
                save_figure(figure, folder / f"{name}.png")
            if self.page is not None:  # last: a page takes its figures apart
                (folder / REPORT_FILE).write_text(self.page.html(), encoding="utf-8")


def bodies(count: int) -> str:
    """Say how many simulated bodies something is averaged over."""
    return "1 simulated body" if count == 1 else f"{count} simulated bodies"


def spread(pair: Pair, digits: int = 2) -> str:
    """Return a mean and its SD, or a dash where there is none."""
    return "-" if pair is None else f"{pair[0]:.{digits}f} ({pair[1]:.{digits}f})"


def bars(
    label: str, pairs: Iterable[Pair], *, published: bool = False, color: int = 0
) -> BarSeries:
    """Return one bar a group; arguments as of `BarSeries`, nothing is drawn where there is none."""
    drawn = np.array([(np.nan, np.nan) if pair is None else pair for pair in pairs], dtype=float)
    return BarSeries(label, *drawn.T, published=published, color=color)
