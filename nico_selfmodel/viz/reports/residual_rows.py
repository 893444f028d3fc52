"""Residuals of every row that was held against a model, as a table to download."""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.estimation.arm.evaluation import Evaluation
from nico_selfmodel.estimation.mirrors.mirror_evaluation import MirrorEvaluation
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.files.csv_cells import safe_cell
from nico_selfmodel.viz.figures.camera_views import ShownView

RESIDUALS_FILE = "residuals.csv"
POINT_HEADINGS = (
    *("set", "sample", "marker", "outlier", "x_m", "y_m", "z_m"),
    *("x_predicted_m", "y_predicted_m", "z_predicted_m", "error_mm"),
)
PIXEL_HEADINGS = (
    *("set", "sample", "point", "outlier", "camera"),
    *("u_px", "v_px", "u_predicted_px", "v_predicted_px", "error_px"),
)
TREE_HEADINGS = ("set", "sample", "sensor", "marker", "outlier", "error", "unit")
_SIDES = ("left", "right")
Rows = Iterator[Sequence[Any]]
Held = tuple[str, Any, NDArray | None]
"""What a set is called, how it was evaluated, and which of its rows are outliers."""


def points_csv(sets: Iterable[Held]) -> str:
    """Return measured and predicted points, one row each, as CSV.

    Args:
        sets: Of `Evaluation`; those that are None are left out.
    """
    return _csv(POINT_HEADINGS, (row for one in sets if one[1] for row in _point_rows(*one)))


def pixels_csv(sets: Iterable[Held]) -> str:
    """Return observed and predicted pixels, one row a camera, as CSV.

    Args:
        sets: Of `PixelEvaluation` or `MirrorEvaluation`; those that are None are left out.
    """
    return _csv(PIXEL_HEADINGS, (row for one in sets if one[1] for row in _pixel_rows(*one)))


def views_csv(views: Iterable[ShownView]) -> str:
    """Return observed and predicted corners of boards as CSV; a point is a corner's number."""
    return _csv(PIXEL_HEADINGS, (row for view in views for row in _view_rows(view)))


def tree_csv(sets: Iterable[Held]) -> str:
    """Return the length of every observation's residual as CSV, one row each.

    Args:
        sets: Of `TreeErrors`; those that are None are left out.
    """
    return _csv(TREE_HEADINGS, (row for one in sets if one[1] for row in _tree_rows(*one)))


def _tree_rows(name: str, found: TreeErrors, outliers: NDArray | None) -> Rows:
    data = found.observations.data
    table, samples = data.observations, [*data.sample.tolist(), ""]
    for i, error in enumerate(found.by_row().tolist()):
        sensor = data.sensors[table.sensor[i]]
        in_images = sensor.kind == CAMERA
        size, unit = (error, "px") if in_images else (1e3 * error, "mm")
        marker = data.markers[table.marker[i]].name
        yield name, samples[table.pose[i]], sensor.name, marker, _flag(outliers, i), size, unit


def _point_rows(name: str, found: Evaluation, outliers: NDArray | None) -> Rows:
    seen = found.observations
    for i, error in enumerate(1e3 * found.distances):
        marker = seen.markers[seen.marker[i]]
        places = (*seen.p_WH[i].tolist(), *found.p_WH_predicted[i].tolist())
        yield name, int(seen.sample[i]), marker, _flag(outliers, i), *places, float(error)


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
            _SIDES, pixels[i].reshape(-1, 2), residual.reshape(-1, 2), strict=False
        ):
            if np.isfinite(off).all():
                yield name, int(sample[i]), label[i], _flag(outliers, i), side, *_pair(pixel, off)


def _view_rows(view: ShownView) -> Rows:
    for camera in view.cameras:
        for corner, (pixel, off) in enumerate(zip(camera.pixels, camera.residuals, strict=True)):
            if np.isfinite(off).all():
                out = "yes" if view.use == "outlier" else "no"
                yield view.use, view.name, corner, out, camera.side, *_pair(pixel, off)


def _pair(pixel: NDArray, off: NDArray) -> tuple[float, ...]:
    return *pixel.tolist(), *(pixel - off).tolist(), float(np.linalg.norm(off))


def _flag(outliers: NDArray | None, row: int) -> str:
    return "yes" if outliers is not None and outliers[row] else "no"


def _csv(headings: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(headings)
    for row in rows:
        writer.writerow([safe_cell(v) if isinstance(v, str) else v for v in row])
    return buffer.getvalue()
