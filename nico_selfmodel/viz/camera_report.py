"""The report on eyes: one page that needs nothing else, the verdict first."""

from collections.abc import Mapping
from typing import Any

from nico_selfmodel.estimation import CameraAssessment, Verdict
from nico_selfmodel.model import SelfModel
from nico_selfmodel.viz import camera_plots, camera_tables, lens_plots
from nico_selfmodel.viz.camera_gallery import gallery
from nico_selfmodel.viz.camera_scene import camera_scene
from nico_selfmodel.viz.camera_views import ShownView, shown_views, view_table
from nico_selfmodel.viz.parameter_plots import correlations
from nico_selfmodel.viz.photographs import Photographs
from nico_selfmodel.viz.plot_style import svg_data_uri
from nico_selfmodel.viz.report_page import key_statistics, page
from nico_selfmodel.viz.residual_field import residual_field
from nico_selfmodel.viz.scene import Scene


def camera_report_html(
    assessment: CameraAssessment,
    verdict: Verdict,
    document: Mapping[str, Any],
    images: Photographs | None = None,
    scene: Scene | None = None,
    *,
    model: SelfModel | None = None,
) -> str:
    """Return the report as one self-contained page.

    Args:
        assessment: What was learned and what it is worth.
        verdict: What is thought of it.
        document: `estimation.camera_document` of both; the numbers shown are these. Its
            `detection` may hold `files`, eye -> view -> name.
        images: Photographs: eye -> view -> red, green and blue.
        scene: The scene to embed; made from the assessment if omitted.
        model: The self-model with these cameras, for its name and provenance.

    Returns:
        HTML that loads nothing from anywhere.

    Raises:
        SelfModelError: If the server that makes the interactive scene cannot start.
        ValueError: If an image is not one, or not of the size that was calibrated.
    """
    calibration = assessment.calibration
    name = "eyes" if model is None else model.name
    scene = camera_scene(assessment, images, name=name) if scene is None else scene
    views = shown_views(assessment, document, images)
    return page(
        "camera_report.html.j2",
        name,
        verdict,
        document=document,
        key=key_statistics(document, "pixels", "boards"),
        tiles=camera_tables.pair_tiles(document),
        views=views,
        eyes=calibration.views.eyes,
        scene=scene,
        figures=_figures(assessment, views),
        gallery=gallery(assessment, views, document, images),
        stroke=0.0034 * calibration.views.image_size[0],
        tables=_tables(document) | {"views": view_table(views)},
        provenance=camera_tables.camera_provenance(assessment, document, model),
    )


def _figures(assessment: CameraAssessment, views: tuple[ShownView, ...]) -> dict[str, str | None]:
    """Return every figure as a data URI, None for those that this calibration has not."""
    made = {
        "distribution": camera_plots.pixel_errors(assessment),
        "views": camera_plots.view_errors(views),
        "residuals": residual_field(assessment),
        "coverage": camera_plots.coverage(assessment),
        "distortion": lens_plots.distortion_profile(assessment),
        "epipolar": lens_plots.epipolar_distribution(assessment),
        "reconstruction": lens_plots.reconstruction_by_range(assessment),
        "correlation": correlations(assessment.calibration.uncertainty),
    }
    return {name: None if f is None else svg_data_uri(f) for name, f in made.items()}


def _tables(document: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "errors": camera_tables.pixel_error_table(document),
        "pair": camera_tables.pair_table(document),
        "inside": camera_tables.inside_table(document),
        "pose": camera_tables.pose_table(document),
        "parameters": camera_tables.camera_parameter_list(document),
    }
