"""The report on a change of a known body: a tool, new zeros, or what `check` learned anew."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nico_selfmodel.estimation.monitoring.health import HealthReport
from nico_selfmodel.estimation.monitoring.update_evaluation import UpdateEvaluation
from nico_selfmodel.estimation.results.verdict import Verdict
from nico_selfmodel.files import refuse_folder
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.distribution_plot import ErrorSet, distribution
from nico_selfmodel.viz.document_tables import HEADINGS, change_table, facts, statistics_cells
from nico_selfmodel.viz.folder import shown
from nico_selfmodel.viz.health_plot import health_plot
from nico_selfmodel.viz.model_folder import write_model_folder
from nico_selfmodel.viz.plot_style import svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.report_tables import Cell, Table
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
    ("cross_validation", "left out in turn", "after"),
    ("train", "learned from", "before"),
    ("train", "learned from", "after"),
)


def write_update_folder(
    folder: str | Path,
    evaluation: UpdateEvaluation,
    verdict: Verdict,
    document: Mapping[str, Any],
    health: HealthReport | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html`, `scene.json` and the URDF, or nothing.

    Args:
        folder: The folder to make.
        evaluation: The body before and after.
        verdict: What is thought of it.
        document: `tool_document`, `rezero_document` or `relearned_document` of both.
        health: What `check` found, where it was what asked for the change.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        ModelError: If the robot that the model names is gone, or has other joints.
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    refuse_folder(folder, force=force)
    scene = update_scene(evaluation, ArmDescription.of_model(evaluation.after))
    texts = shown(update_report_html(evaluation, verdict, document, scene, health), scene)
    return write_model_folder(folder, evaluation.after, document, texts, force=force)


def update_report_html(
    evaluation: UpdateEvaluation,
    verdict: Verdict,
    document: Mapping[str, Any],
    scene: Scene,
    health: HealthReport | None = None,
) -> str:
    """Return the report as one page.

    Args:
        evaluation: The body before and after.
        verdict: What is thought of it.
        document: What goes into `result.json`; the numbers shown are these.
        scene: The scene to embed.
        health: What `check` found, if it did.
    """
    quantity, unit = ("pixels", "px") if evaluation.sensor == "pixels" else ("position_mm", "mm")
    key = key_statistics(document, quantity, "sightings")
    figures = {"distribution": _distribution(evaluation, unit)}
    if health is not None:
        figures["health"] = health_plot(health)
    return page(
        "update_report.html.j2",
        evaluation.after.name,
        verdict,
        scene,
        what=_WHAT[document["method"]],
        document=document,
        key=key,
        before=_before_of(document, key["set"], quantity),
        unit=unit,
        figures={name: svg_data_uri(figure) for name, figure in figures.items()},
        tables={
            "errors": _error_table(document, quantity, unit),
            "changes": change_table(document["changes"], "learned anew"),
            "causes": None if health is None else _cause_table(health),
        },
        provenance=_provenance(evaluation, document),
    )


def _before_of(document: Mapping[str, Any], name: str, quantity: str) -> float:
    """Return the mean error of the body as it was, on the same sightings."""
    return document["before"]["train" if name == "cross_validation" else name][quantity]["mean"]


def _error_table(document: Mapping[str, Any], quantity: str, unit: str) -> Table:
    """Return the errors before and after on every set."""
    rows = []
    for name, label, when in _SETS:
        block = document["before"].get(name) if when == "before" else document[name]
        if block is not None:
            rows.append((f"{label}, {when}", statistics_cells(block, quantity, 2)))
    where = "in the images" if unit == "px" else "in space"
    return Table((f"{where} [{unit}]", "n", *HEADINGS), tuple(rows))


def _cause_table(health: HealthReport) -> Table:
    """Return what else might have changed, the likeliest first."""
    rows = tuple(
        (
            found.hypothesis.cause,
            (
                Cell(f"{found.statistic:.1f}", value=found.statistic),
                Cell(str(found.dof), value=found.dof),
                Cell(f"{found.score:.1f}", value=float(found.score)),
            ),
        )
        for found in health.diagnoses[:8]
    )
    return Table(("may have changed", "likelihood ratio", "parameters", "score"), rows)


def _distribution(evaluation: UpdateEvaluation, unit: str) -> Figure:
    """Draw errors after and before: held out, else left out in turn, else learned from."""
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
    return distribution(sets, unit=unit, digits=2, what=what, thing="sighting")


def _provenance(evaluation: UpdateEvaluation, document: Mapping[str, Any]) -> dict[str, str]:
    """Return what the change was learned from."""
    train, test = evaluation.train, evaluation.test
    found = {
        "body": f"{evaluation.before.name}, {evaluation.before.provenance.get('dataset', '')}",
        "learned from": f"{train.name}, {len(train)} rows, sha256 {train.sha256}",
        "held out": "nothing" if test is None else f"{test.name}, sha256 {test.sha256}",
        "sensor": evaluation.sensor,
        "steps of the solver": document["iterations"],
    }
    return facts(found)
