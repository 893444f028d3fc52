"""Sections that every kind of evidence has: parameters, what stays open, where it came from."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from nico_selfmodel.optimization.uncertainty import Uncertainty
from nico_selfmodel.viz.figures.parameter_plots import correlations, unobservable_parameters
from nico_selfmodel.viz.reports import parts
from nico_selfmodel.viz.reports.parameter_tables import ParameterTables
from nico_selfmodel.viz.reports.tables import Table, change_table, error_table, fact_table

_MOST_CHANGES = 8
"""Changes that are shown unfolded, beside the lengths."""


def errors_section(
    document: Mapping[str, Any],
    *shown: tuple[Table | None, str],
    few: str,
    more: str = "",
    figure: parts.Drawing | None = None,
    ending: Any = None,
) -> parts.Section:
    """Return the errors, what they are, and which samples are left out of them.

    Args:
        document: Content of `result.json`.
        shown: Tables and what their numbers are, the most telling first; None are left out.
        few: Why there might be no cross-validation.
        more: `id` of the section that tells more of the outliers.
        ending: A part that stands last.
    """
    tables = [
        part
        for table, words in shown
        if table is not None
        for part in (parts.numbers(table, "errors"), parts.hint(words))
    ]
    notes = []
    if document["test"] is None:
        notes.append("Nothing was held out.")
    if document["cross_validation"] is None:
        notes.append(f"There is no cross-validation {few}.")
    missing = parts.hint(" ".join(notes)) if notes else None
    told = parts.section("", *tables, missing, _outliers(document, more), kind="part")
    told = parts.Beside((told, figure)) if figure is not None else told
    return parts.section("How large the errors are", told, ending, id="errors")


def _outliers(document: Mapping[str, Any], more: str) -> parts.Text | None:
    if not document["outliers"]:
        return None
    named = ", ".join(map(str, document["outliers"]))
    return parts.hint(f"Outliers, left out of all but the held-out errors: {named}", more)


def changes_section(
    title: str,
    document: Mapping[str, Any],
    quantities: Sequence[tuple[str, str]],
    things: str,
    before_is: str,
    shown: str,
    digits: int = 2,
) -> parts.Section:
    """Return errors before and after, and the numbers that changed.

    Args:
        document: Content of `result.json`, with `before`.
        quantities: What is compared, and its unit.
        things: What errors are of, as `poses`.
        before_is: What stands before.
        shown: Which changes are shown unfolded.
    """
    before, changes = document["before"], document["before"]["changes"]
    errors = [
        (f"{label} [{unit}]", block, quantity)
        for quantity, unit in quantities
        for label, block in (("before", before), ("after", document[before["on"]]))
    ]
    kind = f"held-out {things}" if before["on"] == "test" else f"training {things}"
    return parts.section(
        title,
        parts.numbers(error_table(errors, kind, digits, things)),
        parts.hint(before_is),
        parts.numbers(change_table(_largest(changes))),
        parts.hint(shown),
        parts.Folded(f"All {len(changes)} changes", (parts.Numbers(change_table(changes)),)),
        id="before",
    )


def _largest(changes: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return the changes of lengths, and of what moved most for what it is uncertain by."""

    def size(name: str) -> float:
        entry = changes[name]
        sigma = entry["sigma"]
        return abs(entry["change"]) / sigma if sigma else 0.0

    lengths = [name for name in changes if name == "baseline" or name.startswith("link.")]
    others = sorted((n for n in changes if n not in lengths and size(n) > 0.0), key=size)
    chosen = [*reversed(others[-_MOST_CHANGES:]), *lengths]
    return {name: changes[name] for name in chosen}


def learned_section(
    document: Mapping[str, Any],
    uncertainty: Uncertainty | None,
    *tables: Callable[[ParameterTables], Table | None],
    details: Sequence[Any] = (),
) -> parts.Section:
    """Return the other parameters, how well they are known, and the unobservable directions.

    Args:
        document: Content of `result.json`.
        uncertainty: What is known of the parameters; None where nothing is.
        tables: What to show unfolded beside what the first page tells, made of the parameters.
        details: Parts that follow the tables.
    """
    parameters = parameter_tables(document, uncertainty)
    everything = parts.Numbers(parameters.everything(), "cards")
    summary = f"All {len(parameters.entries)} parameters, in SI units and pixels"
    return parts.section(
        "How well it is known",
        parts.Beside((*_tables(parameters, tables), _unobservable(document, uncertainty))),
        *details,
        parts.Folded(summary, (everything,)),
        None if uncertainty is None else _correlations(uncertainty),
        id="parameters",
    )


def _tables(
    parameters: ParameterTables, tables: Sequence[Callable[[ParameterTables], Table | None]]
) -> list[parts.Numbers]:
    found = (parts.numbers(table(parameters), "lens") for table in tables)
    return [one for one in found if one is not None]


def parameter_tables(
    document: Mapping[str, Any], uncertainty: Uncertainty | None
) -> ParameterTables:
    """Return the parameters of a document, and which of them must not be read as if known."""
    return ParameterTables(document["parameters"], unobservable_parameters(uncertainty))


def _unobservable(document: Mapping[str, Any], uncertainty: Uncertainty | None) -> parts.Section:
    """Return the directions that the data do not determine."""
    lines = tuple(document["not_identifiable"])
    none = "Not analysed." if uncertainty is None else "None: every free parameter is determined."
    found = parts.Bullets(lines, "warn") if lines else parts.Text(none)
    return parts.section("Unobservable directions", found, id="unobservable", kind="part")


def _correlations(uncertainty: Uncertainty) -> parts.Folded | None:
    """Return the correlations of the free parameters, folded."""
    figure = parts.drawing("Correlations of the parameters", correlations(uncertainty), "matrix")
    if figure is None:
        return None
    return parts.Folded("Correlations", (figure,))


def provenance_section(document: Mapping[str, Any], found: Mapping[str, Any]) -> parts.Section:
    """Return what a result was learned from and with.

    Args:
        document: Content of `result.json`.
        found: What is known beside it: name -> fact.
    """
    solver = {"steps of the solver": document["iterations"]}
    if document.get("seconds") is not None:
        solver["seconds"] = f"{document['seconds']:.2f}"
    return parts.section("Provenance", parts.numbers(fact_table({**found, **solver}), "text"))
