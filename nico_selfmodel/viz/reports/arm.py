"""The report on an arm that was learned from measured points."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from nico_selfmodel.estimation import KinematicCalibration
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz import error_plots, parameter_plots
from nico_selfmodel.viz.arm_shape import arm_length
from nico_selfmodel.viz.kinematics_scene import calibration_scene
from nico_selfmodel.viz.reports.page import Report, key_number, telling_set
from nico_selfmodel.viz.reports.parameter_tables import joint_table, place_table
from nico_selfmodel.viz.reports.sections import (
    Bullets,
    Section,
    Text,
    beside,
    drawing,
    numbers,
    section,
)
from nico_selfmodel.viz.reports.shared_sections import (
    all_parameters,
    correlation_figure,
    missing_errors_text,
    outlier_text,
    parameters_of,
    provenance_section,
    scene_section,
    unobservable_section,
)
from nico_selfmodel.viz.reports.tables import Cell, Table, held_out_table, number_cell
from nico_selfmodel.viz.scene import Scene


def arm_report(
    calibration: KinematicCalibration,
    document: Mapping[str, Any],
    robot: ArmDescription | None = None,
) -> Report:
    """Return the report on an arm.

    Args:
        calibration: What was learned.
        document: `estimation.result_document` of it; the numbers shown are these.
        robot: The robot that the arm belongs to, to be drawn in the scene.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    scene = calibration_scene(calibration, robot)
    length = 1e3 * arm_length(calibration.model.chain)
    mean = document[telling_set(document, "points")[0]]["position_mm"]["mean"]
    share = f"{100.0 * mean / length:.2f} % of the arm"
    key = key_number(document, "position_mm", "points", statistics=("mean", "sd"), notes=(share,))
    sections = arm_sections(calibration, document, scene)
    return Report(calibration.model.name, _about(calibration), document, key, sections, scene)


def arm_sections(
    calibration: KinematicCalibration, document: Mapping[str, Any], scene: Scene
) -> tuple[Section, ...]:
    """Return what measured points tell of an arm, section by section."""
    refused = _refused(document)
    return (
        *((refused,) if refused else ()),
        _errors(calibration, document),
        scene_section("The arm and its data", scene),
        _where(calibration),
        _parameters(calibration, document),
        _search(calibration, document),
        _provenance(calibration, document),
    )


def _about(calibration: KinematicCalibration) -> str:
    model = calibration.model
    source = model.provenance.get("dataset")
    data = "" if source is None else f" from the data set {source}"
    alone = calibration.method == "circle-points"
    means = "circle point analysis alone" if alone else "circle points and refinement"
    return f"What {len(model.joints)} joints learned about themselves{data}, by {means}"


def _refused(document: Mapping[str, Any]) -> Section | None:
    """Return why arm and cameras were not refined together, where that was tried in vain."""
    reasons = (document.get("refinement") or {}).get("reasons")
    if not reasons:
        return None
    return section(
        "Arm and cameras were refined together, and that was refused",
        Bullets(tuple(reasons)),
        Text("Kept is what this page shows: the arm as it was learned after the cameras."),
        id="refused",
        kind="warnings",
    )


def _errors(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Section:
    length = 1e3 * arm_length(calibration.model.chain)
    unsure = " Its length rests on unobservable directions." if document["not_identifiable"] else ""
    alone = document["method"] == "circle-points"
    return section(
        "",
        numbers(_error_table(document, length), "errors"),
        Text(
            "Euclidean distance of each predicted point from the measured one. The arm, as "
            f"learned, is {length:.1f} mm long, from its first axis over all axes to the hand."
            + unsure,
            "hint",
        ),
        missing_errors_text(document, "of circle points alone" if alone else "with so few poses"),
        outlier_text(document, "outliers"),
        id="errors",
    )


def _error_table(document: Mapping[str, Any], length: float) -> Table:
    """Return the errors in space, and their means as shares of the arm."""
    table = held_out_table(document, "position_mm", "error [mm]", 2, "points")
    assert table is not None
    rows = tuple(
        (label, (*cells, Cell(f"{cells[1].value / length:.4f}")))  # type: ignore[operator]
        for label, cells in table.rows
    )
    return Table((*table.headings, "mean / arm"), rows)


def _where(calibration: KinematicCalibration) -> Section:
    return section(
        "How large the errors are, and where",
        beside(
            drawing(
                error_plots.error_distribution(calibration), "Distribution of the errors", "half"
            ),
            drawing(parameter_plots.convergence(calibration), "Convergence and starts", "half"),
        ),
        drawing(error_plots.error_over_workspace(calibration), "Errors over the workspace"),
        drawing(error_plots.residuals_over_angles(calibration), "Residuals over the joint angles"),
        Text(
            "Black: means over stretches of the joint's angle, with their standard errors. "
            "Triangles lie beyond the axis.",
            "hint",
        ),
    )


def _parameters(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Section:
    parameters = parameters_of(document, calibration.uncertainty)
    joints = joint_table(parameters, calibration.model.joints)
    hayati = " Ry(β)" if "β [deg]" in joints.headings else ""
    sigmas = drawing(
        parameter_plots.parameter_sigmas(calibration), "Standard deviations of the parameters"
    )
    return section(
        "What was learned",
        numbers(joints),
        numbers(place_table(parameters, calibration.model.markers)),
        all_parameters(parameters),
        sigmas or Text("No standard deviations: circle points alone do not give any."),
        unobservable_section(document, analysed=sigmas is not None),
        correlation_figure(document, calibration.uncertainty),
        message=f"Joint i turns about z of frame i − 1: `M = Tz(D) Rz(θ) Tx(r) Rx(α){hayati}`; "
        "encoder angle = θ offset + gear · θ. Below each value its standard deviation; fixed "
        "values are chosen, not measured.",
        id="parameters",
    )


def _search(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Section:
    outliers = numbers(outlier_table(calibration), rows="rows")
    none = "Not looked for: circle points alone only leave points out of single circles."
    found = (
        (Text("Measurements that contradict the others; not used.", "hint"), outliers)
        if outliers
        else (Text(none if document["method"] == "circle-points" else "None."),)
    )
    return section(
        "How it was learned",
        beside(
            section("Outliers", *found, id="outliers"),
            _starts(calibration, document),
            kind="beside",
        ),
        _circles(calibration, document),
    )


def _starts(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Section | None:
    """Return how every initial guess fared, in the order in which they were tried."""
    search, starts = calibration.search, document["starts"]
    if search is None:
        return None
    best = float(np.min(search.scores)) or 1.0
    rows = tuple(
        (f"{k + 1}", (Cell(label), Cell(f"{score / best:.4g}", value=score)))
        for k, (label, score) in enumerate(zip(search.labels, search.scores.tolist(), strict=True))
    )
    return section(
        "Starts",
        Text(
            f"{starts['agreeing']} of {starts['tried']} starts reached the best minimum, the "
            f"first of them from {starts['best']}."
        ),
        numbers(Table(("start", "from", "cost over the best"), rows), rows="starts"),
    )


def _circles(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Section | None:
    """Return the fitted circles; None where no joint was swept."""
    circles = calibration.circles
    if circles is None or not (circles.reasons or document["circles"]):
        return None
    sigma = dict(zip(calibration.model.joints, circles.axis_sigma.tolist(), strict=True))
    columns = {
        "points": ("points", 0),
        "radius_mm": ("radius [mm]", 1),
        "arc_deg": ("arc [deg]", 0),
        "rms_mm": ("rms [mm]", 3),
        "sagitta_mm": ("height [mm]", 2),
    }
    rows = []
    for circle in document["circles"]:
        cells = [number_cell(circle[key], digits) for key, (_, digits) in columns.items()]
        known = np.degrees(sigma[circle["joint"]])
        cells.append(Cell(f"{known:.3f}" if np.isfinite(known) else "not known"))
        rows.append((circle["joint"], tuple(cells)))
    headings = ("circle of", *(title for title, _ in columns.values()), "axis known to [deg]")
    return section(
        "Circles",
        *(Text(reason, "warn") for reason in circles.reasons),
        numbers(Table(headings, tuple(rows)), rows="circles"),
    )


def outlier_table(calibration: KinematicCalibration) -> Table:
    """Return the rows that are outliers, the worst first."""
    rows = np.flatnonzero(calibration.outliers)
    train = calibration.train
    rows = rows[np.argsort(-train.distances[rows], kind="stable")]
    found = []
    for row in rows.tolist():
        marker = train.observations.markers[train.observations.marker[row]]
        cells = (Cell(marker), number_cell(1e3 * float(train.distances[row]), 2))
        found.append((str(int(train.observations.sample[row])), cells))
    return Table(("sample", "point", "error [mm]"), tuple(found))


def _provenance(calibration: KinematicCalibration, document: Mapping[str, Any]) -> Section:
    model, noise = calibration.model, document["noise_sigma_mm"]
    found = {
        **model.provenance,
        **model.fit,
        **{f"robot {key}": value for key, value in model.robot.items()},
        "arm length": f"{1e3 * arm_length(model.chain):.2f} mm",
        "noise of a coordinate": "not known" if noise is None else f"{noise:.3f} mm",
    }
    return provenance_section(document, found)
