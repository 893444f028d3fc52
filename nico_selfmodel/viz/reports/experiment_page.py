"""The page of an experiment: verdict, stages, tables and figures, by the parts of every report."""

from collections.abc import Sequence
from dataclasses import dataclass

from nico_selfmodel.viz.reports import parts
from nico_selfmodel.viz.reports.page import page_environment
from nico_selfmodel.viz.reports.tables import Cell, Table

_MEANING = {
    "PASS": "All stages were run as often as a verdict takes, and each met its bounds.",
    "FAIL": "A stage missed its bound; those that rest on it are not judged.",
    "NOT_EVALUATED": "No stage failed, but some were not run as often as a verdict takes.",
}


@dataclass(frozen=True, eq=False)
class ExperimentPage:
    """One self-contained page, which loads nothing from anywhere."""

    name: str
    """What it is about."""
    about: str
    """What was done, in a line."""
    status: str
    """`PASS`, `FAIL` or `NOT_EVALUATED`."""
    reasons: tuple[str, ...]
    """Why it is that."""
    sections: tuple[parts.Section, ...]
    """Below, in this order."""

    def html(self) -> str:
        """Return the page."""
        return (
            page_environment()
            .get_template("experiment.html.j2")
            .render(page=self, meaning=_MEANING[self.status])
        )


def text_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """Return rows of text as a table of a report; the first cell of each row names it."""
    return Table(
        tuple(headings), tuple((row[0], tuple(Cell(cell) for cell in row[1:])) for row in rows)
    )
