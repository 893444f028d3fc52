"""The report on a change of a known body: a tool, new zeros, or what monitoring learned anew."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nico_selfmodel.dataset.folder import content_hash
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.monitoring.update_evaluation import UpdateEvaluation
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels
from nico_selfmodel.estimation.observations.pixel_observations import columns_of
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.distribution_plot import ErrorSet, distribution
from nico_selfmodel.viz.figures.numbers_shown import signed
from nico_selfmodel.viz.figures.over_time.health_plot import health_plot
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.page import Report, headline_quantity, key_number, telling_set
from nico_selfmodel.viz.reports.pixel_rows import pixels_csv
from nico_selfmodel.viz.reports.residual_rows import points_csv
from nico_selfmodel.viz.reports.tables import Table, change_table, error_table, number_cell
from nico_selfmodel.viz.scene.update_scene import update_scene

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
) -> Report:
    """Return what new observations tell of a known body.

    Args:
        evaluation: The body before and after.
        document: `estimation.judging.to_json` of it; the numbers shown are these.
        health: What monitoring found, where it was what asked for the change.

    Raises:
        ModelError: If the robot that the model names is gone, or has other joints.
    """
    scene = update_scene(evaluation, ArmDescription.of_model(evaluation.after))
    quantity = headline_quantity(document, "observations")
    unit = "mm" if quantity == "position_mm" else "px"
    name, _ = telling_set(document, "observations")
    # What is cross-validated after the change was learned from before it.
    was = document["before"]["train" if name == "cross_validation" else name][quantity]["mean"]
    key = key_number(document, quantity, "observations", note=f"{was:.2f} {unit} before")
    sections = (
        _errors(evaluation, document, quantity, unit),
        *(() if health is None else (_causes(health),)),
        _provenance(evaluation, document),
    )
    return Report(
        evaluation.after.name,
        about_update(document),
        document,
        key,
        sections,
        scene,
        _changes(document),
        _residuals(evaluation),
    )


def about_update(document: Mapping[str, Any]) -> str:
    """Return what was learned anew, in a line; of an arm or of any body.

    Args:
        document: `estimation.judging.to_json` of it.
    """
    cause = f": {document['cause']}" if "cause" in document else ""
    return f"{_WHAT[document['method']]}{cause}"


def _residuals(evaluation: UpdateEvaluation) -> str:
    """Return observations and what the body as it is now expects, as CSV."""
    after, sensor = evaluation.after, evaluation.sensor
    sets = [("held-out", evaluation.test), ("training", evaluation.train)]
    known = [(name, columns_of(after, data)) for name, data in sets if data is not None]
    if sensor == "pixels":
        return pixels_csv((name, evaluate_pixels(after, data), None) for name, data in known)
    return points_csv((name, evaluate(after, data), None) for name, data in known)


def _changes(document: Mapping[str, Any]) -> tuple[parts.Numbers | parts.Text | None, ...]:
    table = change_table(document["changes"], "learned anew")
    return parts.numbers(table), _shifts(document), *told_by_update(document)


def told_by_update(document: Mapping[str, Any]) -> tuple[parts.Text | None, ...]:
    """Return where a tip is, and whether the rest of the body fits; of any body.

    Args:
        document: `estimation.judging.to_json` of what was learned anew.
    """
    misfit, expected = document["misfit"]["value"], document["misfit"]["expected"]
    still = "still fits" if document["body_fits"] else "no longer fits"
    return (
        _reach(document),
        parts.hint(
            "Everything else of the body was held, and what it is uncertain by is part of each "
            f"sigma. The rest {still}: misfit {misfit:.0f} where {expected:.0f} was to be expected."
        ),
    )


def _reach(document: Mapping[str, Any]) -> parts.Text | None:
    """Return how far away a tool's tip is; None without a tool."""
    if "reach_mm" not in document:
        return None
    reach = f"{document['reach_mm']['value']:.1f} ± {document['reach_mm']['sigma']:.1f} mm"
    if point := document["reach_mm"].get("from"):
        return parts.Text(f"The tip of {document['tool']} lies {reach} from {point}.")
    unknown = "from the hand's own point. Before it was learned, the tip is taken to be there."
    where = "from where it was." if document["known"] else unknown
    return parts.Text(f"The tip of {document['tool']} lies {reach} {where}")


def _shifts(document: Mapping[str, Any]) -> parts.Text | None:
    """Return by what angles the joints' zeros moved; None where that was not asked."""
    if "shift_deg" not in document:
        return None
    shifts = (f"{joint} by {signed(shift, 2)}°" for joint, shift in document["shift_deg"].items())
    return parts.Text(f"{', '.join(shifts)}, as angles of the joints at the same readings.")


def _errors(
    evaluation: UpdateEvaluation, document: Mapping[str, Any], quantity: str, unit: str
) -> parts.Section:
    when = {"before": document["before"], "after": document}
    blocks = [(f"{label}, {time}", when[time].get(name), quantity) for name, label, time in _SETS]
    where, what = "in space", "Distance of each measured point from where the body expects it."
    if unit == "px":
        where = "in the images"
        what = (
            "Distance of each observation from where the body expects it, each camera counted by "
            "itself."
        )
    missing = []
    if document["cross_validation"] is None:
        missing.append("There are too few poses for a cross-validation.")
    if document["test"] is None:
        missing.append("Nothing was held out: cross-validated poses stand for new ones.")
    figure = _distribution(evaluation, unit)
    return parts.section(
        "Before and after",
        parts.Beside(
            (
                parts.section(
                    "",
                    parts.numbers(error_table(blocks, f"{where} [{unit}]", 2, "n")),
                    parts.hint(" ".join([what, *missing])),
                    kind="part",
                ),
                parts.Drawing(figure, "Distribution of the errors before and after", "half"),
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
    return distribution(sets, unit=unit, what=what, thing="observation")


def _causes(health: HealthReport) -> parts.Section:
    """Return what else might have changed, the likeliest first."""
    rows = tuple(
        (
            one.hypothesis.cause,
            (number_cell(one.statistic, 1), number_cell(one.dof), number_cell(one.score, 1)),
        )
        for one in health.diagnoses[:_MOST_CAUSES]
    )
    about = "Innovations and the statistic of the alarm, pose by pose"
    headings = ("may have changed", "likelihood ratio", "parameters", "score")
    return parts.section(
        "What told that something had changed",
        parts.Beside(
            (
                parts.section(
                    "",
                    parts.numbers(Table(headings, rows)),
                    parts.hint(
                        "A likelihood ratio is twice its logarithm; a score is that less what each "
                        "further parameter must bring."
                    ),
                    kind="part",
                ),
                parts.Drawing(health_plot(health), about, "half"),
            )
        ),
        id="health",
    )


def _provenance(evaluation: UpdateEvaluation, document: Mapping[str, Any]) -> parts.Section:
    train, test = evaluation.train, evaluation.test
    found = {
        "body": f"{evaluation.before.name}, {evaluation.before.provenance.get('dataset', '')}",
        "learned from": f"{train.name}, {len(train)} rows, sha256 {content_hash(train)}",
        "held out": "nothing" if test is None else f"{test.name}, sha256 {content_hash(test)}",
        "sensor": evaluation.sensor,
    }
    return shared_sections.provenance_section(document, found)
