"""The report on cameras that were learned from views of a flat board."""

from collections.abc import Mapping
from typing import Any

from nico_selfmodel.estimation import CameraAssessment
from nico_selfmodel.model import SelfModel
from nico_selfmodel.viz import camera_plots, lens_plots
from nico_selfmodel.viz.camera_gallery import gallery
from nico_selfmodel.viz.camera_scene import camera_scene
from nico_selfmodel.viz.camera_views import ShownView, shown_views
from nico_selfmodel.viz.numbers_shown import decimals, signed
from nico_selfmodel.viz.photographs import Photographs
from nico_selfmodel.viz.reports.page import Report, key_number
from nico_selfmodel.viz.reports.parameter_tables import lens_table, pose_table
from nico_selfmodel.viz.reports.sections import (
    Section,
    Text,
    Tile,
    Tiles,
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
from nico_selfmodel.viz.reports.tables import (
    HEADINGS,
    Cell,
    Table,
    held_out_table,
    number_cell,
    statistics_cells,
)
from nico_selfmodel.viz.residual_field import residual_field
from nico_selfmodel.viz.scene import Scene


def camera_report(
    assessment: CameraAssessment,
    document: Mapping[str, Any],
    images: Photographs | None = None,
    model: SelfModel | None = None,
) -> Report:
    """Return the report on one camera or two.

    Args:
        assessment: What was learned and what it is worth.
        document: `estimation.camera_document` of it; the numbers shown are these. Its
            `detection` may hold `files`, camera -> view -> name.
        images: Photographs: camera -> view -> red, green and blue.
        model: The self-model with these cameras, for its name and provenance.

    Raises:
        ValueError: If an image is not one, or not of the size that was calibrated.
    """
    name = "cameras" if model is None else model.name
    scene = camera_scene(assessment, images, name=name)
    key = key_number(document, "pixels", "corners", statistics=("rms", "mean"), digits=3)
    sections = camera_sections(assessment, document, images, scene, model)
    limits = "What these images cannot support"
    return Report(name, _about(assessment, document), document, key, sections, scene, limits)


def camera_sections(
    assessment: CameraAssessment,
    document: Mapping[str, Any],
    images: Photographs | None,
    scene: Scene,
    model: SelfModel | None = None,
) -> tuple[Section, ...]:
    """Return what views of a board tell of cameras, section by section."""
    views, pair = shown_views(assessment, document, images), _together(assessment, document)
    cameras = "cameras" if len(assessment.calibration.views.eyes) > 1 else "camera"
    return (
        _errors(document),
        scene_section(f"The {cameras} and the boards", scene),
        _where(assessment, views),
        *((pair,) if pair else ()),
        _parameters(assessment, document),
        _views(assessment, document, images, views),
        _provenance(assessment, document, model),
    )


def _about(assessment: CameraAssessment, document: Mapping[str, Any]) -> str:
    names = assessment.calibration.views.eyes
    who = "Two cameras" if len(names) > 1 else f"The {names[0]} camera"
    detection = document.get("detection")
    board = (
        ""
        if detection is None
        else f" ({detection['board']}, squares of {detection['square_mm']:g} mm)"
    )
    return f"{who}, calibrated from {len(document['views'])} views of a flat board{board}"


def _errors(document: Mapping[str, Any]) -> Section:
    tiles = pair_tiles(document)
    table = held_out_table(document, "pixels", "reprojection error [px]", 3, "corners")
    return section(
        "",
        numbers(table, "errors"),
        Text(
            "Euclidean distance of each detected corner from where the model puts it, a corner in "
            "each camera counted by itself, so that rms is OpenCV's.",
            "hint",
        ),
        missing_errors_text(document, "with so few views"),
        outlier_text(document, "views"),
        Tiles(tiles) if tiles else None,
        id="errors",
    )


def pair_tiles(document: Mapping[str, Any]) -> tuple[Tile, ...]:
    """Return the numbers by which pairs of cameras are compared; none for one camera."""
    tiles = []
    baseline = document["parameters"].get("baseline")
    if baseline is not None:
        sigma = None if baseline["sigma"] is None else 1e3 * baseline["sigma"]
        known = "" if sigma is None else f" ± {decimals(sigma, sigma)}"
        length = decimals(1e3 * baseline["value"], sigma)
        tiles.append(Tile(f"{length}{known} mm", "baseline", "from camera to camera"))
    if document.get("epipolar_px") is not None:
        mean = document["epipolar_px"]["pixels"]["mean"]
        note = f"mean in each image; OpenCV's sample adds both: {2 * mean:.3f} px"
        tiles.append(Tile(f"{mean:.3f} px", "off the epipolar line", note))
    found = document.get("reconstruction")
    return (*tiles, *(() if found is None else _board_tiles(found)))


def _board_tiles(found: Mapping[str, Any]) -> tuple[Tile, Tile]:
    """Return how boards are rebuilt by triangulation."""
    boards = f"{found['boards']} {'held-out ' if found['held_out'] else ''}boards"
    edge, scale = found["edge_mm"], found["scale"]
    edges = (
        f"of the rebuilt squares of {edge['true']:.4g} mm, {boards}; the thesis reports "
        "1.59 mm, with squares of 28 mm"
    )
    off, spread = 100.0 * (scale["mean"] - 1.0), 100.0 * scale["sd"]
    size = f"size of the rebuilt boards over the true one, SD {spread:.2f} %"
    return (
        Tile(f"{edge['sd']:.2f} mm", "SD of edges", edges),
        Tile(f"{signed(off, 2)} %", "off in scale", size),
    )


def _where(assessment: CameraAssessment, views: tuple[ShownView, ...]) -> Section:
    one = len(assessment.calibration.cameras) == 1
    width = "half" if one else "wide"
    fields = (
        drawing(residual_field(assessment), "Residuals over the image", width),
        drawing(camera_plots.coverage(assessment), "Coverage of the image by corners", width),
    )
    return section(
        "How large the errors are, and where",
        drawing(camera_plots.view_errors(views), "Errors of the views"),
        *((beside(*fields),) if one else fields),
        Text(
            "Arrows point from predicted to detected corners. Black: means over cells in which at "
            "least three views have corners. What a lens model cannot express is left as a "
            "pattern.",
            "hint",
        ),
        beside(
            drawing(
                camera_plots.pixel_errors(assessment),
                "Distribution of the reprojection errors",
                "half",
            ),
            drawing(
                lens_plots.distortion_profile(assessment), "Distortion over the radius", "half"
            ),
        ),
    )


def _together(assessment: CameraAssessment, document: Mapping[str, Any]) -> Section | None:
    """Return what the cameras do together; None for one camera."""
    rows = []
    if document.get("epipolar_px") is not None:
        cells = statistics_cells(document["epipolar_px"], "pixels", 3)[1:]
        rows.append(("distance from the epipolar line [px]", cells))
    if document.get("reconstruction") is not None:
        cells = statistics_cells(document["reconstruction"], "position_mm", 2)[1:]
        rows.append(("rebuilt corners [mm]", cells))
    if not rows:
        return None
    return section(
        "How the cameras work together",
        numbers(Table(("", *HEADINGS), tuple(rows))),
        beside(
            drawing(
                lens_plots.epipolar_distribution(assessment),
                "Distribution of the epipolar errors",
                "half",
            ),
            drawing(
                lens_plots.reconstruction_by_range(assessment),
                "Reconstruction error by range",
                "half",
            ),
        ),
        id="pair",
    )


def _parameters(assessment: CameraAssessment, document: Mapping[str, Any]) -> Section:
    uncertainty = assessment.calibration.uncertainty
    parameters = parameters_of(document, uncertainty)
    return section(
        "What was learned",
        numbers(lens_table(parameters, assessment.calibration.views.eyes)),
        numbers(pose_table(parameters)),
        all_parameters(parameters),
        unobservable_section(document),
        correlation_figure(document, uncertainty),
        message="Pixel = K · distort(X/Z, Y/Z), in OpenCV's conventions. Below each value its "
        "standard deviation; fixed values are chosen, not measured.",
        id="parameters",
    )


def _views(
    assessment: CameraAssessment,
    document: Mapping[str, Any],
    images: Photographs | None,
    views: tuple[ShownView, ...],
) -> Section:
    pictures = gallery(assessment, views, document, images)
    hint = (
        "Crosses are the corners as detected; the line runs along their first row, so that left "
        "and right must show it in the same place on the board. Rings: corners with errors of "
        "more than four times the rms."
    )
    return section(
        "What was seen",
        numbers(view_table(views), "views"),
        None if pictures is None else Text(hint, "hint"),
        pictures,
        id="views",
    )


def view_table(views: tuple[ShownView, ...]) -> Table:
    """Return one row a view: its files, what it was used for, corners and errors."""
    rows = []
    for view in views:
        errors = [eye.errors for eye in view.eyes]
        largest = max((float(found.max()) for found in errors if len(found)), default=None)
        rms = [eye.rms for eye in view.eyes] + [view.rms] * (len(view.eyes) > 1)
        cells = (
            Cell(", ".join(eye.file for eye in view.eyes)),
            Cell(view.use, kind="warn" if view.use == "outlier" else ""),
            Cell(" + ".join(str(len(found)) for found in errors)),
            *(number_cell(value, 3) for value in (*rms, largest)),
        )
        rows.append((view.name, cells))
    cameras = [f"rms {eye.eye} [px]" for eye in views[0].eyes]
    both = ["rms [px]"] * (len(cameras) > 1)
    headings = ("view", "files", "used as", "corners", *cameras, *both, "largest [px]")
    return Table(headings, tuple(rows))


def _provenance(
    assessment: CameraAssessment, document: Mapping[str, Any], model: SelfModel | None
) -> Section:
    width, height = assessment.calibration.views.image_size
    noise = document["pixel_sigma_px"]
    detection = document.get("detection") or {}
    found = {
        **({} if model is None else {**model.provenance, **model.fit}),
        **{
            f"detection {key}": value
            for key, value in detection.items()
            if key not in ("files", "not_seen")
        },
        "image size": f"{width} x {height} px",
        "noise of a coordinate": "not known" if noise is None else f"{noise:.3f} px",
    }
    return provenance_section(document, found)
