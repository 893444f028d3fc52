"""The report on cameras that were learned from views of a flat board."""

from collections.abc import Mapping, Sequence
from typing import Any

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.model.cameras.projection import FISHEYE
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.viz.figures import camera_plots, lens_plots
from nico_selfmodel.viz.figures.camera_views import ShownView, shown_views
from nico_selfmodel.viz.figures.numbers_shown import decimals, signed
from nico_selfmodel.viz.figures.photographs import Photographs
from nico_selfmodel.viz.figures.projection_plot import projection_map
from nico_selfmodel.viz.figures.residual_field import residual_field
from nico_selfmodel.viz.reports import parts, shared_sections
from nico_selfmodel.viz.reports.camera_gallery import gallery
from nico_selfmodel.viz.reports.page import Report, key_number
from nico_selfmodel.viz.reports.parameter_tables import lens_table, pose_table
from nico_selfmodel.viz.reports.pixel_rows import views_csv
from nico_selfmodel.viz.reports.tables import (
    HEADINGS,
    Cell,
    Table,
    error_table,
    held_out,
    number_cell,
    statistics_cells,
)
from nico_selfmodel.viz.scene.camera_scene import camera_scene


def camera_report(
    assessment: CameraAssessment,
    document: Mapping[str, Any],
    images: Photographs | None = None,
    model: SelfModel | None = None,
) -> Report:
    """Return what views of a board tell of cameras.

    Args:
        document: `estimation.judging.to_json` of it; the numbers shown are these. Its
            `detection` may hold `files`, camera -> view -> name.
        images: Photographs: camera -> view -> red, green and blue.
        model: The self-model with these cameras, for its name and provenance.

    Raises:
        ValueError: If an image is not one, or not of the size that was calibrated.
    """
    name = "cameras" if model is None else model.name
    scene = camera_scene(assessment, images, name=name)
    key = key_number(document, "pixels", "corners", statistics=("rms", "mean"), digits=3)
    views = shown_views(assessment, document, images)
    cameras = assessment.calibration.views.cameras
    sections = (
        _errors(assessment, document),
        _where(assessment, views),
        *_lens_section(document),
        *_known(document),
        *_together(assessment, document),
        shared_sections.learned_section(
            document,
            assessment.calibration.uncertainty,
            pose_table,
        ),
        _views(assessment, document, images, views),
        _provenance(assessment, document, model),
    )
    learned = _learned(assessment, document)
    about, residuals = _about(cameras, document), views_csv(views)
    return Report(name, about, document, key, sections, scene, learned, residuals)


def _learned(
    assessment: CameraAssessment, document: Mapping[str, Any]
) -> tuple[parts.Numbers | parts.Text | None, ...]:
    """Return the lenses, one column a camera."""
    calibration = assessment.calibration
    found = shared_sections.parameter_tables(document, calibration.uncertainty)
    fisheye = "θ(1 + k1 θ² + ... + k4 θ⁸) along (X, Y), θ the angle off the axis"
    kinds = {camera.lens == FISHEYE for camera in calibration.cameras}
    forms = [fisheye if kind else "distort(X/Z, Y/Z)" for kind in sorted(kinds)]
    words = (
        f"Pixel = K · {', of fisheyes K · '.join(forms)}, in OpenCV's conventions. Beside each "
        "value its standard deviation; fixed values are chosen, not measured."
    )
    cameras = calibration.views.cameras
    kind = "lens" if len(cameras) <= 2 else ""  # of many, sigmas stand below their values
    return parts.numbers(lens_table(found, cameras), kind), parts.hint(words)


def _about(cameras: tuple[str, ...], document: Mapping[str, Any]) -> str:
    who = f"The {listed(cameras)} camera{'s' * (len(cameras) > 1)}"
    if len(cameras) == 2:
        who = f"The {' and '.join(cameras)} cameras"
    what = f"{who}, calibrated from {len(document['views'])} views of a flat board"
    board = document.get("detection")
    if board is None:
        return what
    return f"{what} ({board['board']}, squares of {board['square_mm']:g} mm)"


def _errors(assessment: CameraAssessment, document: Mapping[str, Any]) -> parts.Section:
    errors = held_out(document, "pixels")
    table = error_table(errors, "reprojection error [px]", 3, "corners")
    words = (
        "Euclidean distance of each detected corner from where the model puts it, a corner in each "
        "camera counted by itself, so that rms is OpenCV's."
    )
    tiles = _pair_tiles(document)
    distribution = camera_plots.pixel_errors(assessment)
    return shared_sections.errors_section(
        document,
        (table, words),
        few="with so few views",
        more="views",
        figure=parts.drawing("Distribution of the reprojection errors", distribution, "half"),
        ending=parts.Tiles(tiles) if tiles else None,
    )


def _pair_tiles(document: Mapping[str, Any]) -> tuple[parts.Tile, ...]:
    """Return the numbers by which pairs of cameras are compared; none for one camera."""
    tiles = []
    baseline = document["parameters"].get("baseline")
    if baseline is not None:
        sigma = None if baseline["sigma"] is None else 1e3 * baseline["sigma"]
        known = "" if sigma is None else f" ± {decimals(sigma, sigma)}"
        length = decimals(1e3 * baseline["value"], sigma)
        tiles.append(parts.Tile(f"{length}{known} mm", "baseline", "from camera to camera"))
    if document.get("epipolar_px") is not None:
        mean = document["epipolar_px"]["pixels"]["mean"]
        note = f"mean in each image; OpenCV's sample adds both: {2 * mean:.3f} px"
        tiles.append(parts.Tile(f"{mean:.3f} px", "off the epipolar line", note))
    found = document.get("reconstruction")
    return (*tiles, *(() if found is None else _board_tiles(found)))


def _board_tiles(found: Mapping[str, Any]) -> tuple[parts.Tile, parts.Tile]:
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
        parts.Tile(f"{edge['sd']:.2f} mm", "SD of edges", edges),
        parts.Tile(f"{signed(off, 2)} %", "off in scale", size),
    )


def _lens_section(document: Mapping[str, Any]) -> list[parts.Section]:
    """Return which lenses were tried; nothing where the polynomial left nothing to ask."""
    tried = (document.get("lens") or {}).get("tried")
    if not tried:
        return []
    rows = tuple((t["lens"], (number_cell(t["left_out_px"], 3), Cell(t["reason"]))) for t in tried)
    words = (
        "Boards are predicted by cameras that were learned without them; the number is the "
        "geometric mean of their rms."
    )
    table = parts.numbers(Table(("lens", "boards left out [px]", "why"), rows), "cards")
    return [parts.section(f"The lens: {document['lens']['kind']}", table, parts.hint(words))]


def _known(document: Mapping[str, Any]) -> list[parts.Section]:
    """Return how cameras that were known before fare; nothing without any."""
    if "before" not in document:
        return []
    words = (
        f"Before: the cameras of {document['before']['model']!r}, before which the same boards "
        "were placed anew. Errors that fell say that the lens was another, or has changed since."
    )
    moved = "The numbers that moved most for what they are uncertain by, and the baseline."
    title, pixels = "What learning anew changed", (("pixels", "px"),)
    return [shared_sections.changes_section(title, document, pixels, "corners", words, moved, 3)]


def _over_the_image(assessment: CameraAssessment, views: tuple[ShownView, ...]) -> tuple[Any, ...]:
    """Return how uncertain projections are, which views fit badly, how the lens bends."""
    projected = ("Uncertainty of projection over the image", projection_map(assessment))
    worst = ("Errors of the views", camera_plots.view_errors(views))
    bent = ("Distortion over the radius", lens_plots.distortion_profile(assessment))
    words = parts.hint(
        "Standard deviation, in its worst direction, of the pixel to which a far point is "
        "projected, less what a turn of the camera would undo: numbers inside a camera trade "
        "against each other, pixels do not."
    )
    if projected[1] is None:
        return (parts.halves(worst, bent),)
    if len(assessment.calibration.views.cameras) == 1:
        return parts.halves(projected, bent), words, parts.drawing(*worst, "half")
    return parts.drawing(*projected), words, parts.halves(worst, bent)


def _where(assessment: CameraAssessment, views: tuple[ShownView, ...]) -> parts.Section:
    fields = (
        ("Residuals over the image", residual_field(assessment)),
        ("Coverage of the image by corners", camera_plots.coverage(assessment)),
    )
    one = len(assessment.calibration.views.cameras) == 1
    return parts.section(
        "Where they are",
        *((parts.halves(*fields),) if one else (parts.drawing(*field) for field in fields)),
        parts.hint(
            "Arrows point from predicted to detected corners. Black: means over cells in which at "
            "least three views have corners. What a lens model cannot express is left as a pattern."
        ),
        *_over_the_image(assessment, views),
    )


def _together(assessment: CameraAssessment, document: Mapping[str, Any]) -> list[parts.Section]:
    """Return what the cameras do together; nothing for one camera."""
    if document.get("pairs"):
        return [_pairs(document["pairs"])]
    rows = tuple(
        (label, statistics_cells(document[key], quantity, digits)[1:])
        for key, label, quantity, digits in (
            ("epipolar_px", "distance from the epipolar line [px]", "pixels", 3),
            ("reconstruction", "rebuilt corners [mm]", "position_mm", 2),
        )
        if document.get(key) is not None
    )
    if not rows:
        return []
    figures = parts.halves(
        ("Distribution of the epipolar errors", lens_plots.epipolar_distribution(assessment)),
        ("Reconstruction error by range", lens_plots.reconstruction_by_range(assessment)),
    )
    table = parts.numbers(Table(("", *HEADINGS), rows))
    return [parts.section("How the cameras work together", table, figures, id="pair")]


def _pairs(found: Sequence[Mapping[str, Any]]) -> parts.Section:
    """Return how well the cameras of a rig work together, one pair a row."""
    rows = []
    for pair in found:
        apart, rebuilt = pair["baseline"], pair["reconstruction"]
        sigma = None if apart["sigma"] is None else 1e3 * apart["sigma"]
        known = "" if sigma is None else f" ± {decimals(sigma, sigma)}"
        cells = (
            Cell(str(pair["boards"])),
            Cell(f"{decimals(1e3 * apart['value'], sigma)}{known}"),
            number_cell(pair["epipolar_px"]["pixels"]["mean"], 3),
            number_cell(None if rebuilt is None else rebuilt["position_mm"]["rms"], 2),
        )
        rows.append((" - ".join(pair["cameras"]), cells))
    headings = ("cameras", "boards in common", "apart [mm]", "off epipolar lines [px]")
    table = Table((*headings, "rebuilt corners, rms [mm]"), tuple(rows))
    words = (
        "Cameras without a board in common are connected by the others. Boards are rebuilt from "
        "pixels alone by the two cameras of a row, where both saw them whole."
    )
    return parts.section(
        "How the cameras work together", parts.numbers(table, "cards"), parts.hint(words), id="pair"
    )


def _views(
    assessment: CameraAssessment,
    document: Mapping[str, Any],
    images: Photographs | None,
    views: tuple[ShownView, ...],
) -> parts.Section:
    pictures = gallery(assessment, views, document, images)
    words = (
        "Crosses are the corners as detected; the line runs along their first row, so that left "
        "and right must show it in the same place on the board. Rings: corners with errors of "
        "more than four times the rms."
    )
    seen = () if pictures is None else (parts.hint(words), pictures)
    return parts.section("What was seen", parts.numbers(_view_table(views)), *seen, id="views")


def _view_table(views: tuple[ShownView, ...]) -> Table:
    """Return one row a view: its files, what it was used for, corners and errors."""
    rows = []
    for view in views:
        errors = [camera.errors for camera in view.cameras]
        largest = max((float(found.max()) for found in errors if len(found)), default=None)
        rms = [camera.rms for camera in view.cameras] + [view.rms] * (len(view.cameras) > 1)
        cells = (
            Cell(", ".join(camera.file for camera in view.cameras)),
            Cell(view.use, kind="warn" if view.use == "outlier" else ""),
            Cell(" + ".join(str(len(found)) for found in errors)),
            *(number_cell(value, 3) for value in (*rms, largest)),
        )
        rows.append((view.name, cells))
    cameras = [f"rms {camera.side} [px]" for camera in views[0].cameras]
    both = ["rms [px]"] * (len(cameras) > 1)
    headings = ("view", "files", "used as", "corners", *cameras, *both, "largest [px]")
    return Table(headings, tuple(rows))


def _provenance(
    assessment: CameraAssessment, document: Mapping[str, Any], model: SelfModel | None
) -> parts.Section:
    views = assessment.calibration.views
    sizes = {
        camera: f"{width} x {height} px"
        for camera, (width, height) in zip(views.cameras, views.image_sizes, strict=True)
    }
    one = set(sizes.values())
    noise, detection = document["pixel_sigma_px"], document.get("detection") or {}
    told = {key: value for key, value in detection.items() if key not in ("files", "not_seen")}
    found = {
        **({} if model is None else {**model.provenance, **model.fit}),
        **{f"detection {key}": value for key, value in told.items()},
        "image size": one.pop()
        if len(one) == 1
        else ", ".join(f"{camera} {size}" for camera, size in sizes.items()),
        "noise of a coordinate": "not known" if noise is None else f"{noise:.3f} px",
    }
    return shared_sections.provenance_section(document, found)
