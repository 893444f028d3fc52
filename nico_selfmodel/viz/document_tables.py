"""Tables that every report makes of a `result.json`: errors, parameters, changes, facts."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from nico_selfmodel.viz.numbers_shown import decimals
from nico_selfmodel.viz.report_tables import SETS, STATISTICS, Cell, Table

HEADINGS = tuple({"sd": "SD", "p95": "95 %"}.get(name, name) for name in STATISTICS)
_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "px": ("px", 1.0), "1": ("", 1.0)}


def statistics_cells(block: Mapping[str, Any], quantity: str, digits: int) -> tuple[Cell, ...]:
    """Return how many errors there are, and their statistics.

    Args:
        block: One set of errors of a document.
        quantity: `position_mm` or `pixels`.
        digits: Decimals that are shown.
    """
    values = block[quantity]
    count = block.get("poses", block.get("n"))
    found = (Cell(f"{values[s]:.{digits}f}", value=values[s]) for s in STATISTICS)
    return (Cell("" if count is None else str(count), value=count), *found)


def statistics_table(
    document: Mapping[str, Any], quantity: str, heading: str, digits: int, things: str = "poses"
) -> Table | None:
    """Return statistics of every set of errors that has a quantity; None where none has.

    Args:
        document: Content of `result.json`.
        quantity: `position_mm` or `pixels`.
        heading: Of the column that names the sets.
        digits: Decimals that are shown.
        things: What there are n of.
    """
    rows = tuple(
        (label, statistics_cells(document[key], quantity, digits))
        for key, label in SETS
        if document[key] is not None and quantity in document[key]
    )
    return Table((heading, things, *HEADINGS), rows) if rows else None


def parameter_table(
    document: Mapping[str, Any], kind_of: Callable[[str, Mapping[str, Any]], str]
) -> Table:
    """Return every parameter in SI units, to the last digit.

    Args:
        document: Content of `result.json`.
        kind_of: A parameter's name and entry -> what it is: `free`, `fixed`, `derived`.
    """
    rows = []
    for name, entry in document["parameters"].items():
        sigma, kind = entry["sigma"], kind_of(name, entry)
        cells = (
            Cell(repr(float(entry["value"])), value=entry["value"]),
            Cell("" if sigma is None or kind == "fixed" else f"{sigma:.3g}", value=sigma),
            Cell("" if entry["unit"] == "1" else entry["unit"]),
            Cell(kind, kind=kind),
        )
        rows.append((name, cells))
    return Table(("parameter", "value", "sigma", "unit", ""), tuple(rows))


def change_table(changes: Mapping[str, Mapping[str, Any]], heading: str = "parameter") -> Table:
    """Return what numbers were and are, in the units that people read.

    Args:
        changes: `estimation.model_changes.parameter_changes`.
        heading: Of the column that names them.
    """
    rows = []
    for name, entry in changes.items():
        unit, factor = _SHOWN[entry["unit"]]
        sigma = None if entry["sigma"] is None else factor * entry["sigma"]
        before, after = factor * entry["before"], factor * entry["after"]
        change = factor * entry["change"]
        # A change is worth as many digits as its sigma, or as it is large itself.
        scale = sigma if sigma else 0.1 * abs(change) or None
        over = abs(change) / sigma if sigma else None
        cells = (
            Cell(decimals(before, scale), value=entry["before"]),
            Cell(decimals(after, scale), value=entry["after"]),
            Cell(f"{'+' if change > 0.0 else ''}{decimals(change, scale)}"),
            Cell("" if sigma is None else f"± {decimals(sigma, sigma)}", value=entry["sigma"]),
            Cell("" if over is None else f"{over:.1f}"),
            Cell(unit),
        )
        rows.append((name, cells))
    return Table((heading, "before", "after", "change", "sigma", "in sigmas", ""), tuple(rows))


def facts(found: Mapping[str, Any]) -> dict[str, str]:
    """Return facts as text, without those that have parts of their own."""
    plain = {key: fact for key, fact in found.items() if not isinstance(fact, Mapping)}
    return {str(key).replace("_", " "): str(value) for key, value in plain.items()}
