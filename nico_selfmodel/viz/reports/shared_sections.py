"""Sections that every kind of evidence has: parameters, what stays open, where it came from."""

from collections.abc import Mapping
from typing import Any

from nico_selfmodel.optimization import Uncertainty
from nico_selfmodel.viz.parameter_plots import correlations, unobservable_parameters
from nico_selfmodel.viz.reports.parameter_tables import ParameterTables
from nico_selfmodel.viz.reports.sections import (
    Bullets,
    Drawing,
    Facts,
    Folded,
    Numbers,
    Section,
    Stage,
    Text,
    section,
)
from nico_selfmodel.viz.reports.tables import facts
from nico_selfmodel.viz.scene import Scene


def scene_section(title: str, scene: Scene) -> Section:
    """Return the section with the interactive scene."""
    return section(title, Stage(scene), id="scene")


def parameters_of(document: Mapping[str, Any], uncertainty: Uncertainty | None) -> ParameterTables:
    """Return the parameters of a document, with those marked that the data do not determine.

    Args:
        document: Content of `result.json`.
        uncertainty: What is known of them; None where nothing is.
    """
    return ParameterTables(document["parameters"], unobservable_parameters(uncertainty))


def all_parameters(parameters: ParameterTables) -> Folded:
    """Return every parameter to the last digit, folded away."""
    summary = f"All {len(parameters.entries)} parameters, in SI units and pixels"
    return Folded(summary, (Numbers(parameters.everything()),))


def unobservable_section(document: Mapping[str, Any], *, analysed: bool = True) -> Section:
    """Return the directions that the data do not determine.

    Args:
        document: Content of `result.json`.
        analysed: Whether they were looked for.
    """
    lines = tuple(document["not_identifiable"])
    none = "None: every free parameter is determined." if analysed else "Not analysed."
    found = Bullets(lines, "warn") if lines else Text(none)
    return section("Unobservable directions", found, id="unobservable")


def correlation_figure(
    document: Mapping[str, Any], uncertainty: Uncertainty | None
) -> Folded | None:
    """Return the correlations of the free parameters, open where directions are unobservable."""
    figure = None if uncertainty is None else correlations(uncertainty)
    if figure is None:
        return None
    shown = Drawing(figure, "Correlations of the parameters", "matrix")
    return Folded("Correlations", (shown,), bool(document["not_identifiable"]))


def provenance_section(document: Mapping[str, Any], found: Mapping[str, Any]) -> Section:
    """Return what a result was learned from and with.

    Args:
        document: Content of `result.json`.
        found: What is known beside it: name -> fact.
    """
    solver = {"steps of the solver": document["iterations"]}
    if document.get("seconds") is not None:
        solver["seconds"] = f"{document['seconds']:.2f}"
    return section("Provenance", Facts(facts({**found, **solver})))


def outlier_text(document: Mapping[str, Any], more: str = "") -> Text | None:
    """Return which samples are outliers; None where none are.

    Args:
        document: Content of `result.json`.
        more: `id` of the section that tells more of them.
    """
    found = document["outliers"]
    if not found:
        return None
    named = ", ".join(map(str, found))
    words = f"Outliers, left out of all but the held-out errors: {named}"
    return Text(words if more else f"{words}.", "hint", more)


def missing_errors_text(document: Mapping[str, Any], reason: str) -> Text | None:
    """Return which errors there are not; None where nothing is missing.

    Args:
        document: Content of `result.json`.
        reason: Why there might be no cross-validation, after "There is no cross-validation".
    """
    words = []
    if document["test"] is None:
        words.append("Nothing was held out.")
    if document["cross_validation"] is None:
        words.append(f"There is no cross-validation {reason}.")
    return Text(" ".join(words), "hint") if words else None
