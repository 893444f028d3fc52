"""The report on mirrors, and the folder that `calibrate mirror` leaves behind."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from nico_selfmodel.estimation.mirror import MirrorCalibration
from nico_selfmodel.estimation.verdict import Verdict
from nico_selfmodel.files import RESULT_FILE, folder_written_whole
from nico_selfmodel.viz import palette
from nico_selfmodel.viz.distribution_plot import ErrorSet, distribution
from nico_selfmodel.viz.drake_backend import static_html
from nico_selfmodel.viz.mirror_scene import mirror_scene
from nico_selfmodel.viz.numbers_shown import decimals
from nico_selfmodel.viz.plot_style import svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.report_tables import SETS, STATISTICS, Cell, Table
from nico_selfmodel.viz.result_folder import SCENE_FILE
from nico_selfmodel.viz.scene import Scene

_HEADINGS = tuple({"sd": "SD", "p95": "95 %"}.get(name, name) for name in STATISTICS)


def write_mirror_folder(
    folder: str | Path,
    calibration: MirrorCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    *,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html` and `scene.json`, or nothing.

    Args:
        folder: The folder to make.
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.mirror_document` of both.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    scene = mirror_scene(calibration)
    texts = {
        RESULT_FILE: json.dumps(document, allow_nan=False, indent=1) + "\n",
        "report.html": mirror_report_html(calibration, verdict, document, scene),
        SCENE_FILE: scene.to_json(),
    }
    with folder_written_whole(folder, force=force) as inside:
        calibration.model.save(inside / "self_model.yaml")
        for name, text in texts.items():
            (inside / name).write_text(text, encoding="utf-8", newline="\n")
    return Path(folder)


def mirror_report_html(
    calibration: MirrorCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    scene: Scene | None = None,
) -> str:
    """Return the report as one self-contained page.

    Args:
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.mirror_document` of both; the numbers shown are these.
        scene: The scene to embed; made from the calibration if omitted.

    Returns:
        HTML that loads nothing from anywhere.

    Raises:
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    scene = mirror_scene(calibration) if scene is None else scene
    return page(
        "mirror_report.html.j2",
        calibration.model.name,
        verdict,
        document=document,
        key=key_statistics(document, "pixels", "reflections"),
        scene=scene,
        scene_html=static_html(scene),
        distribution=svg_data_uri(_distribution(calibration)),
        tables={
            "pixels": _error_table(document, "pixels", "reflection [px]", 3),
            "position": _error_table(document, "position_mm", "hand rebuilt in the mirror [mm]", 2),
            "mirrors": _mirror_table(document),
            "parameters": _parameter_table(document),
        },
        provenance=_provenance(calibration, document),
    )


def _distribution(calibration: MirrorCalibration) -> Figure:
    """Draw the distribution of errors: held out, left out in turn, learned from."""
    train = calibration.train.select(~calibration.solution.outliers).distances_px
    sets = [
        ErrorSet(label, color, errors)
        for label, color, errors in (
            (
                "held-out",
                palette.HELD_OUT,
                np.zeros(0) if calibration.test is None else calibration.test.distances_px,
            ),
            ("cross-validation", palette.CROSS_VALIDATION, calibration.cross_validation),
            ("training", palette.TRAINING, train),
        )
        if len(errors)
    ]
    return distribution(sets, unit="px", digits=2, what="reprojection error", thing="reflection")


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
    return Table((heading, "n", *_HEADINGS), tuple(rows)) if rows else None


def _mirror_table(document: Mapping[str, Any]) -> Table:
    """Return one row a mirror."""
    rows = []
    for name, entry in document["mirrors"].items():
        sigma = document["parameters"][f"mirror.{name}.distance"]["sigma"]
        known = None if sigma is None else 1e3 * sigma
        test, free = entry["flatness"], entry["free_cameras"]
        flat = "not tested" if test is None else "flat" if test["flat"] else "not flat"
        note = "" if test is None else f"{test['by_chance']:.2g} by chance"
        near, far = entry["hand_in_front_mm"]
        cells = (
            Cell(str(entry["rows"]), value=entry["rows"]),
            Cell(
                decimals(entry["distance_mm"], known),
                "" if known is None else f"± {decimals(known, known)}",
                value=entry["distance_mm"],
            ),
            Cell(f"{entry['normal_sigma_deg']:.3f}", value=entry["normal_sigma_deg"]),
            Cell(f"{near:.0f} to {far:.0f}"),
            Cell(flat, note, "blind" if flat == "not flat" else ""),
            Cell("" if entry["pixels"] is None else f"{entry['pixels']['pixels']['mean']:.2f}"),
            Cell("" if free is None else f"{free['pixels']['mean']:.2f}"),
        )
        rows.append((name, cells))
    headings = (
        "mirror", "poses", "from the left eye [mm]", "normal known to [deg]",
        "hand before it [mm]", "flatness", "one plane [px]", "two free cameras [px]",
    )  # fmt: skip
    return Table(headings, tuple(rows))


def _parameter_table(document: Mapping[str, Any]) -> Table:
    """Return every parameter in SI units, to the last digit."""
    rows = []
    for name, entry in document["parameters"].items():
        sigma = entry["sigma"]
        kind = "free" if entry["free"] else "derived"
        cells = (
            Cell(repr(float(entry["value"])), value=entry["value"]),
            Cell("" if sigma is None else f"{sigma:.3g}", value=sigma),
            Cell("" if entry["unit"] == "1" else entry["unit"]),
            Cell(kind, kind=kind),
        )
        rows.append((name, cells))
    return Table(("parameter", "value", "sigma", "unit", ""), tuple(rows))


def _provenance(calibration: MirrorCalibration, document: Mapping[str, Any]) -> dict[str, str]:
    """Return what the mirrors were learned from and with."""
    facts = dict(calibration.model.provenance.get("mirrors", {}))
    facts["noise of a pixel coordinate"] = f"{document['pixel_sigma_px']:g} px"
    facts["play of a joint"] = f"{document['joint_sigma_deg']:.2f} deg"
    facts["misfit over what noise explains"] = f"{document['noise_ratio']:.2f}"
    facts["steps of the solver"] = document["iterations"]
    facts["seconds"] = f"{document['seconds']:.2f}"
    return {str(key).replace("_", " "): str(value) for key, value in facts.items()}
