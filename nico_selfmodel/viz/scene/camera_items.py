"""Cameras in a scene: frusta with their images, and one corner's rays, plane and lines."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.vision.images.image_array import averaged
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.photographs import jpeg, resampled
from nico_selfmodel.viz.scene.lettering import label
from nico_selfmodel.viz.scene.scene import LegendEntry
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Picture, Surface, Tube

_PIXELS = 320
"""Width of an image in a scene."""
_PLANE, _LINE = "#ccaa22", "#eebb00"
_WIRE, _CENTER, _RAY, _POINT = 0.012, 0.04, 0.009, 0.05
"""Radii in units of the image plane's width."""
_NAME_WIDTH = 1.8
"""Most that a letter of a camera's name is high, in units of that width over all letters."""


@dataclass(frozen=True, eq=False)
class ImagePlane:
    """The rectangle that a camera's image covers at some distance in front of it."""

    camera: Camera
    """The camera."""
    distance: float
    """From its centre [m]."""

    @property
    def low(self) -> NDArray:
        """Left and top edge [m]. Shape (2,)."""
        camera = self.camera
        edge = np.array([-0.5 - camera.cx, -0.5 - camera.cy])
        return self.distance * edge / [camera.fx, camera.fy]

    @property
    def size(self) -> NDArray:
        """Width and height [m]. Shape (2,)."""
        return self.distance * np.array(self.camera.image_size) / [self.camera.fx, self.camera.fy]

    @property
    def corners(self) -> NDArray:
        """Top left, top right, bottom right, bottom left, in the world [m]. Shape (4, 3)."""
        shares = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        return self.points(self.low + shares * self.size)

    def points(self, plane_points: NDArray) -> NDArray:
        """Return points of the plane, given right and down from the optical axis [m], in the world.

        Shape (n, 2) -> (n, 3).
        """
        depth = np.full((len(plane_points), 1), self.distance)
        return apply(self.camera.X_WC, np.concatenate([plane_points, depth], axis=1))

    def line(self, p_WQ: NDArray, p_WR: NDArray) -> NDArray | None:
        """Return where the plane through the camera's centre and two points cuts the rectangle.

        Returns:
            Two points in the world [m], shape (2, 3); None where it passes by.
        """
        normal = np.cross(*apply(self.camera.X_CW, np.stack([p_WQ, p_WR])))
        across = np.array([-normal[1], normal[0]])
        if not np.linalg.norm(across) > 0.0:
            return None
        start = -normal[2] * self.distance * normal[:2] / (normal[:2] @ normal[:2])
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = (np.stack([self.low, self.low + self.size]) - start) / across
        first, last = np.nanmax(ends.min(axis=0)), np.nanmin(ends.max(axis=0))
        if not first < last:
            return None
        return self.points(start + np.array([[first], [last]]) * across)

    def picture(self, image: NDArray) -> NDArray:
        """Return an image as a lens without distortion would show it on the rectangle.

        Args:
            image: Red, green and blue, 8 bits. Shape (h, w, 3).

        Returns:
            The same, smaller.
        """
        width = min(_PIXELS, image.shape[1])
        shape = np.array([width, max(round(width * image.shape[0] / image.shape[1]), 1)])
        share = [(np.arange(n) + 0.5) / n for n in shape.tolist()]
        grid = np.stack(np.meshgrid(*share))
        ideal = (self.low[:, None, None] + grid * self.size[:, None, None]) / self.distance
        seen = np.hypot(*ideal) < self.camera.widest
        pixels = np.moveaxis(np.where(seen, self.camera.pixels_of(ideal), np.nan), 0, -1)
        smaller = shape / image.shape[1::-1]
        width, height = shape.tolist()
        return resampled(averaged(image, (width, height)), (pixels + 0.5) * smaller - 0.5)


def camera_items(
    side: str, plane: ImagePlane, image: NDArray | None, color: str | None = None
) -> list[Item]:
    """Return a camera's frustum, its name, and its image where there is one.

    Args:
        side: What the camera is called.
        plane: Where the image is drawn.
        image: Red, green and blue, 8 bits. Shape (h, w, 3).
        color: Of its outline; that of `left` and `right` by default.

    Returns:
        Items under `cameras/<camera>`.
    """
    center, corners = plane.camera.X_WC[:3, 3], plane.corners
    width, height = plane.size.tolist()
    ink = color or palette.CAMERAS.get(side, palette.UNCERTAINTY)
    rgba, wire = palette.rgba(ink), _WIRE * width
    items: list[Item] = [
        Tube(path=f"cameras/{side}/outline", color=rgba, points=corners, radius=wire, closed=True),
        Markers(
            path=f"cameras/{side}/centre", color=rgba, centers=center[None], radius=_CENTER * width
        ),
    ]
    items += [
        Tube(
            path=f"cameras/{side}/edge_{k + 1}",
            color=rgba,
            points=np.stack([center, corner]),
            radius=0.6 * wire,
        )
        for k, corner in enumerate(corners)
    ]
    middle = np.array([*(plane.low + 0.5 * plane.size), plane.distance])
    if image is not None:
        picture = Picture(
            path=f"cameras/{side}/image",
            color=(1.0, 1.0, 1.0, 1.0),
            X_WI=plane.camera.X_WC @ transform(np.eye(3), middle),
            width=width,
            height=height,
            image=jpeg(plane.picture(image)),
        )
        items.append(picture)
    above = middle - [0.0, 0.5 * height + 2.0 * wire, 0.0]
    pose = plane.camera.X_WC @ transform(np.eye(3), above)
    name = label(
        f"cameras/{side}/name",
        side,
        ink,
        min(0.28 * height, _NAME_WIDTH * width / len(side)),
        pose,
        (0.5, 1.0),
    )
    return [*items, name]


def epipolar_items(
    calibration: CameraCalibration,
    planes: Mapping[str, ImagePlane],
    X_WL: NDArray,
    view: int,
    corner: int,
) -> list[Item]:
    """Return the rays, plane and lines of one corner.

    Args:
        planes: Where each camera's image is drawn.
        X_WL: Pose of the first camera in the scene. Shape (4, 4).
        corner: Number of the corner, seen by both cameras in it.

    Returns:
        Items under `point`.
    """
    pixels = calibration.views.pixels[view, corner]
    p_WQ = apply(X_WL, calibration.rig.triangulate(pixels[None]).p_WQ[0])
    centers = {side: plane.camera.X_WC[:3, 3] for side, plane in planes.items()}
    width = min(float(plane.size[0]) for plane in planes.values())
    ray = _RAY * width
    yellow, colors = palette.rgba(_LINE), palette.camera_colors(tuple(planes))
    items: list[Item] = [
        Surface(
            path="point/epipolar_plane",
            color=palette.rgba(_PLANE, 0.3),
            vertices=np.stack([*centers.values(), p_WQ]),
            faces=np.array([[0, 1, 2]]),
        ),
        Tube(
            path="point/baseline",
            color=palette.rgba(_PLANE),
            points=np.stack(list(centers.values())),
            radius=ray,
        ),
        Markers(path="point/corner", color=yellow, centers=p_WQ[None], radius=_POINT * width),
    ]
    for side, plane in planes.items():
        color, center = palette.rgba(colors[side]), centers[side]
        points = np.stack([center, p_WQ])
        items.append(Tube(path=f"point/{side}_ray", color=color, points=points, radius=ray))
        other = next(c for name, c in centers.items() if name != side)
        line = plane.line(other, p_WQ)
        if line is not None:
            tube = Tube(
                path=f"point/{side}_epipolar_line", color=yellow, points=line, radius=1.2 * ray
            )
            items.append(tube)
    return items


def epipolar_legend(calibration: CameraCalibration, view: int, corner: int) -> list[LegendEntry]:
    """Return what is drawn of the corner, and how far it lies from its epipolar lines."""
    errors = calibration.rig.epipolar_errors(calibration.views.pixels[view, corner][None])[0]
    name = calibration.views.names[view]
    text = (
        f"epipolar plane and lines of corner {corner} of view {name} "
        f"({errors[0]:.2f} and {errors[1]:.2f} px off them)"
    )
    return [LegendEntry(text, palette.rgba(_LINE))]
