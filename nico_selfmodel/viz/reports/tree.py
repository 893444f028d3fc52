"""The report on a body learned from any sensors."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.files.csv_cells import rows_text
from nico_selfmodel.model.tree.body_tree import FLANGE, REVOLUTE
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.bending_section import bending_section
from nico_selfmodel.viz.reports.page import Report, headline_quantity, key_number, telling_set
from nico_selfmodel.viz.reports.parameter_tables import ParameterTables
from nico_selfmodel.viz.reports.residual_rows import Held, Rows, flag
from nico_selfmodel.viz.reports.tables import Cell, Table, error_table, held_out, number_cell
from nico_selfmodel.viz.reports.updates import about_update, told_by_update
from nico_selfmodel.viz.scene.tree_scene import tree_scene

_SPACE = {
    True: "Distance of each marker that a tracker measured from where the body expects it.",
    False: "By how much each touch or distance is missed.",
}
"""What errors in space are, where anything was seen and where nothing was."""
_IMAGES = (
    "Distance of each observation from where the body expects it, each camera counted by itself."
)

_RESIDUAL_HEADINGS = ("set", "sample", "sensor", "marker", "outlier", "error", "unit")
_ABOUT = "What was learned of a body from all that any sensors measured of it"


def tree_report(calibration: TreeCalibration, document: Mapping[str, Any]) -> Report:
    """Return what was learned of a body.

    Args:
        document: `estimation.judging.to_json` of it; the numbers shown are these.
    """
    scene = tree_scene(calibration.name, calibration.tree, calibration.posed)
    anew = "body_fits" in document
    about = about_update(document) if anew else _ABOUT

    def frames(found: ParameterTables) -> Table | None:
        return _frames(found, _framed(calibration, found))

    sections = (
        _errors(calibration, document),
        *_before(document),
        *_against_description(document),
        *bending_section(calibration.tree.bending, calibration.at, document),
        _noise(calibration, document),
        shared_sections.learned_section(
            document,
            calibration.uncertainty,
            *([] if FLANGE in calibration.tree.motions else [frames]),
        ),
        _provenance(calibration, document),
    )
    things = "observations"
    poses = document[telling_set(document, things)[0]]["poses"]
    quantity = headline_quantity(document, things)
    key = key_number(document, quantity, things, note=f"{poses} poses")
    outliers = calibration.solution.outliers
    sets = (("held-out", calibration.test, None), ("training", calibration.train, outliers))
    return Report(
        calibration.name,
        about,
        document,
        key,
        sections,
        scene,
        (
            *((_zeros(document), *told_by_update(document)) if anew else ()),
            *_learned(calibration, document),
        ),
        _residuals_csv(sets),
    )


def _errors(calibration: TreeCalibration, document: Mapping[str, Any]) -> parts.Section:
    tables, drawing, inliers = [], None, ~calibration.solution.outliers
    space = calibration.train.in_space
    for quantity, unit, kinds, heading, words in (
        ("position_mm", "mm", space, "in space [mm]", _SPACE[POINTS in space]),
        ("pixels", "px", (CAMERA,), "in the images [px]", _IMAGES),
    ):
        if quantity not in document["train"]:
            continue
        factor = 1e3 if unit == "mm" else 1.0
        tables.append((error_table(held_out(document, quantity), heading, 2), words))
        found = (
            (calibration.test, None),
            (calibration.cross_validation, inliers),
            (calibration.train, inliers),
        )
        sets = error_sets(
            *(None if e is None else factor * e.of_kind(*kinds, keep=keep) for e, keep in found)
        )
        figure = distribution(sets, unit=unit, what="error", thing="observation")
        drawing = drawing or parts.drawing(f"Distribution of the errors {heading}", figure, "half")
    if POINTS in space:
        tables.append((_touches(document), "By how much touches and distances are missed."))
    return shared_sections.errors_section(
        document, *tables, few="with so few poses", figure=drawing
    )


def _touches(document: Mapping[str, Any]) -> Table | None:
    """Return by how much touches and distances are missed; nothing without any."""
    rows = []
    for name, entry in document.get("touches", {}).items():
        held = number_cell(entry.get("test_rms_mm"), 3), Cell(str(entry.get("test_n", "")))
        rows.append((name, (number_cell(entry["rms_mm"], 3), Cell(str(entry["n"])), *held)))
    headings = ("touches", "rms [mm]", "n", "held out [mm]", "n")
    return Table(headings, tuple(rows)) if rows else None


def _learned(
    calibration: TreeCalibration, document: Mapping[str, Any]
) -> tuple[parts.Numbers | parts.Text | None, ...]:
    """Return what a flange carries and what sees it; else the tree."""
    if FLANGE not in calibration.tree.motions:
        return _tree(document)
    found = shared_sections.parameter_tables(document, calibration.uncertainty)
    names = [*calibration.tree.joints, *_framed(calibration, found)]
    words = (
        "Hand-eye: places and rotation vectors on what carries each, with standard deviations. A "
        "flange's own row is where its base is in the world."
    )
    return parts.numbers(_frames(found, names)), parts.hint(words)


def _zeros(document: Mapping[str, Any]) -> parts.Numbers | None:
    """Return by how much zeros moved, with their sigmas; nothing where that was not asked."""
    rows = []
    for key, part, factor, digits in (("shift_deg", "rz", 180.0 / np.pi, 2),
                                      ("shift_mm", "z", 1e3, 2)):  # fmt: skip
        for joint, shift in document.get(key, {}).items():
            sigma = factor * document["parameters"][f"{joint}.{part}"]["sigma"]
            cells = number_cell(shift, digits), number_cell(sigma, digits), Cell(key[6:])
            rows.append((joint, cells))
    return parts.numbers(Table(("joint", "at one reading moved by", "\u00b1", "unit"), tuple(rows)))


def _tree(document: Mapping[str, Any]) -> tuple[parts.Numbers | parts.Text | None, ...]:
    """Return the tree, each joint indented below what carries it."""
    depth: dict[str, int] = {"world": -1}
    rows, motions = [], {joint["motion"] for joint in document["joints"]}
    alike = len(motions) == 1
    for joint in document["joints"]:
        depth[joint["name"]] = depth[joint["parent"]] + 1
        # Narrow columns may break a name behind its underscores, and nowhere else.
        name = "\u202f\u202f" * depth[joint["name"]] + joint["name"].replace("_", "_\u200b")
        carried = [*joint["sensors"], *_listed(joint["markers"])]
        cells = (
            *([] if alike else [Cell(joint["motion"])]),
            number_cell(joint["axis_angle_deg"], 2),
            number_cell(joint["axis_distance_mm"], 2),
            Cell(", ".join(carried)),
        )
        rows.append((name, cells))
    moves = () if alike else ("moves",)
    headings = ("joint", *moves, "angle [deg]", "distance [mm]", "carries")
    words = (f"All joints are {motions.pop()}. " if alike else "") + (
        "Angle and distance between each joint's axis and that of the joint which carries it: what "
        "can be told of two axes whatever frames are chosen."
    )
    return parts.numbers(Table(headings, tuple(rows))), parts.hint(words)


def _listed(markers: list[str]) -> list[str]:
    return markers if len(markers) < 2 else [f"{len(markers)} markers"]


def _before_and_now(document: Mapping[str, Any], was: str, before: Any) -> parts.Numbers | None:
    """Return errors before anything was learned, and with it."""
    after = "test" if document["test"] and was == "as described" else "train"
    sets = [
        (f"{label} [{unit}]", block, quantity)
        for quantity, unit in (("position_mm", "mm"), ("pixels", "px"))
        for label, block in ((was, before), ("learned", document[after]))
        if block and quantity in block
    ]
    return parts.numbers(error_table(sets, "the robot", 2))


def _before(document: Mapping[str, Any]) -> list[parts.Section]:
    """Return what the body as it was left of the poses that it learned anew from."""
    if not document.get("before"):
        return []
    words = "Both of the same poses: with the body as it was, and as it is now."
    table = _before_and_now(document, "before", document["before"]["train"])
    return [parts.section("Before and after", table, parts.hint(words), id="before")]


def _against_description(document: Mapping[str, Any]) -> list[parts.Section]:
    """Return how far the robot is from its description; nothing without one."""
    changes, off = document["changes"], document["description_off"]
    if not changes:
        return []
    rows = tuple(
        (
            joint,
            (
                number_cell(entry["turn_deg"], 2),
                number_cell(entry["turn_sigma_deg"], 2),
                number_cell(entry["shift_mm"], 2),
                number_cell(entry["shift_sigma_mm"], 2),
            ),
        )
        for joint, entry in changes.items()
    )
    headings = ("joint", "turned [deg]", "\u00b1", "shifted [mm]", "\u00b1")
    section = parts.section(
        "Against its description",
        _before_and_now(document, "as described", document["described"]),
        parts.numbers(Table(headings, rows)),
        parts.hint(
            "As described: the description's joints with sensors and markers placed as they fit "
            "best. Below, how far each joint's frame is from where its description has it. "
            f"Each part of a frame's turn and place is off by {off['turn_sigma_deg']:.2g} deg and "
            f"{off['shift_sigma_mm']:.2g} mm (standard deviations, "
            f"{'as the data tell' if off['learned'] else 'as was stated'})."
        ),
        id="changes",
    )
    return [section]


def _noise(calibration: TreeCalibration, document: Mapping[str, Any]) -> parts.Section:
    """Return standard deviations of sensors and joints; of joints alike only once."""
    kinds = {sensor.name: sensor.kind for sensor in calibration.data.sensors}
    slips, found = document["slips"], document["noise"]
    turns = ("turn", "orientation")
    rows = [
        (name, _sigma_cells(kinds.get(name, "turn" if name.endswith(turns) else ""), value, ""))
        for name, value in found.items()
        if name not in slips
    ]
    motions = dict(zip(calibration.tree.joints, calibration.tree.motions, strict=True))
    alike: dict[float, list[str]] = {}
    for joint in slips:
        if joint in found:
            alike.setdefault(found[joint], []).append(joint)
    for value, joints in alike.items():
        label = joints[0] if len(joints) == 1 else f"{len(joints)} joints alike"
        wrong = sum(slips[joint] for joint in joints)
        kind = "turn" if motions[joints[0]] == REVOLUTE else ""
        rows.append((label, _sigma_cells(kind, value, str(wrong) if wrong else "none")))
    said = ", ".join(f"{count} of {joint}" for joint, count in slips.items() if count)
    return parts.section(
        "Noise",
        parts.numbers(Table(("of", "sigma", "unit", "wrong readings"), tuple(rows))),
        parts.hint(f"Poses with a wrong reading: {said}.") if said else None,
        parts.hint(
            "Standard deviations that the residuals ask for, each pose's joint noise one draw for "
            "all that was seen of it."
        ),
        id="noise",
    )


_SHOWN = {CAMERA: ("px", 1.0), "turn": ("deg", 180.0 / np.pi)}
"""Unit and factor of a standard deviation, by the kind of sensor or of joint; mm else."""


def _sigma_cells(kind: str, sigma: float, said: str) -> tuple[Cell, ...]:
    unit, factor = _SHOWN.get(kind, ("mm", 1e3))
    return Cell(f"{factor * sigma:.3g}", value=factor * sigma), Cell(unit), Cell(said)


def _framed(calibration: TreeCalibration, found: ParameterTables) -> list[str]:
    """Return the names of sensors, and of markers whose orientation was estimated."""
    tree = calibration.tree
    posed = [m.name for m in tree.markers if f"{m.name}.rx" in found.entries]
    return [*(s.name for s in tree.sensors), *posed]


def _frames(found: ParameterTables, names: list[str]) -> Table | None:
    """Return where sensors, and markers with an orientation, are on their links; one a column."""
    known = tuple(name for name in names if f"{name}.x" in found.entries)
    if not known:
        return None
    rows = [
        (f"{part} [{'deg' if len(part) > 1 else 'mm'}]", [f"{name}.{part}" for name in known])
        for part in ("x", "y", "z", "rx", "ry", "rz")
    ]
    return found.rows(("on its link", *known), rows)


def _provenance(calibration: TreeCalibration, document: Mapping[str, Any]) -> parts.Section:
    start = document["start"]
    found = {
        "data set": calibration.data.name,
        "first body": f"{start['from']}, {start['agreeing']} of {start['tried']} agree",
        "world": document["world"],
        "scale held by": document["scale_from"] or "nothing",
    }
    return shared_sections.provenance_section(document, found)


def _residuals_csv(sets: Iterable[Held]) -> str:
    """Return the length of every observation's residual as CSV, one row each.

    Args:
        sets: Of `TreeErrors`; those that are None are left out.
    """
    return rows_text(
        _RESIDUAL_HEADINGS, (row for one in sets if one[1] for row in _residual_rows(*one))
    )


def _residual_rows(name: str, found: TreeErrors, outliers: NDArray | None) -> Rows:
    data = found.observations.data
    table, samples = data.observations, [*data.sample.tolist(), ""]
    for i, error in enumerate(found.by_row().tolist()):
        sensor = data.sensors[table.sensor[i]]
        in_images = sensor.kind == CAMERA
        size, unit = (error, "px") if in_images else (1e3 * error, "mm")
        marker = data.markers[table.marker[i]].name
        yield name, samples[table.pose[i]], sensor.name, marker, flag(outliers, i), size, unit
