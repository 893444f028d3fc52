"""The report on a body: arm and cameras that refined each other by watching the hand."""

import json
from collections.abc import Mapping
from typing import Any

from nico_selfmodel.estimation import BodyCalibration
from nico_selfmodel.estimation.body_document import noise_words
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz.body_scene import accuracy_at, body_scene
from nico_selfmodel.viz.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.workspace_map import workspace_map
from nico_selfmodel.viz.numbers_shown import signed
from nico_selfmodel.viz.reports.page import Report, key_number
from nico_selfmodel.viz.reports.parameter_tables import (
    joint_table,
    lens_table,
    place_table,
    pose_table,
)
from nico_selfmodel.viz.reports.sections import (
    Folded,
    Numbers,
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
    outlier_text,
    parameters_of,
    provenance_section,
    scene_section,
    unobservable_section,
)
from nico_selfmodel.viz.reports.tables import (
    Cell,
    Table,
    change_table,
    error_table,
    held_out_table,
    number_cell,
)
from nico_selfmodel.viz.scene import Scene

_MOST_CHANGES = 8
"""Changes that are shown unfolded, beside the lengths."""


def body_report(
    calibration: BodyCalibration,
    document: Mapping[str, Any],
    robot: ArmDescription | None = None,
) -> Report:
    """Return the report on a body.

    Args:
        calibration: What was learned.
        document: `estimation.body_document` of it; the numbers shown are these.
        robot: The robot that the arm belongs to, to be drawn; the model's own if omitted.

    Raises:
        ModelError: If the robot is gone, or has other joints.
    """
    robot = ArmDescription.of_model(calibration.model) if robot is None else robot
    scene = body_scene(calibration, robot)
    about = "What a body learned about its arm and its cameras by watching its own hand"
    key = key_number(document, "pixels", "observations")
    sections = body_sections(calibration, document, scene)
    return Report(calibration.model.name, about, document, key, sections, scene)


def body_sections(
    calibration: BodyCalibration, document: Mapping[str, Any], scene: Scene
) -> tuple[Section, ...]:
    """Return what observations of the hand tell of a body, section by section."""
    boards = _boards(document)
    return (
        _errors(calibration, document),
        *((boards,) if boards else ()),
        _changes(document),
        section(
            "How surely the hand is known",
            numbers(_workspace_table(document)),
            drawing(
                workspace_map(accuracy_at(calibration)),
                "Uncertainty of the hand over the workspace, from above",
            ),
            id="workspace",
        ),
        scene_section("The body", scene),
        _parameters(calibration, document),
        _provenance(calibration, document),
    )


def _errors(calibration: BodyCalibration, document: Mapping[str, Any]) -> Section:
    space = numbers(
        held_out_table(document, "position_mm", "from its own cameras [mm]", 2), "errors"
    )
    no_truth = (
        "Distance of the expected hand from where the body's own cameras rebuild it. It is no "
        "ground truth: an arm and cameras that err alike look perfect here, so look at the boards "
        "as well."
    )
    train = calibration.train.select(~calibration.outliers)
    found = (calibration.test, calibration.cross_validation, train)
    sets = error_sets(*(None if one is None else one.pixel_distances for one in found))
    figure = distribution(sets, unit="px", digits=2, what="error in an image", thing="observation")
    return section(
        "",
        numbers(held_out_table(document, "pixels", "in the images [px]", 2), "errors"),
        Text(
            "Distance of each observation from where the body expects it, each camera counted by "
            "itself.",
            "hint",
        ),
        outlier_text(document),
        space,
        Text(no_truth, "hint") if space else None,
        beside(drawing(figure, "Distribution of the errors in the images", "half")),
        id="errors",
    )


def _boards(document: Mapping[str, Any]) -> Section | None:
    """Return how boards are rebuilt before and after; None without boards."""
    boards = document["boards"]
    if boards is None:
        return None
    rows = []
    for label in ("before", "after"):
        found = boards[label]
        if found is not None:
            scale = 100.0 * (found["scale"]["mean"] - 1.0)
            cells = (
                number_cell(found["boards"]),
                number_cell(found["edge_mm"]["sd"], 2),
                Cell(signed(scale, 2), value=scale),
                number_cell(found["position_mm"]["mean"], 2),
            )
            rows.append((label, cells))
    kind = "held-out boards" if boards["held_out"] else "boards learned from"
    headings = (kind, "boards", "edges' SD [mm]", "scale [%]", "corner [mm]")
    return section(
        "Do the cameras still measure?",
        numbers(Table(headings, tuple(rows))),
        Text(
            "A chessboard rebuilt by triangulation, by the cameras that the refinement started "
            "from and by those it ended with. The result is refused where the second row is worse.",
            "hint",
        ),
        id="boards",
    )


def _changes(document: Mapping[str, Any]) -> Section:
    changes = document["before"]["changes"]
    return section(
        "What learning together changed",
        numbers(_before_table(document)),
        Text(
            "Before: arm and cameras as they were learned one after the other, or as they were "
            "given. Errors that stay the same say that what is left is joint noise and the "
            "tracker, not the model of the body.",
            "hint",
        ),
        numbers(change_table(_largest(changes))),
        Text(
            "The numbers that moved most for what they are still uncertain by, and the lengths.",
            "hint",
        ),
        Folded(f"All {len(changes)} changes", (Numbers(change_table(changes)),)),
        id="before",
    )


def _before_table(document: Mapping[str, Any]) -> Table | None:
    """Return errors of the start and of the end, on the same data."""
    before = document["before"]
    pairs = (("before", before), ("after", document[before["on"]]))
    blocks = [
        (f"{label} [{unit}]", block, quantity)
        for quantity, unit in (("pixels", "px"), ("position_mm", "mm"))
        for label, block in pairs
    ]
    kind = "held-out poses" if before["on"] == "test" else "training poses"
    return error_table(blocks, kind, 2)


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


def _parameters(calibration: BodyCalibration, document: Mapping[str, Any]) -> Section:
    model = calibration.model
    parameters = parameters_of(document, calibration.uncertainty)
    return section(
        "What was learned",
        numbers(joint_table(parameters, model.joints)),
        numbers(place_table(parameters, model.markers)),
        numbers(lens_table(parameters, tuple(model.cameras))),
        numbers(pose_table(parameters)),
        all_parameters(parameters),
        unobservable_section(document),
        correlation_figure(document, calibration.uncertainty),
        message="Below each value its standard deviation; fixed values are chosen, not measured.",
        id="parameters",
    )


def _workspace_table(document: Mapping[str, Any]) -> Table:
    """Return what the hand is uncertain by, and why."""
    work, rows = document["workspace"], []
    names = {"learned": "reducible by more data", "mechanics": "irreducible: joint noise"}
    for key, label in names.items():
        blocks = [work.get(f"{key}_{unit}") or {} for unit in ("mm", "px")]
        cells = [number_cell(block.get(part), 2) for block in blocks for part in ("mean", "max")]
        rows.append((label, tuple(cells)))
    headings = ("hand known to, rms", "mean [mm]", "largest", "mean [px]", "largest")
    return Table(headings, tuple(rows))


def _provenance(calibration: BodyCalibration, document: Mapping[str, Any]) -> Section:
    tracker, joints = (words.replace("+-", "±") for words in noise_words(document))
    robot = calibration.model.robot
    found = {
        **calibration.model.provenance,
        "stage": document["stage"],
        "variant": document["variant"],
        "arm started from": document["start"]["arm"],
        "scale held by": document["scale_from"],
        "noise of the tracker": tracker,
        "joint noise, standard deviation": joints,
        "robot": json.dumps(dict(robot)) if robot else "none",
    }
    return provenance_section(document, found)
