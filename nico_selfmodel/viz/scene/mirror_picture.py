"""What a camera sees in a mirror, drawn on the glass."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.vision.images.image_file import read_image
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.photographs import jpeg, resampled
from nico_selfmodel.viz.figures.rgba import Rgba
from nico_selfmodel.viz.scene.scene_items import Item, Picture, Surface, Tube

_PIXELS = 640
"""Width of the picture on the glass."""


@dataclass(frozen=True, eq=False)
class MirrorPicture:
    """What both cameras saw before a mirror at one pose."""

    sample: int
    """Of the data set."""
    encoders: NDArray
    """Readings there [encoder units]. Shape (n,)."""
    images: tuple[NDArray, NDArray]
    """Of the left and the right camera, BGR, 8 bits. Shape (h, w, 3) each."""


def recorded_pictures(folder: str | Path, dataset: Dataset) -> dict[str, MirrorPicture]:
    """Return a picture of each mirror from a recording that kept its pictures.

    Args:
        dataset: It, or a part of it.

    Returns:
        Mirror -> the picture of the first pose in which both cameras saw the reflection; empty
        where no pictures were kept.
    """
    kept = Path(folder) / "images"
    poses = dataset.extra.get("pose")
    if poses is None or not kept.is_dir():
        return {}
    found: dict[str, MirrorPicture] = {}
    seen = np.isfinite(dataset.pixels).all(axis=1)
    for row in np.flatnonzero(seen & (dataset.mirror != "")):
        name = str(dataset.mirror[row])
        if name in found:
            continue
        try:
            left, right = (read_image(kept / f"{side}{int(poses[row]):04d}.png") for side in SIDES)
        except DataError:
            continue
        encoders = dataset.encoders[row]
        found[name] = MirrorPicture(int(dataset.sample[row]), encoders, (left, right))
    return found


def on_glass(path: str, camera: Camera, corners: NDArray, image: NDArray) -> Picture:
    """Return the picture that a camera sees on a rectangle of glass.

    Args:
        camera: Who sees it, in the scene.
        corners: Of the glass: bottom left, bottom right, top right, top left, as seen. (4, 3).
        image: What it sees, red, green, blue, 8 bits. Shape (h, w, 3).

    Returns:
        The item, its lens taken out.
    """
    across, down = corners[2] - corners[3], corners[0] - corners[3]
    width, height = float(np.linalg.norm(across)), float(np.linalg.norm(down))
    rows = max(round(_PIXELS * height / width), 1)
    u, v = ((np.arange(n) + 0.5) / n for n in (_PIXELS, rows))
    points = corners[3] + u[None, :, None] * across + v[:, None, None] * down
    pixels = camera.project(points.reshape(-1, 3)).reshape(rows, _PIXELS, 2)
    right, below = across / width, down / height
    rotation = np.stack([right, below, np.cross(right, below)], axis=1)
    return Picture(
        path=path,
        color=(1.0, 1.0, 1.0, 1.0),
        X_WI=transform(rotation, corners.mean(axis=0)),
        width=width,
        height=height,
        image=jpeg(resampled(image, pixels)),
    )


def plate_items(
    path: str, plate: NDArray, glass: NDArray, color: Rgba, radius: float
) -> list[Item]:
    """Return a mirror as a plate with an edge.

    Args:
        path: Of the mirror; its items are `glass` and `edge` below it.
        plate: Corners, one after the other. Shape (4, 3).
        glass: The same of the glass, which may lie behind its picture.
        radius: Of the edge [m].
    """
    faces, edge = np.array([[0, 1, 2], [0, 2, 3]]), palette.rgba(palette.MUTED)
    return [
        Surface(path=f"{path}/glass", color=color, vertices=glass, faces=faces),
        Tube(path=f"{path}/edge", color=edge, points=plate, radius=radius, closed=True),
    ]


Pictures = Mapping[str, MirrorPicture]
"""Mirror -> what was seen in it."""
