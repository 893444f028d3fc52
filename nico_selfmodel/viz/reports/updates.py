"""The report on a change of a known body: a tool, new zeros, or what monitoring learned anew."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nico_selfmodel.estimation.health import HealthReport
from nico_selfmodel.estimation.update_evaluation import UpdateEvaluation
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.distribution_plot import ErrorSet, distribution
from nico_selfmodel.viz.health_plot import health_plot
from nico_selfmodel.viz.numbers_shown import signed
from nico_selfmodel.viz.reports.page import Report, key_number, telling_set
from nico_selfmodel.viz.reports.sections import (
    Section,
    Text,
    beside,
    drawing,
    numbers,
    section,
)
from nico_selfmodel.viz.reports.shared_sections import provenance_section, scene_section
from nico_selfmodel.viz.reports.tables import Cell, Table, change_table, error_table, number_cell
from nico_selfmodel.viz.scene import Scene
from nico_selfmodel.viz.update_scene import update_scene

_WHAT = {
    "tool": "A tool in the hand becomes part of a body that is known",
    "rezero": "The zeros of the encoders of a body that is known, found again",
    "relearn": "What changed in a body that was known, and only that, learned anew",
}
_SETS = (
    ("test", "held out", "before"),
    ("test", "held out", "after"),
    ("cross_validation", "cross-validated", "after"),
    ("train", "learned from", "before"),
    ("train", "learned from", "after"),
)
_MOST_CAUSES = 8


def update_report(
    evaluation: UpdateEvaluation,
    document: Mapping[str, Any],
    health: HealthReport | None = None,
    robot: ArmDescription | None = None,
) -> Report:
    """Return the report on a change of a known body.

    Args:
        evaluation: The body before and after.
        document: `tool_document`, `rezero_document` or `relearned_document` of it.
        health: What monitoring found, where it was what asked for the change.
        robot: The robot that the arm belongs to, to be drawn; the model's own if omitted.

    Raises:
        ModelError: If the robot that the model names is gone, or has other joints.
    """
    robot = ArmDescription.of_model(evaluation.after) if robot is None else robot
    scene = update_scene(evaluation, robot)
    cause = f": {document['cause']}" if "cause" in document else ""
    quantity, unit = _quantity(evaluation)
    before = f"{_mean_before(document, quantity):.2f} {unit} before"
    key = key_number(document, quantity, "observations", notes=(before,))
    about = f"{_WHAT[document['method']]}{cause}"
    sections = update_sections(evaluation, document, health, scene)
    return Report(evaluation.after.name, about, document, key, sections, scene)


def update_sections(
    evaluation: UpdateEvaluation,
    document: Mapping[str, Any],
    health: HealthReport | None,
    scene: Scene,
) -> tuple[Section, ...]:
    """Return what new observations tell of a known body, section by section."""
    return (
        _changes(document),
        _errors(evaluation, document),
        *(() if health is None else (_causes(health),)),
        scene_section("The body", scene),
        _provenance(evaluation, document),
    )


def _quantity(evaluation: UpdateEvaluation) -> tuple[str, str]:
    return ("pixels", "px") if evaluation.sensor == "pixels" else ("position_mm", "mm")


def _mean_before(document: Mapping[str, Any], quantity: str) -> float:
    """Return the mean error of the body as it was, on the same observations."""
    name, _ = telling_set(document, "observations")
    return document["before"]["train" if name == "cross_validation" else name][quantity]["mean"]


def _changes(document: Mapping[str, Any]) -> Section:
    misfit, expected = document["misfit"]["value"], document["misfit"]["expected"]
    still = "still fits" if document["body_fits"] else "no longer fits"
    return section(
        "What changed, and by how much",
        numbers(change_table(document["changes"], "learned anew")),
        _reach(document),
        _shifts(document),
        Text(
            "Everything else of the body was held, and what it is uncertain by is part of each "
            f"sigma. The rest {still}: misfit {misfit:.0f} where {expected:.0f} was to be "
            "expected.",
            "hint",
        ),
        id="changes",
    )


def _reach(document: Mapping[str, Any]) -> Text | None:
    """Return how far away a tool's tip is; None without a tool."""
    if "reach_mm" not in document:
        return None
    reach = f"{document['reach_mm']['value']:.1f} ± {document['reach_mm']['sigma']:.1f} mm"
    where = (
        "from where it was."
        if document["known"]
        else "from the hand's own point. Before it was learned, the tip is taken to be there."
    )
    return Text(f"The tip of {document['tool']} lies {reach} {where}")


def _shifts(document: Mapping[str, Any]) -> Text | None:
    """Return by what angles the joints' zeros moved; None where that was not asked."""
    if "shift_deg" not in document:
        return None
    shifts = (f"{joint} by {signed(shift, 2)}°" for joint, shift in document["shift_deg"].items())
    return Text(f"{', '.join(shifts)}, as angles of the joints.")


def _errors(evaluation: UpdateEvaluation, document: Mapping[str, Any]) -> Section:
    quantity, unit = _quantity(evaluation)
    blocks = [
        (
            f"{label}, {when}",
            (document["before"] if when == "before" else document).get(name),
            quantity,
        )
        for name, label, when in _SETS
    ]
    where = "in the images" if unit == "px" else "in space"
    hint = (
        "Distance of each observation from where the body expects it, each camera counted by "
        "itself."
        if unit == "px"
        else "Distance of each measured point from where the body expects it."
    )
    missing = []
    if document["cross_validation"] is None:
        missing.append("There are too few poses for a cross-validation.")
    if document["test"] is None:
        missing.append("Nothing was held out: cross-validated poses stand for new ones.")
    return section(
        "Before and after",
        numbers(error_table(blocks, f"{where} [{unit}]", 2, "n")),
        Text(hint, "hint"),
        *(Text(words, "hint") for words in missing),
        beside(
            drawing(
                _distribution(evaluation, unit),
                "Distribution of the errors before and after",
                "half",
            )
        ),
        id="errors",
    )


def _distribution(evaluation: UpdateEvaluation, unit: str) -> Figure:
    """Draw errors after and before: held out, else cross-validated, else learned from."""
    name = "train" if evaluation.test is None else "test"
    before, after = (one.errors for one in evaluation.held[name])
    if name == "train" and evaluation.cross_validation is not None:
        after = evaluation.cross_validation
    scale = 1.0 if unit == "px" else 1e3
    sets = [
        ErrorSet("after", palette.HELD_OUT, scale * np.asarray(after)),
        ErrorSet("before", palette.TRAINING, scale * before),
    ]
    what = "error in an image" if unit == "px" else "error in space"
    return distribution(sets, unit=unit, digits=2, what=what, thing="observation")


def _causes(health: HealthReport) -> Section:
    """Return what else might have changed, the likeliest first."""
    rows = tuple(
        (
            found.hypothesis.cause,
            (
                number_cell(found.statistic, 1),
                Cell(str(found.dof), value=found.dof),
                number_cell(float(found.score), 1),
            ),
        )
        for found in health.diagnoses[:_MOST_CAUSES]
    )
    return section(
        "What told that something had changed",
        drawing(health_plot(health), "Innovations and the statistic of the alarm, pose by pose"),
        numbers(Table(("may have changed", "likelihood ratio", "parameters", "score"), rows)),
        Text(
            "A likelihood ratio is twice its logarithm; a score is that less what each further "
            "parameter must bring.",
            "hint",
        ),
        id="health",
    )


def _provenance(evaluation: UpdateEvaluation, document: Mapping[str, Any]) -> Section:
    train, test = evaluation.train, evaluation.test
    found = {
        "body": f"{evaluation.before.name}, {evaluation.before.provenance.get('dataset', '')}",
        "learned from": f"{train.name}, {len(train)} rows, sha256 {train.sha256}",
        "held out": "nothing" if test is None else f"{test.name}, sha256 {test.sha256}",
        "sensor": evaluation.sensor,
    }
    return provenance_section(document, found)
