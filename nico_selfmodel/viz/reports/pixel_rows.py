"""Residuals in images, as a table to download."""

from collections.abc import Iterable, Iterator

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
    each, off = pixels.reshape(-1, 2), found.residuals.reshape(-1, 2)
    for row, numbers in _measured(each, off):
        i, side = divmod(row, len(each) // len(pixels))
        yield name, int(sample[i]), label[i], flag(outliers, i), SIDES[side], *numbers


def _view_rows(view: ShownView) -> Rows:
    for camera in view.cameras:
        out = "yes" if view.use == "outlier" else "no"
        for corner, numbers in _measured(camera.pixels, camera.residuals):
            yield view.use, view.name, corner, out, camera.side, *numbers


def _measured(pixels: NDArray, off: NDArray) -> Iterator[tuple[int, list[float]]]:
    """Yield each row that was seen: its number, and pixel, predicted pixel and error. (n, 2)."""
    numbers = np.column_stack([pixels, pixels - off, np.linalg.norm(off, axis=1)]).tolist()
    for row in np.flatnonzero(np.isfinite(off).all(axis=1)).tolist():
        yield row, numbers[row]
