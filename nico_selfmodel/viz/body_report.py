"""The report on a body: one page that needs nothing else, the verdict first."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nico_selfmodel.estimation import BodyCalibration, PixelEvaluation, Verdict, WorkspaceAccuracy
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.body_scene import accuracy_at, body_scene
from nico_selfmodel.viz.distribution_plot import ErrorSet, distribution
from nico_selfmodel.viz.drake_backend import static_html
from nico_selfmodel.viz.model_folder import write_model_folder
from nico_selfmodel.viz.parameter_plots import correlations
from nico_selfmodel.viz.plot_style import FULL_WIDTH, headline, style, svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.report_tables import SETS, STATISTICS, Cell, Table
from nico_selfmodel.viz.result_folder import SCENE_FILE
from nico_selfmodel.viz.scene import Scene

_HEADINGS = tuple({"sd": "SD", "p95": "95 %"}.get(name, name) for name in STATISTICS)


def write_body_folder(
    folder: str | Path,
    calibration: BodyCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    *,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html`, `scene.json` and the URDF, or nothing.

    Args:
        folder: The folder to make.
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.body_document` of both.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    scene = body_scene(calibration)
    report = body_report_html(calibration, verdict, document, scene)
    texts = {"report.html": report, SCENE_FILE: scene.to_json()}
    return write_model_folder(folder, calibration.model, document, texts, force=force)


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
        scene_html=static_html(scene),
        figures={name: svg_data_uri(figure) for name, figure in figures.items()},
        tables={
            "pixels": _error_table(document, "pixels", "in the images [px]", 2),
            "position": _error_table(document, "position_mm", "from its own eyes [mm]", 2),
            "boards": _board_table(document),
            "workspace": _workspace_table(document),
            "parameters": _parameter_table(document),
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
    found: tuple[tuple[str, str, PixelEvaluation | None], ...] = (
        ("held-out", palette.HELD_OUT, calibration.test),
        ("cross-validation", palette.CROSS_VALIDATION, calibration.cross_validation),
        ("training", palette.TRAINING, train),
    )
    sets = [
        ErrorSet(label, color, one.pixel_distances)
        for label, color, one in found
        if one is not None and len(one.pixel_distances)
    ]
    return distribution(sets, unit="px", digits=2, what="error in an image", thing="sighting")


def _error_table(
    document: Mapping[str, Any], quantity: str, heading: str, digits: int
) -> Table | None:
    """Return statistics of every set of errors that has this quantity; None where none has."""
    rows = []
    for key, label in SETS:
        block = document[key]
        if block is not None and quantity in block:
            cells = [Cell(str(block["n"]), value=block["n"])]
            values = block[quantity]
            cells += [Cell(f"{values[s]:.{digits}f}", value=values[s]) for s in STATISTICS]
            rows.append((label, tuple(cells)))
    return Table((heading, "poses", *_HEADINGS), tuple(rows)) if rows else None


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
                Cell(f"{scale:+.2f}", value=scale),
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


def _parameter_table(document: Mapping[str, Any]) -> Table:
    """Return every parameter in SI units, to the last digit."""
    rows = []
    for name, entry in document["parameters"].items():
        sigma = entry["sigma"]
        kind = "free" if entry["free"] else "fixed"
        cells = (
            Cell(repr(float(entry["value"])), value=entry["value"]),
            Cell("" if sigma is None else f"{sigma:.3g}", value=sigma),
            Cell("" if entry["unit"] == "1" else entry["unit"]),
            Cell(kind, kind=kind),
        )
        rows.append((name, cells))
    return Table(("parameter", "value", "sigma", "unit", ""), tuple(rows))


def _provenance(calibration: BodyCalibration, document: Mapping[str, Any]) -> dict[str, str]:
    """Return what the body was learned from and with."""
    facts = {
        **calibration.model.provenance,
        "stage": document["stage"],
        "variant": document["variant"],
        "arm_started_from": document["start"]["arm"],
        "scale_held_by": document["scale_from"],
        "noise_of_the_tracker": f"{document['pixel_sigma_px']:.2f} px",
        "play_of_a_joint,_standard_deviation": f"{document['joint_sigma_deg']:.2f} deg",
        "robot": json.dumps(dict(calibration.model.robot)) if calibration.model.robot else "none",
        "steps_of_the_solver": document["iterations"],
        "seconds": f"{document['seconds']:.2f}",
    }
    return {str(key).replace("_", " "): str(value) for key, value in facts.items()}
