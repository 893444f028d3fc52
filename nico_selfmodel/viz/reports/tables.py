"""Tables of a report: plain rows of text, made of `result.json`."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.viz.figures.numbers_shown import decimals

SETS = (("test", "held-out"), ("cross_validation", "cross-validation"), ("train", "training"))
"""Sets of errors in a document, the most telling first, and what they are called."""
STATISTICS = ("mean", "sd", "rms", "median", "p95", "max")
HEADINGS = ("mean", "SD", "rms", "median", "95 %", "max")
UNITS = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "px": ("px", 1.0), "1": ("", 1.0)}
UNITS |= {"rad/m": ("mrad/m", 1e3), "s": ("ms", 1e3), "1/s": ("1/s", 1.0)}
UNITS |= {"rad/s": ("deg/s", 180.0 / np.pi), "rad/s^2": ("deg/s²", 180.0 / np.pi)}
"""Unit of a parameter -> unit and factor that people read."""


UNIT_OF = {"position_mm": "mm", "pixels": "px", "angle_deg": "deg"}
"""Quantity of a set of errors -> its unit."""
ErrorBlock = tuple[str, Mapping[str, Any] | None, str]
"""Label, set of errors of a document, and the quantity to show, one of `UNIT_OF`."""


@dataclass(frozen=True)
class Cell:
    """A number as it is shown, beside what it is exactly."""

    text: str
    """For people."""
    note: str = ""
    """Its standard deviation, or why it has none."""
    kind: str = ""
    """`free`, `fixed`, `derived`, `unobservable` or `unknown`; empty where it is no parameter."""
    value: float | None = None
    """As in `result.json`."""


@dataclass(frozen=True)
class Table:
    """Rows under headings; the first cell of each row names it."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Cell, ...]], ...]

    @property
    def longest_word(self) -> int:
        """Characters of the longest number or word in a cell; a minus is wide and counts twice."""
        words = (word for _, cells in self.rows for cell in cells for word in cell.text.split())
        return max((len(word) + word.count("−") for word in words), default=1)


def number_cell(value: float | None, digits: int = 0) -> Cell:
    """Return a number with so many decimals; nothing for None."""
    return Cell("") if value is None else Cell(f"{value:.{digits}f}", value=value)


def statistics_cells(
    block: Mapping[str, Any], quantity: str, digits: int, things: str = "poses"
) -> tuple[Cell, ...]:
    """Return how many errors there are, and their statistics.

    Args:
        block: One set of errors of a document.
        quantity: `position_mm` or `pixels`.
        things: What there are n of.
    """
    values, count = block[quantity], block.get("n")
    if things == "poses":
        count = block.get("poses", count)
    return (number_cell(count), *(number_cell(values[name], digits) for name in STATISTICS))


def held_out(document: Mapping[str, Any], quantity: str) -> list[ErrorBlock]:
    """Return the held-out, the cross-validated and the training errors of a document."""
    return [(label, document[key], quantity) for key, label in SETS]


def error_table(
    blocks: Iterable[ErrorBlock],
    heading: str,
    digits: int,
    things: str = "poses",
    arm_mm: float | None = None,
) -> Table | None:
    """Return statistics of sets of errors; None where there are none.

    Args:
        blocks: What to show; sets without the quantity are left out.
        heading: Of the column that names the sets.
        things: What there are n of.
        arm_mm: Length of an arm of which the means are shares [mm].
    """
    rows = []
    for label, block, quantity in blocks:
        if block is not None and quantity in block:
            cells = statistics_cells(block, quantity, digits, things)
            if arm_mm is not None:
                cells += (Cell(f"{block[quantity]['mean'] / arm_mm:.4f}"),)
            rows.append((label, cells))
    share = () if arm_mm is None else ("mean / arm",)
    return Table((heading, things, *HEADINGS, *share), tuple(rows)) if rows else None


def change_table(changes: Mapping[str, Mapping[str, Any]], heading: str = "parameter") -> Table:
    """Return what numbers were and are, in the units that people read.

    Args:
        changes: `estimation.results.model_changes.parameter_changes`.
        heading: Of the column that names them.
    """
    rows = tuple((name, _change_cells(entry)) for name, entry in changes.items())
    return Table((heading, "before", "after", "change", "sigma", "in sigmas", ""), rows)


def _change_cells(entry: Mapping[str, Any]) -> tuple[Cell, ...]:
    unit, factor = UNITS[entry["unit"]]
    sigma = None if entry["sigma"] is None else factor * entry["sigma"]
    before, after, change = (factor * entry[key] for key in ("before", "after", "change"))
    # A change is worth as many digits as its sigma, or as it is large itself.
    scale = sigma if sigma else 0.1 * abs(change) or None
    return (
        Cell(decimals(before, scale), value=entry["before"]),
        Cell(decimals(after, scale), value=entry["after"]),
        Cell(f"{'+' if change > 0.0 else ''}{decimals(change, scale)}"),
        Cell("" if sigma is None else f"± {decimals(sigma, sigma)}", value=entry["sigma"]),
        Cell(f"{abs(change) / sigma:.1f}" if sigma else ""),
        Cell(unit),
    )


def fact_table(found: Mapping[str, Any]) -> Table:
    """Return names and what they stand for, without what has parts of its own."""
    plain = {key: fact for key, fact in found.items() if not isinstance(fact, Mapping)}
    rows = ((str(key).replace("_", " "), (Cell(str(fact)),)) for key, fact in plain.items())
    return Table((), tuple(rows))
