"""The report on mirrors, and the folder that `calibrate mirror` leaves behind."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration
from nico_selfmodel.estimation.results.verdict import Verdict
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.document_tables import facts, parameter_table, statistics_table
from nico_selfmodel.viz.folder import shown, write_folder
from nico_selfmodel.viz.mirror_picture import Pictures
from nico_selfmodel.viz.mirror_scene import mirror_scene
from nico_selfmodel.viz.numbers_shown import decimals
from nico_selfmodel.viz.plot_style import svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.report_tables import Cell, Table
from nico_selfmodel.viz.scene import Scene


def write_mirror_folder(
    folder: str | Path,
    calibration: MirrorCalibration,
    verdict: Verdict,
    document: Mapping[str, Any],
    *,
    pictures: Pictures | None = None,
    robot: ArmDescription | None = None,
    force: bool = False,
) -> Path:
    """Write `self_model.yaml`, `result.json`, `report.html` and `scene.json`, or nothing.

    Args:
        folder: The folder to make.
        calibration: What was learned.
        verdict: What is thought of it.
        document: `estimation.mirror_document` of both.
        pictures: What was seen in the mirrors, if pictures were kept.
        robot: The robot that looked, if it is known.
        force: Replace an existing folder.

    Returns:
        The folder.

    Raises:
        FileExistsError: If the folder exists and `force` is not set.
        OSError: If it cannot be written.
        SelfModelError: If the server that makes the interactive scene cannot start.
    """
    scene = mirror_scene(calibration, pictures, robot)
    report = mirror_report_html(calibration, verdict, document, scene)
    return write_folder(folder, calibration.model, document, shown(report, scene), force=force)


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
        distribution=svg_data_uri(_distribution(calibration)),
        tables={
            "pixels": statistics_table(document, "pixels", "reflection [px]", 3, "n"),
            "position": statistics_table(
                document, "position_mm", "hand rebuilt in the mirror [mm]", 2, "n"
            ),
            "mirrors": _mirror_table(document),
            "parameters": parameter_table(
                document, lambda _, entry: "free" if entry["free"] else "derived"
            ),
        },
        provenance=_provenance(calibration, document),
    )


def _distribution(calibration: MirrorCalibration) -> Figure:
    """Draw the distribution of errors: held out, left out in turn, learned from."""
    train = calibration.train.select(~calibration.solution.outliers).distances_px
    test = None if calibration.test is None else calibration.test.distances_px
    turn = calibration.cross_validation
    sets = error_sets(test, None if turn is None else turn.distances_px, train)
    return distribution(sets, unit="px", digits=2, what="reprojection error", thing="reflection")


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
            Cell(str(entry["poses"]), value=entry["poses"]),
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
        "mirror", "poses", "from left eye [mm]", "normal ± [deg]",
        "hand before it [mm]", "flatness", "plane [px]", "free cameras [px]",
    )  # fmt: skip
    return Table(headings, tuple(rows))


def _provenance(calibration: MirrorCalibration, document: Mapping[str, Any]) -> dict[str, str]:
    """Return what the mirrors were learned from and with."""
    found = dict(calibration.model.provenance.get("mirrors", {}))
    found["noise of a pixel coordinate"] = f"{document['pixel_sigma_px']:g} px"
    found["play of a joint"] = f"{document['joint_sigma_deg']:.2f} deg"
    found["misfit over what noise explains"] = f"{document['noise_ratio']:.2f}"
    found["steps of the solver"] = document["iterations"]
    found["seconds"] = f"{document['seconds']:.2f}"
    return facts(found)
