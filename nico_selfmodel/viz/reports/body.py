"""The report on a body: arm and cameras that refined each other by watching the hand."""

import json
from collections.abc import Mapping
from functools import partial
from typing import Any

from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.body.body_result import noise_words
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.numbers_shown import decimals, signed
from nico_selfmodel.viz.figures.workspace_map import workspace_map
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.bending_section import bending_section
from nico_selfmodel.viz.reports.page import Key, Report, headline_quantity, key_number, telling_set
from nico_selfmodel.viz.reports.parameter_tables import (
    joint_table,
    lens_table,
    place_table,
    pose_table,
)
from nico_selfmodel.viz.reports.pixel_rows import pixels_csv
from nico_selfmodel.viz.reports.tables import Cell, Table, error_table, held_out, number_cell
from nico_selfmodel.viz.scene.body_scene import accuracy_at, body_scene


def body_report(
    calibration: BodyCalibration,
    document: Mapping[str, Any],
    robot: ArmDescription | None = None,
) -> Report:
    """Return what observations of the hand tell of a body.

    Args:
        document: `estimation.judging.to_json` of it; the numbers shown are these.
        robot: The robot that the arm belongs to, to be drawn; the model's own if omitted.

    Raises:
        ModelError: If the robot is gone, or has other joints.
    """
    model = calibration.model
    scene = body_scene(calibration, ArmDescription.of_model(model) if robot is None else robot)
    outliers = calibration.outliers
    about = "What a body learned about its arm and its cameras by watching its own hand"
    sections = (
        _errors(calibration, document),
        *_boards(document),
        _changes(document),
        *bending_section(model.bending, calibration.at, document),
        _workspace(calibration, document),
        shared_sections.learned_section(
            document,
            calibration.uncertainty,
            partial(lens_table, cameras=tuple(model.cameras)),
            pose_table,
            partial(place_table, markers=model.markers),
        ),
        _provenance(calibration, document),
    )
    sets = (("held-out", calibration.test, None), ("training", calibration.train, outliers))
    return Report(
        model.name,
        about,
        document,
        _key(document),
        sections,
        scene,
        _learned(calibration, document),
        pixels_csv(sets),
    )


def _key(document: Mapping[str, Any]) -> Key:
    """Return the error in millimetres, and beside it that in the images."""
    quantity, things = headline_quantity(document, "poses"), "poses"
    if quantity == "pixels":
        return key_number(document, quantity, things)
    block = document[telling_set(document, things)[0]]
    pixels = block.get("pixels")
    seen = "" if not pixels else f"{pixels['mean']:.2f} px in the images"
    return key_number(document, quantity, things, note=seen)


def _learned(
    calibration: BodyCalibration, document: Mapping[str, Any]
) -> tuple[parts.Numbers | parts.Text | None, ...]:
    """Return the arm's rows, and how far apart the cameras are."""
    found = shared_sections.parameter_tables(document, calibration.uncertainty)
    baseline = found.entries.get("baseline")
    words = "Below each value its standard deviation; fixed values are chosen, not measured."
    if baseline is not None:
        apart = decimals(1e3 * baseline["value"], 1e3 * (baseline["sigma"] or 0.0) or None)
        words = f"The cameras stand {apart} mm apart. {words}"
    return parts.numbers(joint_table(found, calibration.model.joints)), parts.hint(words)


def _errors(calibration: BodyCalibration, document: Mapping[str, Any]) -> parts.Section:
    train = calibration.train.select(~calibration.outliers)
    found = (calibration.test, calibration.cross_validation, train)
    sets = error_sets(*(None if one is None else one.pixel_distances for one in found))
    figure = distribution(sets, unit="px", what="error in an image", thing="observation")
    return shared_sections.errors_section(
        document,
        (
            error_table(held_out(document, "pixels"), "in the images [px]", 2),
            "Distance of each observation from where the body expects it, each camera counted by "
            "itself.",
        ),
        (
            error_table(held_out(document, "position_mm"), "from its own cameras [mm]", 2),
            "Distance of the expected hand from where the body's own cameras rebuild it. It is no "
            "ground truth: an arm and cameras that err alike look perfect here, so look at the "
            "boards as well.",
        ),
        few="with so few poses",
        figure=parts.drawing("Distribution of the errors in the images", figure, "half"),
    )


def _boards(document: Mapping[str, Any]) -> list[parts.Section]:
    """Return how boards are rebuilt before and after; nothing without boards."""
    boards = document["boards"]
    if boards is None:
        return []
    pairs = ((label, boards[label]) for label in ("before", "after"))
    rows = tuple((label, _board_cells(found)) for label, found in pairs if found is not None)
    kind = "held-out boards" if boards["held_out"] else "boards learned from"
    table = Table((kind, "boards", "edges' SD [mm]", "scale [%]", "corner [mm]"), rows)
    words = (
        "A chessboard rebuilt by triangulation, by the cameras that the refinement started from "
        "and by those it ended with. The result is refused where the second row is worse."
    )
    title = "Do the cameras still measure?"
    return [parts.section(title, parts.numbers(table), parts.hint(words), id="boards")]


def _board_cells(found: Mapping[str, Any]) -> tuple[Cell, ...]:
    scale = 100.0 * (found["scale"]["mean"] - 1.0)
    return (
        number_cell(found["boards"]),
        number_cell(found["edge_mm"]["sd"], 2),
        Cell(signed(scale, 2), value=scale),
        number_cell(found["position_mm"]["mean"], 2),
    )


def _changes(document: Mapping[str, Any]) -> parts.Section:
    return shared_sections.changes_section(
        "What learning together changed",
        document,
        (("pixels", "px"), ("position_mm", "mm")),
        "poses",
        "Before: arm and cameras as they were learned one after the other, or as they were "
        "given. Errors that stay the same say that what is left is joint noise and the "
        "tracker, not the model of the body.",
        "The numbers that moved most for what they are still uncertain by, and the lengths.",
    )


def _workspace(calibration: BodyCalibration, document: Mapping[str, Any]) -> parts.Section:
    """Return what the hand is uncertain by, and why."""
    work, rows = document["workspace"], []
    causes = {"learned": "reducible by more data", "mechanics": "irreducible: joint noise"}
    for key, label in causes.items():
        blocks = [work.get(f"{key}_{unit}") or {} for unit in ("mm", "px")]
        cells = [number_cell(block.get(part), 2) for block in blocks for part in ("mean", "max")]
        rows.append((label, tuple(cells)))
    headings = ("hand known to, rms", "mean [mm]", "largest", "mean [px]", "largest")
    about = "Uncertainty of the hand over the workspace, from above"
    return parts.section(
        "How surely the hand is known",
        parts.numbers(Table(headings, tuple(rows))),
        parts.drawing(about, workspace_map(accuracy_at(calibration))),
        id="workspace",
    )


def _provenance(calibration: BodyCalibration, document: Mapping[str, Any]) -> parts.Section:
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
    return shared_sections.provenance_section(document, found)
