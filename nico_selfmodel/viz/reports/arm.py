"""The report on an arm that was learned from measured points."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration
from nico_selfmodel.viz.figures import error_plots, parameter_plots
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.bending_section import bending_section
from nico_selfmodel.viz.reports.page import Report, key_number, telling_set
from nico_selfmodel.viz.reports.parameter_tables import joint_table, place_table
from nico_selfmodel.viz.reports.residual_rows import points_csv
from nico_selfmodel.viz.reports.tables import Cell, Table, error_table, held_out, number_cell
from nico_selfmodel.viz.scene.arm_scene import calibration_scene
from nico_selfmodel.viz.scene.arm_shape import arm_length

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_CIRCLE_COLUMNS = {
    "points": ("points", 0),
    "radius_mm": ("radius [mm]", 1),
    "arc_deg": ("arc [deg]", 0),
    "rms_mm": ("rms [mm]", 3),
    "sagitta_mm": ("height [mm]", 2),
}
"""Key of a circle in `result.json` -> heading and decimals."""


def arm_report(
    calibration: KinematicCalibration,
    document: Mapping[str, Any],
    robot: "ArmDescription | None" = None,
) -> Report:
    """Return what measured points tell of an arm.

    Args:
        document: `estimation.judging.to_json` of it; the numbers shown are these.
        robot: The robot that the arm belongs to, to be drawn in the scene.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    scene = calibration_scene(calibration, robot)
    length = 1e3 * arm_length(calibration.model.chain)
    mean = document[telling_set(document, "points")[0]]["position_mm"]["mean"]
    share = f"{100.0 * mean / length:.2f} % of the arm"
    key = key_number(document, "position_mm", "points", statistics=("mean", "sd"), note=share)
    sections = (
        *_refused(document),
        _errors(calibration, document, length),
        *bending_section(calibration.model.bending, calibration.at, document),
        _where(calibration),
        _known(calibration, document),
        parts.section(
            "How it was learned",
            parts.Beside((_outliers(calibration, document), *_circles(calibration, document))),
            *_starts(calibration, document),
        ),
        _provenance(calibration, document, length),
    )
    sets = (
        ("held-out", calibration.test, None),
        ("training", calibration.train, calibration.outliers),
    )
    return Report(
        calibration.model.name,
        _about(calibration),
        document,
        key,
        sections,
        scene,
        _learned(calibration, document),
        points_csv(sets),
    )


def _about(calibration: KinematicCalibration) -> str:
    model = calibration.model
    source = model.provenance.get("dataset")
    data = "" if source is None else f" from the data set {source}"
    alone = calibration.method == "circle-points"
    means = "circle point analysis alone" if alone else "circle points and refinement"
    return f"What {len(model.joints)} joints learned about themselves{data}, by {means}"


def _refused(document: Mapping[str, Any]) -> list[parts.Section]:
    """Return why arm and cameras were not refined together, where that was tried in vain."""
    reasons = (document.get("refinement") or {}).get("reasons")
    if not reasons:
        return []
    title = "Arm and cameras were refined together, and that was refused"
    kept = "Kept is what this page shows: the arm as it was learned after the cameras."
    why = parts.Bullets(tuple(reasons))
    return [parts.section(title, why, parts.Text(kept), id="refused", kind="warnings")]


def _errors(
    calibration: KinematicCalibration, document: Mapping[str, Any], length: float
) -> parts.Section:
    errors = held_out(document, "position_mm")
    table = error_table(errors, "error [mm]", 2, "points", length)
    words = (
        "Euclidean distance of each predicted point from the measured one. The arm, as learned, "
        f"is {length:.1f} mm long, from its first axis over all axes to the hand."
    )
    if document["not_identifiable"]:
        words += " Its length rests on unobservable directions."
    alone = document["method"] == "circle-points"
    few = "of circle points alone" if alone else "with so few poses"
    figure = parts.drawing(
        "Distribution of the errors", error_plots.error_distribution(calibration), "half"
    )
    return shared_sections.errors_section(
        document, (table, words), few=few, more="outliers", figure=figure
    )


def _where(calibration: KinematicCalibration) -> parts.Section:
    return parts.section(
        "Where they are",
        parts.drawing("Errors over the workspace", error_plots.error_over_workspace(calibration)),
        parts.drawing(
            "Residuals over the joint angles", error_plots.residuals_over_angles(calibration)
        ),
        parts.hint(
            "Black: means over stretches of the joint's angle, with their standard errors. "
            "Triangles lie beyond the axis."
        ),
    )


def _learned(
    calibration: KinematicCalibration, document: Mapping[str, Any]
) -> tuple[parts.Numbers | None, parts.Text]:
    """Return the arm's rows."""
    hayati = " Ry(β)" if any(name.endswith(".beta") for name in document["parameters"]) else ""
    found = shared_sections.parameter_tables(document, calibration.uncertainty)
    words = (
        f"Joint i turns about z of frame i − 1: `M = Tz(D) Rz(θ) Tx(r) Rx(α){hayati}`; encoder "
        "angle = θ offset + gear · θ. Below each value its standard deviation; fixed values are "
        "chosen, not measured."
    )
    return parts.numbers(joint_table(found, calibration.model.joints)), parts.hint(words)


def _known(calibration: KinematicCalibration, document: Mapping[str, Any]) -> parts.Section:
    model = calibration.model
    sigmas = parts.drawing(
        "Standard deviations of the parameters", parameter_plots.parameter_sigmas(calibration)
    )
    none = parts.Text("No standard deviations: circle points alone do not give any.")
    return shared_sections.learned_section(
        document,
        calibration.uncertainty,
        partial(place_table, markers=model.markers),
        details=(sigmas or none,),
    )


def _outliers(calibration: KinematicCalibration, document: Mapping[str, Any]) -> parts.Section:
    """Return the rows that are outliers, the worst first."""
    train = calibration.train
    worst = np.argsort(-train.distances, kind="stable")
    rows = []
    for row in worst[calibration.outliers[worst]].tolist():
        marker = train.observations.markers[train.observations.marker[row]]
        cells = (Cell(marker), number_cell(1e3 * float(train.distances[row]), 2))
        rows.append((str(int(train.observations.sample[row])), cells))
    table = parts.numbers(Table(("sample", "point", "error [mm]"), tuple(rows)), rows="rows")
    words = "Measurements that contradict the others; held against the model, but not used."
    if table is None:
        alone = document["method"] == "circle-points"
        unsought = "Not looked for: circle points alone only leave points out of single circles."
        words = unsought if alone else "None."
    text = parts.hint(words) if table else parts.Text(words)
    return parts.section("Outliers", text, table, id="outliers")


def _starts(calibration: KinematicCalibration, document: Mapping[str, Any]) -> list[parts.Section]:
    """Return how every initial guess fared, in the order in which they were tried."""
    search, starts = calibration.search, document["starts"]
    if search is None:
        return []
    best = float(np.min(search.scores)) or 1.0
    rows = tuple(
        (f"{k + 1}", (Cell(label), Cell(f"{score / best:.4g}", value=score)))
        for k, (label, score) in enumerate(zip(search.labels, search.scores.tolist(), strict=True))
    )
    words = (
        f"{starts['agreeing']} of {starts['tried']} starts reached the best minimum, the first of "
        f"them from {starts['best']}."
    )
    table = Table(("start", "from", "cost over the best"), rows)
    figure = parts.drawing(
        "Convergence and starts", parameter_plots.convergence(calibration), "half"
    )
    beside = parts.Beside(tuple(part for part in (parts.Numbers(table), figure) if part))
    folded = parts.Folded(f"{len(rows)} starts", (beside,))
    return [parts.section("Starts", parts.Text(words), folded, kind="part")]


def _circles(calibration: KinematicCalibration, document: Mapping[str, Any]) -> list[parts.Section]:
    """Return the fitted circles; nothing where no joint was swept."""
    circles = calibration.circles
    if circles is None or not (circles.reasons or document["circles"]):
        return []
    sigma = dict(zip(calibration.model.joints, circles.axis_sigma.tolist(), strict=True))
    rows = []
    for circle in document["circles"]:
        cells = [number_cell(circle[key], digits) for key, (_, digits) in _CIRCLE_COLUMNS.items()]
        known = np.degrees(sigma[circle["joint"]])
        cells.append(Cell(f"{known:.3f}" if np.isfinite(known) else "not known"))
        rows.append((circle["joint"], tuple(cells)))
    titles = (title for title, _ in _CIRCLE_COLUMNS.values())
    table = Table(("circle of", *titles, "axis known to [deg]"), tuple(rows))
    reasons = (parts.Text(reason, "warn") for reason in circles.reasons)
    return [parts.section("Circles", *reasons, parts.numbers(table, rows="circles"))]


def _provenance(
    calibration: KinematicCalibration, document: Mapping[str, Any], length: float
) -> parts.Section:
    model, noise = calibration.model, document["noise_sigma_mm"]
    found = {
        **model.provenance,
        **model.fit,
        **{f"robot {key}": value for key, value in model.robot.items()},
        "arm length": f"{length:.2f} mm",
        "noise of a coordinate": "not known" if noise is None else f"{noise:.3f} mm",
    }
    return shared_sections.provenance_section(document, found)
