"""One corner in both cameras: its rays, its epipolar plane, and its epipolar lines."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.camera_items import ImagePlane
from nico_selfmodel.viz.scene.scene import LegendEntry
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Surface, Tube

_PLANE, _LINE = "#ccaa22", "#eebb00"
_RAY, _POINT = 0.009, 0.05
"""Radii in units of the image plane's width."""


def epipolar_items(
    calibration: CameraCalibration,
    planes: Mapping[str, ImagePlane],
    X_WL: NDArray,
    view: int,
    corner: int,
) -> list[Item]:
    """Return the rays, plane and lines of one corner.

    Args:
        calibration: What was learned of a pair.
        planes: Where each camera's image is drawn.
        X_WL: Pose of the first camera in the scene. Shape (4, 4).
        view: Number of the view.
        corner: Number of the corner, seen by both cameras in it.

    Returns:
        Items under `point`.
    """
    pixels = calibration.views.pixels[view, corner]
    p_WQ = apply(X_WL, calibration.rig.triangulate(pixels[None]).p_WQ[0])
    centers = {side: plane.camera.X_WC[:3, 3] for side, plane in planes.items()}
    width = min(float(plane.size[0]) for plane in planes.values())
    ray = _RAY * width
    yellow = palette.rgba(_LINE)
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
        color, center = palette.rgba(palette.CAMERAS[side]), centers[side]
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
