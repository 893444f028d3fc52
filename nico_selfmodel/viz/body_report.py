"""The report on a body: one page that needs nothing else, the verdict first."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation import BodyCalibration, Verdict, WorkspaceAccuracy
from nico_selfmodel.estimation.body.body_result import noise_words
from nico_selfmodel.files import refuse_folder
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.body_scene import accuracy_at, body_scene
from nico_selfmodel.viz.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.document_tables import (
    HEADINGS,
    change_table,
    facts,
    parameter_table,
    statistics_cells,
    statistics_table,
)
from nico_selfmodel.viz.folder import shown
from nico_selfmodel.viz.model_folder import write_model_folder
from nico_selfmodel.viz.numbers_shown import signed
from nico_selfmodel.viz.parameter_plots import correlations
from nico_selfmodel.viz.plot_style import FULL_WIDTH, headline, style, svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.report_tables import Cell, Table
from nico_selfmodel.viz.scene import Scene

_MOST_CHANGES = 8
"""Changes that are shown unfolded, beside the lengths."""


def write_body_folder(
    folder: str | Path,
    calibration: BodyCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    *,
    robot: ArmDescription | None = None,
    recordings: Mapping[str, Dataset] | None = None,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html`, `scene.json` and the URDF, or nothing.

    Args:
        folder: The folder to make.
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.body_document` of both, with what else `result.json` should tell.
        robot: The robot that the arm belongs to, to be drawn; the model's own if omitted.
        recordings: Data sets to keep beside the result, in `recordings/<name>`.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        ModelError: If the robot is gone, or has other joints.
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    refuse_folder(folder, force=force)
    robot = ArmDescription.of_model(calibration.model) if robot is None else robot
    scene = body_scene(calibration, robot)
    texts = shown(body_report_html(calibration, verdict, document, scene), scene)
    return write_model_folder(folder, calibration.model, document, texts, recordings, force=force)


def body_report_html(
    calibration: BodyCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    scene: Scene | None = None,
) -> str:
    """Return the report as one self-contained page.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.body_document` of both; the numbers shown are these.
        scene: The scene to embed; made from the calibration if omitted.

    Returns:
        HTML that loads nothing from anywhere.

    Raises:
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    scene = body_scene(calibration) if scene is None else scene
    figures = {
        "distribution": _distribution(calibration),
        "workspace": workspace_map(accuracy_at(calibration)),
        "correlation": correlations(calibration.uncertainty),
    }
    return page(
        "body_report.html.j2",
        calibration.model.name,
        verdict,
        document=document,
        key=key_statistics(document, "pixels", "sightings"),
        scene=scene,
        figures={name: svg_data_uri(figure) for name, figure in figures.items()},
        tables={
            "pixels": statistics_table(document, "pixels", "in the images [px]", 2),
            "position": statistics_table(document, "position_mm", "from its own eyes [mm]", 2),
            "before": _before_table(document),
            "changes": change_table(_largest(document["before"]["changes"])),
            "all_changes": change_table(document["before"]["changes"]),
            "boards": _board_table(document),
            "workspace": _workspace_table(document),
            "parameters": parameter_table(
                document, lambda _, entry: "free" if entry["free"] else "fixed"
            ),
        },
        provenance=_provenance(calibration, document),
    )


def workspace_map(accuracy: WorkspaceAccuracy) -> Figure:
    """Draw how surely the hand is known, from above, split into what cures it and what stays.

    Args:
        accuracy: Figures at poses, in the left eye's frame.

    Returns:
        Three panels with one scale: what more data cure, what the mechanics leave, and both.
    """
    parts = (
        ("more data would cure", accuracy.learned),
        ("the mechanics leave", accuracy.mechanics),
        ("both", accuracy.total),
    )
    scale = Normalize(0.0, 1e3 * float(accuracy.total.max()))
    with style():
        figure = Figure(figsize=(FULL_WIDTH, 4.0))
        panels = figure.subplots(1, 3)
        for axes, (title, part) in zip(panels, parts, strict=True):
            order = np.argsort(part)
            axes.scatter(
                1e3 * accuracy.p_LH[order, 0],
                1e3 * accuracy.p_LH[order, 2],
                c=1e3 * part[order],
                cmap=palette.ERRORS,
                norm=scale,
                s=18.0,
                edgecolors="none",
            )
            axes.set_title(f"{title}: mean {1e3 * part.mean():.2f} mm", loc="left")
            axes.set_xlabel("to the right [mm]")
            axes.set_aspect("equal", adjustable="datalim")
        panels[0].set_ylabel("ahead of the left eye [mm]")
        bar = figure.colorbar(ScalarMappable(scale, palette.ERRORS), ax=panels, pad=0.01, aspect=28)
        bar.set_label("rms error of the hand [mm]")
        bar.outline.set_visible(False)
        share = 100.0 * accuracy.curable
        headline(figure, f"More data would cure {share:.0f} % of the hand's mean squared error")
    return figure


def _distribution(calibration: BodyCalibration) -> Figure:
    """Draw the distribution of errors in the images."""
    train = calibration.train.select(~calibration.outliers)
    found = (calibration.test, calibration.cross_validation, train)
    sets = error_sets(*(None if one is None else one.pixel_distances for one in found))
    return distribution(sets, unit="px", digits=2, what="error in an image", thing="sighting")


def _before_table(document: Mapping[str, Any]) -> Table:
    """Return errors of the start and of the end, on the same data."""
    before = document["before"]
    after, rows = document[before["on"]], []
    for quantity, unit in (("pixels", "px"), ("position_mm", "mm")):
        for label, block in (("before", before), ("after", after)):
            if block is not None and quantity in block:
                rows.append((f"{label} [{unit}]", statistics_cells(block, quantity, 2)))
    kind = "held-out poses" if before["on"] == "test" else "training poses"
    return Table((kind, "poses", *HEADINGS), tuple(rows))


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


def _board_table(document: Mapping[str, Any]) -> Table | None:
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
                Cell(str(found["boards"]), value=found["boards"]),
                Cell(f"{found['edge_mm']['sd']:.2f}", value=found["edge_mm"]["sd"]),
                Cell(signed(scale, 2), value=scale),
                Cell(f"{found['position_mm']['mean']:.2f}", value=found["position_mm"]["mean"]),
            )
            rows.append((label, cells))
    kind = "held-out boards" if boards["held_out"] else "boards learned from"
    return Table((kind, "boards", "edges' SD [mm]", "scale [%]", "corner [mm]"), tuple(rows))


def _workspace_table(document: Mapping[str, Any]) -> Table:
    """Return what the hand is uncertain by, and why."""
    work, rows = document["workspace"], []
    names = {"learned": "more data would cure", "mechanics": "the mechanics leave"}
    for key, label in names.items():
        cells = []
        for unit in ("mm", "px"):
            block = work.get(f"{key}_{unit}")
            for part in ("mean", "max"):
                cells.append(  # noqa: PERF401
                    Cell("") if block is None else Cell(f"{block[part]:.2f}", value=block[part])
                )
        rows.append((label, tuple(cells)))
    headings = ("hand known to, rms", "mean [mm]", "largest", "mean [px]", "largest")
    return Table(headings, tuple(rows))


def _provenance(calibration: BodyCalibration, document: Mapping[str, Any]) -> dict[str, str]:
    """Return what the body was learned from and with."""
    tracker, play = (words.replace("+-", "±") for words in noise_words(document))
    found = {
        **calibration.model.provenance,
        "stage": document["stage"],
        "variant": document["variant"],
        "arm_started_from": document["start"]["arm"],
        "scale_held_by": document["scale_from"],
        "noise_of_the_tracker": tracker,
        "play_of_a_joint,_standard_deviation": play,
        "robot": json.dumps(dict(calibration.model.robot)) if calibration.model.robot else "none",
        "steps_of_the_solver": document["iterations"],
        "seconds": f"{document['seconds']:.2f}",
    }
    return facts(found)
