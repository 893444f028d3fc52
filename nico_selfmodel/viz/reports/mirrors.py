"""The report on mirrors that were learned from the reflected hand, and on the shape of links."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.viz.figures.distribution_plot import distribution, error_sets
from nico_selfmodel.viz.figures.numbers_shown import decimals
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.page import Key, Report, key_number
from nico_selfmodel.viz.reports.pixel_rows import pixels_csv
from nico_selfmodel.viz.reports.tables import Cell, Table, error_table, held_out, number_cell
from nico_selfmodel.viz.scene.mirror_picture import Pictures
from nico_selfmodel.viz.scene.mirror_scene import mirror_scene
from nico_selfmodel.viz.scene.robot.shape_items import shape_scene
from nico_selfmodel.viz.scene.surroundings import upright

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription


_FEW = 4
"""More mirrors than this stand below each other in a table."""
_SHAPE = (
    "Sigma is along the normal of a vertex. Seen is what enough pictures show and is known to "
    "3 mm; all else of a surface is held by smoothness alone, and grey."
)


def mirror_report(
    calibration: MirrorCalibration,
    document: Mapping[str, Any],
    pictures: Pictures | None = None,
    robot: "ArmDescription | None" = None,
) -> Report:
    """Return what reflections of the hand tell of mirrors.

    Args:
        document: `estimation.judging.to_json` of it; the numbers shown are these.
        pictures: What was seen in the mirrors, if pictures were kept.
        robot: The robot that looked, if it is known.
    """
    scene = mirror_scene(calibration, pictures, robot)
    count = len(document["mirrors"])
    what, where = ("a mirror", "it") if count == 1 else (f"{count} mirrors", "them")
    about = f"What a body learned about {what} by watching its own hand in {where}"
    sections = (
        _errors(calibration, document),
        shared_sections.learned_section(document, calibration.solution.uncertainty),
        _provenance(calibration, document),
    )
    key = key_number(document, "pixels", "reflections")
    sets = (
        ("held-out", calibration.test, None),
        ("training", calibration.train, calibration.solution.outliers),
    )
    learned, rows = _planes(document), pixels_csv(sets)
    return Report(calibration.model.name, about, document, key, sections, scene, learned, rows)


def _errors(calibration: MirrorCalibration, document: Mapping[str, Any]) -> parts.Section:
    train = calibration.train.select(~calibration.solution.outliers)
    found = (calibration.test, calibration.cross_validation, train)
    sets = error_sets(*(None if one is None else one.distances_px for one in found))
    figure = distribution(sets, unit="px", what="reprojection error", thing="reflection")
    return shared_sections.errors_section(
        document,
        (
            error_table(held_out(document, "pixels"), "reflection [px]", 3, "n"),
            "Distance of each observed reflection from where the body expects it, each camera "
            "counted by itself.",
        ),
        (
            error_table(
                held_out(document, "position_mm"), "hand rebuilt in the mirror [mm]", 2, "n"
            ),
            "Distance of the hand as both cameras rebuild it through the mirror from where the arm "
            "says it is. A reflection is as far away as camera, glass and hand together: most of "
            "this is stereo's depth, which no knowledge of the mirror improves.",
        ),
        few="with so few poses",
        figure=parts.drawing("Distribution of the reprojection errors", figure, "half"),
    )


def _planes(document: Mapping[str, Any]) -> tuple[parts.Numbers | parts.Text, ...]:
    """Return one column a mirror: where the glass is, and whether it is flat."""
    headings = (
        "poses", "from left camera [mm]", "normal ± [deg]",
        "hand before it [mm]", "flatness", "plane [px]", "free cameras [px]",
    )  # fmt: skip
    columns = [
        _mirror_cells(entry, document["parameters"][f"mirror.{name}.distance"]["sigma"])
        for name, entry in document["mirrors"].items()
    ]
    rows = tuple(zip(headings, zip(*columns, strict=True), strict=True))
    angles = document["angles_deg"].items()
    few = len(columns) <= _FEW
    return (
        parts.Numbers(Table(("mirror", *document["mirrors"]), rows))
        if few
        else parts.Numbers(
            Table(
                ("mirror", *headings),
                tuple(zip(document["mirrors"], map(tuple, columns), strict=True)),
            ),
            "cards",
        ),
        parts.hint(
            "The normal follows the great circle from a mirror that faces the left camera, by "
            "`tilt_x` to the image's right and `tilt_y` upwards. A plane is three numbers for both "
            "cameras. Two free cameras are the thesis' way, six numbers a camera: where they fit "
            "better than chance allows, the glass is not flat, or the body is not what the "
            "self-model says."
        ),
        *(parts.Text(f"Angle between {pair}: {angle:.3f}°.") for pair, angle in angles if few),
    )


def shape_report(
    calibration: MirrorCalibration,
    shape: BodyShape,
    document: Mapping[str, Any],
    robot: "ArmDescription | None" = None,
) -> Report:
    """Return the shape of links that pictures in mirrors told, and the mirrors.

    Args:
        calibration: Where the mirrors stand.
        shape: What was learned in them.
        document: `estimation.judging.to_json` of the mirrors, and `shape`.
        robot: The robot that looked, if it is known.
    """
    told = mirror_report(calibration, document, robot=robot)
    mirrors = parts.section("The mirrors", *told.learned, id="mirrors")
    sections = (mirrors, *told.sections)
    return _shape_report(
        calibration.model, shape, document, robot, "mirrors", sections, told.residuals
    )


def arm_shape_report(
    model: SelfModel,
    shape: BodyShape,
    document: Mapping[str, Any],
    robot: "ArmDescription | None" = None,
) -> Report:
    """Return the shape of links that pictures of a moving arm told.

    Args:
        model: The arm and its cameras.
        shape: What was learned.
        document: `estimation.judging.to_json` of it, and `shape`.
        robot: The robot, if it is known.
    """
    errors = shared_sections.errors_section(
        document,
        (
            error_table(held_out(document, "pixels"), "hand [px]", 2, "n"),
            "Distance of each observed hand from where the arm expects it, each camera counted "
            "by itself: what joints were off by, of which the shape was freed pose by pose.",
        ),
        few="of a shape",
    )
    return _shape_report(model, shape, document, robot, "poses", (errors,))


def _shape_report(
    model: SelfModel,
    shape: BodyShape,
    document: Mapping[str, Any],
    robot: "ArmDescription | None",
    seen_in: str,
    sections: tuple[parts.Section, ...],
    residuals: str = "",
) -> Report:
    """Return the report on a shape: what was seen of each link, and what else there is to tell."""
    found, X_SW = document["shape"], upright(model, robot)
    links = found["links"].values()
    seen = np.concatenate([one.sigma[one.seen] for one in shape.links.values()])
    sigma = f"{1e3 * float(np.median(seen)):.1f} mm" if len(seen) else "nothing seen"
    note = (
        f"{sum(one['seen'] for one in links)} of {sum(one['vertices'] for one in links)} vertices"
    )
    rows = tuple(
        (link, (number_cell(one["vertices"]), number_cell(one["seen"]),
                number_cell(one["sigma_mm"], 2)))
        for link, one in found["links"].items()
    )  # fmt: skip
    table = Table(("link", "vertices", "seen", "sigma, median [mm]"), rows)
    front = X_SW[:3, :3] @ model.rig.left.X_WC[:3, 2]
    return Report(
        model.name,
        f"The outer shape of {' and '.join(found['links'])}, seen in {found[seen_in]} {seen_in}",
        document,
        Key(sigma, "standard deviation of a place seen, median", f"{note} seen"),
        sections,
        shape_scene(model.name, shape, X_SW, front),
        (parts.numbers(table), parts.hint(_SHAPE)),
        residuals,
    )


def _mirror_cells(entry: Mapping[str, Any], sigma: float | None) -> tuple[Cell, ...]:
    known = None if sigma is None else 1e3 * sigma
    test, distance = entry["flatness"], entry["distance_mm"]
    flat = "not tested" if test is None else "flat" if test["flat"] else "not flat"
    note = "" if test is None else f"{test['by_chance']:.2g} by chance"
    near, far = entry["hand_in_front_mm"]
    spread = "" if known is None else f"± {decimals(known, known)}"
    fits = (entry["pixels"], entry["free_cameras"])
    return (
        number_cell(entry["poses"]),
        Cell(decimals(distance, known), spread, value=distance),
        number_cell(entry["normal_sigma_deg"], 3),
        Cell(f"{near:.0f} to {far:.0f}"),
        Cell(flat, note, "warn" if flat == "not flat" else ""),
        *(number_cell(None if fit is None else fit["pixels"]["mean"], 2) for fit in fits),
    )


def _provenance(calibration: MirrorCalibration, document: Mapping[str, Any]) -> parts.Section:
    found = {
        **calibration.model.provenance.get("mirrors", {}),
        "noise of a pixel coordinate": f"{document['pixel_sigma_px']:g} px",
        "joint noise": f"{document['joint_sigma_deg']:.2f} deg",
        "misfit over what noise explains": f"{document['noise_ratio']:.2f}",
    }
    return shared_sections.provenance_section(document, found)
