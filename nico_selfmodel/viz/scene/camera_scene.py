"""What calibrated cameras look like: the cameras, their images, and the boards that they saw."""

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.numbers_shown import short
from nico_selfmodel.viz.figures.photographs import Photographs, photograph_of
from nico_selfmodel.viz.scene.board_items import board_extent, board_item, board_name, board_outline
from nico_selfmodel.viz.scene.camera_items import (
    ImagePlane,
    camera_items,
    epipolar_items,
    epipolar_legend,
)
from nico_selfmodel.viz.scene.scene import LegendEntry, Scene, path_names
from nico_selfmodel.viz.scene.scene_items import Item
from nico_selfmodel.viz.scene.surroundings import X_WL, camera_from, floor_items

_SPREAD, _REACH = 0.86, 0.22
"""Width of an image plane in baselines at most, and its distance in those of the boards."""
_AZIMUTH, _ELEVATION = np.radians(180.0 + 34.0), np.radians(25.0)
"""Seen over the shoulder: so images and boards show their fronts."""


def camera_scene(
    assessment: CameraAssessment,
    images: Photographs | None = None,
    *,
    name: str = "cameras",
) -> Scene:
    """Describe calibrated cameras as a scene.

    W stands at the first camera, with x where it looks and z up.

    Args:
        images: Photographs: camera -> view -> red, green and blue. Those of one view are shown.

    Returns:
        Cameras with their images, boards coloured by their errors, and of a pair the rays and the
        epipolar plane of the first corner of the nearest of the better boards.

    Raises:
        ValueError: If an image is not of the size that was calibrated.
    """
    calibration = assessment.calibration
    view, corner = _chosen_point(calibration)
    planes = {
        side: ImagePlane(camera.at(X_WL @ camera.X_WC), _plane_distance(calibration))
        for side, camera in zip(calibration.views.cameras, calibration.cameras, strict=True)
    }
    items: list[Item] = []
    colors = palette.camera_colors(calibration.views.cameras)
    for side, plane in planes.items():
        size = calibration.views.size_of(side)
        image = photograph_of(images, side, calibration.views.names[view], size)
        items += camera_items(side, plane, image, colors[side])
    items += _boards(calibration, view)
    legend = [LegendEntry(f"{side} camera", palette.rgba(colors[side])) for side in planes]
    legend += _board_legend(calibration)
    if len(planes) == 2 and calibration.views.seen[view, :, corner].all():
        items += epipolar_items(calibration, planes, X_WL, view, corner)
        legend += epipolar_legend(calibration, view, corner)
    points = _held_in_view(calibration, list(planes.values()))
    grid, *_ = floor_items(points, 1.0)
    view_of_all = camera_from(points, float(_AZIMUTH), float(_ELEVATION))
    return Scene(name, (grid, *items), view_of_all, tuple(legend))


def _chosen_point(calibration: CameraCalibration) -> tuple[int, int]:
    """Return the nearest of the better views, and a corner that every camera saw in it."""
    seen = np.asarray(calibration.views.seen.all(axis=1))
    if not seen.any():  # of many cameras no board is seen by all
        seen = np.asarray(calibration.views.seen.any(axis=1))
    depth = _apply_each(calibration.X_LG, calibration.views.p_GQ.mean(axis=0))[:, 2]
    whole = seen.any(axis=1) & ~calibration.outliers
    rms = np.where(whole, calibration.view_rms, np.nan)
    better = rms <= np.nanmedian(rms) if whole.any() else seen.any(axis=1)
    view = int(np.argmin(np.where(better, depth, np.inf)))
    return view, int(np.argmax(seen[view]))


def _apply_each(poses: NDArray, point: NDArray) -> NDArray:
    """Return one point of a moving frame in each of its poses. (V, 4, 4), (3,) -> (V, 3)."""
    return np.stack([apply(pose, point) for pose in poses])


def _largest_rms(calibration: CameraCalibration) -> float:
    """Return the largest root mean square error of a board that is no outlier [px]."""
    rms = calibration.view_rms[~calibration.outliers]
    return float(rms.max()) if len(rms) and rms.max() > 0.0 else 1.0


def _held_in_view(calibration: CameraCalibration, planes: list[ImagePlane]) -> NDArray:
    """Return the corners of cameras, boards without outliers and their names [m]. Shape (n, 3)."""
    inliers = ~calibration.outliers
    poses = calibration.X_LG[inliers if inliers.any() else slice(None)]
    p_GQ = calibration.views.p_GQ
    edges = [board_outline(p_GQ, X_WL @ X_LG) for X_LG in poses]
    above = np.array([0.0, 0.0, 1.5 * board_extent(p_GQ)[2]])
    names = [edge + above for edge in edges]
    near = [np.vstack([plane.corners, plane.camera.X_WC[:3, 3]]) for plane in planes]
    return np.concatenate([*near, *edges, *names])


def _plane_distance(calibration: CameraCalibration) -> float:
    """Return how far in front of the cameras their images are drawn [m]."""
    centers = _apply_each(calibration.X_LG, calibration.views.p_GQ.mean(axis=0))
    distance = _REACH * float(np.median(np.linalg.norm(centers, axis=1)))
    if len(calibration.cameras) < 2:
        return distance
    width = max(camera.image_size[0] / camera.fx for camera in calibration.cameras)
    p = np.array([camera.X_WC[:3, 3] for camera in calibration.cameras])
    apart = np.linalg.norm(p[:, None] - p, axis=2)[np.triu_indices(len(p), 1)]
    return min(distance, _SPREAD * float(apart.min()) / width)


def _boards(calibration: CameraCalibration, chosen: int) -> list[Item]:
    views, items = calibration.views, []
    colors = palette.BOARDS(np.minimum(calibration.view_rms / _largest_rms(calibration), 1.0))[
        :, :3
    ]
    for k, name in enumerate(path_names(views.names)):
        out = bool(calibration.outliers[k])
        group = "outliers" if out else "boards"
        color = np.array(to_rgb(palette.OUTLIER)) if out else colors[k]
        X_WG = X_WL @ calibration.X_LG[k]
        items.append(board_item(f"{group}/{name}/board", views.p_GQ, X_WG, color))
        ink = palette.OUTLIER if out else palette.INK if k == chosen else palette.MUTED
        path = f"{group}/{name}/name"
        items.append(board_name(path, views.names[k], views.p_GQ, X_WG, ink, X_WL[:3, :3]))
    return items


def _board_legend(calibration: CameraCalibration) -> list[LegendEntry]:
    scale = palette.scale(palette.BOARDS)
    inliers = int((~calibration.outliers).sum())
    label = f"boards ({inliers}), by their rms (0 to {short(_largest_rms(calibration))} px)"
    entries = [LegendEntry(label, scale[-1], scale)]
    if calibration.outliers.any():
        names = [
            name
            for name, out in zip(calibration.views.names, calibration.outliers, strict=True)
            if out
        ]
        text = f"boards that are outliers ({', '.join(names)})"
        entries.append(LegendEntry(text, palette.rgba(palette.OUTLIER)))
    return entries
