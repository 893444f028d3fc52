"""The photographs with what was found in them: small, with crisp corners drawn over."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.camera_views import CameraView, ShownView
from nico_selfmodel.viz.figures.photographs import Photographs, jpeg, photograph_of, shrunk
from nico_selfmodel.viz.live.gltf import data_uri
from nico_selfmodel.viz.reports.parts import Gallery, GalleryRow, Thumbnail

_WIDTH, _MANY = 480, 30
"""Of a picture in the page at least [px], until there are so many that they share the room."""
_FAR = 4.0
"""Corners with errors of so many rms are ringed."""
_CROSS = 0.009
"""Half the size of a cross in widths of the image."""
_STROKE = 0.0034
"""Width of lines in widths of the image."""


def gallery(
    assessment: CameraAssessment,
    views: tuple[ShownView, ...],
    document: Mapping[str, Any],
    images: Photographs | None,
) -> Gallery | None:
    """Return all photographs with their corners.

    Args:
        document: Content of `result.json`; its `detection` may say what was tried in vain.

    Returns:
        One row a view; None where there are no photographs.

    Raises:
        ValueError: If an image is not one, or not of the size that was calibrated.
    """
    count = sum(len(of_camera) for of_camera in (images or {}).values())
    if not images or not count:
        return None
    width = round(_WIDTH * min(1.0, _MANY / count) ** 0.5)
    calibration = assessment.calibration
    far = _FAR * calibration.rms if np.isfinite(calibration.rms) else np.inf
    notes = (document.get("detection") or {}).get("not_seen") or {}
    columns = _columns(calibration.views.p_GQ)
    colors = palette.camera_colors(calibration.views.cameras)

    def thumbnail(camera: CameraView, name: str) -> Thumbnail:
        size = calibration.views.size_of(camera.side)
        image = photograph_of(images, camera.side, name, size)
        small = None if image is None else shrunk(image, width)
        return _thumbnail(camera, colors[camera.side], small, size, columns, far, notes)

    rows = tuple(
        GalleryRow(
            view.name, view.use, tuple(thumbnail(camera, view.name) for camera in view.cameras)
        )
        for view in views
    )
    return Gallery(rows)


def _thumbnail(
    camera: CameraView,
    color: str,
    small: NDArray | None,
    image_size: tuple[int, int],
    columns: int,
    far: float,
    notes: Mapping[str, str],
) -> Thumbnail:
    seen = np.asarray(np.isfinite(camera.pixels).all(axis=1))
    size = _CROSS * image_size[0]
    crosses = "".join(
        f"M{u - size:.1f} {v:.1f}h{2 * size:.1f}M{u:.1f} {v - size:.1f}v{2 * size:.1f}"
        for u, v in camera.pixels[seen].tolist()
    )
    row = [f"{u:.1f} {v:.1f}" for u, v in camera.pixels[:columns][seen[:columns]].tolist()]
    beyond = camera.pixels[seen & (np.linalg.norm(camera.residuals, axis=1) > far)]
    covered = image_size
    if small is not None:
        step = image_size[0] // small.shape[1]
        covered = (step * small.shape[1], step * small.shape[0])
    return Thumbnail(
        camera.file,
        color,
        camera.rms,
        "" if seen.any() else notes.get(camera.file, "no board found"),
        None if small is None else data_uri("image/jpeg", jpeg(small)),
        covered,
        crosses,
        f"M{'L'.join(row)}" if len(row) > 1 else "",
        tuple((round(u, 1), round(v, 1)) for u, v in beyond.tolist()),
        _STROKE * image_size[0],
    )


def _columns(p_GQ: NDArray) -> int:
    """Return how many corners follow each other in a line from the first on."""
    steps = np.diff(p_GQ, axis=0)
    bends = np.flatnonzero(
        np.linalg.norm(steps - steps[0], axis=1) > 1e-6 * np.linalg.norm(steps[0])
    )
    return int(bends[0]) + 1 if len(bends) else len(p_GQ)
