"""Residuals in images, as a table to download."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mirror_evaluation import MirrorEvaluation
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.files.csv_cells import rows_text
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.viz.figures.camera_views import ShownView
from nico_selfmodel.viz.reports.residual_rows import Held, Rows, flag

PIXEL_HEADINGS = (
    *("set", "sample", "point", "outlier", "camera"),
    *("u_px", "v_px", "u_predicted_px", "v_predicted_px", "error_px"),
)


def pixels_csv(sets: Iterable[Held]) -> str:
    """Return observed and predicted pixels, one row a camera, as CSV.

    Args:
        sets: Of `PixelEvaluation` or `MirrorEvaluation`; those that are None are left out.
    """
    return rows_text(PIXEL_HEADINGS, (row for one in sets if one[1] for row in _pixel_rows(*one)))


def views_csv(views: Iterable[ShownView]) -> str:
    """Return observed and predicted corners of boards as CSV; a point is a corner's number."""
    return rows_text(PIXEL_HEADINGS, (row for view in views for row in _view_rows(view)))


def _pixel_rows(
    name: str, found: PixelEvaluation | MirrorEvaluation, outliers: NDArray | None
) -> Rows:
    if isinstance(found, MirrorEvaluation):
        seen = found.reflections
        sample, pixels = seen.sample, seen.pixels
        label = [seen.mirrors[k] for k in seen.mirror]
    else:
        arm = found.observations.arm
        sample, pixels = arm.sample, found.observations.pixels
        label = [arm.markers[k] for k in arm.marker]
    for i, residual in enumerate(found.residuals):
        for side, pixel, off in zip(
            SIDES, pixels[i].reshape(-1, 2), residual.reshape(-1, 2), strict=False
        ):
            if np.isfinite(off).all():
                yield name, int(sample[i]), label[i], flag(outliers, i), side, *_pair(pixel, off)


def _view_rows(view: ShownView) -> Rows:
    for camera in view.cameras:
        for corner, (pixel, off) in enumerate(zip(camera.pixels, camera.residuals, strict=True)):
            if np.isfinite(off).all():
                out = "yes" if view.use == "outlier" else "no"
                yield view.use, view.name, corner, out, camera.side, *_pair(pixel, off)


def _pair(pixel: NDArray, off: NDArray) -> tuple[float, ...]:
    return *pixel.tolist(), *(pixel - off).tolist(), float(np.linalg.norm(off))
