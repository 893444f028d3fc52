"""The report: one page that needs nothing else, the verdict first."""

from collections.abc import Mapping
from typing import Any

from nico_selfmodel.estimation import KinematicCalibration, Verdict
from nico_selfmodel.viz import error_plots, parameter_plots, report_tables
from nico_selfmodel.viz.arm_shape import arm_length
from nico_selfmodel.viz.kinematics_scene import calibration_scene
from nico_selfmodel.viz.plot_style import svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.scene import Scene


def report_html(
    calibration: KinematicCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    scene: Scene | None = None,
) -> str:
    """Return the report as one self-contained page.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.result_document` of both; the numbers shown are these.
        scene: The scene to embed; made from the calibration if omitted.

    Returns:
        HTML that loads nothing from anywhere.

    Raises:
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    scene = calibration_scene(calibration) if scene is None else scene
    return page(
        "report.html.j2",
        calibration.model.name,
        verdict,
        model=calibration.model,
        document=document,
        key=key_statistics(document, "position_mm", "points"),
        notes=_notes(document),
        refused=_refused(document),
        arm_mm=1e3 * arm_length(calibration.model.chain),
        scene=scene,
        figures=_figures(calibration),
        tables=_tables(calibration, document),
        circle_reasons=() if calibration.circles is None else calibration.circles.reasons,
        provenance=report_tables.provenance(calibration, document),
    )


def _refused(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return why arm and eyes were not refined together, where that was tried in vain."""
    refinement = document.get("refinement")
    return () if refinement is None else tuple(refinement["reasons"])


def _notes(document: Mapping[str, Any]) -> list[str]:
    """Return what must be known to read the statistics."""
    notes = []
    if document["not_identifiable"]:
        notes.append("Its length rests on directions that these data do not determine.")
    if document["test"] is None:
        notes.append("Nothing was held out.")
    if document["cross_validation"] is None:
        alone = document["method"] == "circle-points"
        reason = "of circle points alone" if alone else "with so few poses"
        notes.append(f"There is no cross-validation {reason}.")
    count = len(document["outliers"])
    if count:
        were = "sample was" if count == 1 else "samples were"
        notes.append(f"{count} {were} not believed and left out of all but the held-out errors.")
    return notes


def _figures(calibration: KinematicCalibration) -> dict[str, str | None]:
    """Return every figure as a data URI, None for those that this calibration has not."""
    made = {
        "distribution": error_plots.error_distribution(calibration),
        "workspace": error_plots.error_over_workspace(calibration),
        "angles": error_plots.residuals_over_angles(calibration),
        "sigmas": parameter_plots.parameter_sigmas(calibration),
        "correlation": parameter_plots.correlation_matrix(calibration),
        "convergence": parameter_plots.convergence(calibration),
    }
    return {name: None if f is None else svg_data_uri(f) for name, f in made.items()}


def _tables(
    calibration: KinematicCalibration, document: Mapping[str, Any]
) -> dict[str, report_tables.Table | None]:
    return {
        "errors": report_tables.error_table(document, arm_length(calibration.model.chain)),
        "joints": report_tables.joint_table(calibration, document),
        "places": report_tables.place_table(calibration, document),
        "parameters": report_tables.parameter_list(calibration, document),
        "circles": report_tables.circle_table(calibration, document),
        "outliers": report_tables.outlier_table(calibration),
        "starts": report_tables.start_table(calibration),
    }
