"""The photographs with what was found in them: small, with crisp corners drawn over."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import to_hex

from nico_selfmodel.viz import palette
from nico_selfmodel.viz.camera_views import EyeView, ShownView
from nico_selfmodel.viz.photographs import Photographs, jpeg, photograph_of, shrunk
from nico_selfmodel.viz.picture_mesh import data_uri

_WIDTH = 480
"""Of a picture in the page [px]."""


@dataclass(frozen=True)
class Mark:
    """One corner as drawn."""

    u: float
    """[px]."""
    v: float
    """[px]."""
    color: str
    """Of its error."""


@dataclass(frozen=True)
class Thumbnail:
    """One photograph with its corners."""

    file: str
    """Name of the photograph."""
    rms: float | None
    """Of its corners [px]."""
    uri: str | None
    """The photograph; None where it was not kept."""
    marks: tuple[Mark, ...]
    """Corners that were found."""
    row: str
    """First row of corners as points of an SVG line, so that the order of the corners shows."""


@dataclass(frozen=True)
class GalleryRow:
    """One view: left and right side by side."""

    name: str
    """Of the view."""
    use: str
    """One of `camera_views.USES`."""
    pictures: tuple[Thumbnail, ...]
    """One an eye."""


def gallery(
    views: tuple[ShownView, ...], images: Photographs | None, image_size: tuple[int, int],
    columns: int, largest: float,
) -> tuple[GalleryRow, ...]:  # fmt: skip
    """Return all photographs with their corners.

    Args:
        views: What was seen in them.
        images: The photographs.
        image_size: Width and height that were calibrated [px].
        columns: Corners in a row of the board.
        largest: Error from which on corners are drawn darkest [px].

    Returns:
        One row a view; none where there are no photographs.

    Raises:
        ValueError: If an image is not one, or not of the size that was calibrated.
    """
    if not images:
        return ()
    return tuple(
        GalleryRow(
            view.name,
            view.use,
            tuple(
                _thumbnail(eye, view.name, images, image_size, columns, largest)
                for eye in view.eyes
            ),
        )
        for view in views
    )


def _thumbnail(
    eye: EyeView,
    name: str,
    images: Photographs,
    image_size: tuple[int, int],
    columns: int,
    largest: float,
) -> Thumbnail:
    image = photograph_of(images, eye.eye, name, image_size)
    seen = np.isfinite(eye.pixels).all(axis=1)
    colors = palette.error_colors(np.linalg.norm(eye.residuals[seen], axis=1), largest)
    marks = tuple(
        Mark(round(u, 2), round(v, 2), to_hex(color))
        for (u, v), color in zip(eye.pixels[seen].tolist(), colors, strict=True)
    )
    first = eye.pixels[:columns]
    row = " ".join(f"{u:.2f},{v:.2f}" for u, v in first[np.isfinite(first).all(axis=1)].tolist())
    uri = None if image is None else data_uri("image/jpeg", jpeg(shrunk(image, _WIDTH)))
    return Thumbnail(eye.file, eye.rms, uri, marks, row)
