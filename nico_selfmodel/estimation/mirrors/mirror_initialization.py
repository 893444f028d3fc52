"""Where a mirror may stand: closed-form planes from reflections, one pose being enough."""

import contextlib

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.mirrors.reflections import Reflections
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import symmetry_plane
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig


def start_plane(reflections: Reflections) -> Plane:
    """Place one mirror before the first camera, its normal towards the points.

    Two cameras rebuild each reflection behind the glass; the principal direction of reflections
    minus points is the normal, and their middle lies in the glass (thesis eq. 9.6-9.9, put right:
    the normal is a unit vector before the offset is taken, and the direction is not a mean of
    vectors that long ones rule). One camera alone has the law of reflection instead.

    Returns:
        The plane in the frame of the first camera.

    Raises:
        NotIdentifiableError: If the reflections leave the plane open.
    """
    virtual = virtual_points(reflections)
    rebuilt = np.isfinite(virtual).all(axis=1)
    if not rebuilt.any():
        return _law_of_reflection(reflections)
    return symmetry_plane(reflections.p_LQ[rebuilt], virtual[rebuilt])


def mean_plane(p_LQ: NDArray, virtual: NDArray) -> Plane:
    """Return the thesis' plane, eq. 9.6-9.9, with the normal made a unit vector first.

    Args:
        p_LQ: Points [m]. Shape (N, 3).
        virtual: Their reflections as rebuilt behind the glass [m]. Shape (N, 3).

    Returns:
        The plane, its normal towards the points.
    """
    normal = np.mean(p_LQ - virtual, axis=0)
    normal = normal / np.linalg.norm(normal)
    return Plane(normal, float(-0.5 * np.mean(p_LQ + virtual, axis=0) @ normal))


def _law_of_reflection(reflections: Reflections) -> Plane:
    """Place a mirror from what one camera sees: camera, point, image and normal lie in one plane.

    With c the camera, v the line of sight and x the point, x - 2 (n.x + d) n - c is along v: n is
    normal to every (x - c) x v, and (x - c) x v = 2 (n.x + d) n x v is linear in d. The plane is in
    the frame of the first camera, its normal towards the points.

    Raises:
        NotIdentifiableError: If all of these planes contain one direction beside the normal.
    """
    rows, sights, points = [], [], []
    X_LW, p_LQ = reflections.cameras[0].X_CW, reflections.p_LQ
    for c, camera in enumerate(reflections.cameras):
        pixels = reflections.pixels[:, 2 * c : 2 * c + 2]
        usable = has_rays(camera, pixels)
        sight = camera.rays(pixels[usable]).direction @ X_LW[:3, :3].T
        rows.append(np.cross(p_LQ[usable] - apply(X_LW, camera.X_WC[:3, 3]), sight))
        sights.append(sight)
        points.append(p_LQ[usable])
    across, sight, point = (np.concatenate(part) for part in (rows, sights, points))
    length = np.linalg.norm(across, axis=1, keepdims=True)
    # Two rows of zeros make room for a decomposition of none.
    padded = np.concatenate([across / np.maximum(length, 1e-12), np.zeros((2, 3))])
    _, values, vt = np.linalg.svd(padded)
    if values[1] <= 1e-6 * values[0]:
        raise NotIdentifiableError(
            f"{len(across)} reflection{'s' * (len(across) != 1)} seen by one camera alone cannot "
            "tell how the mirror is tilted: record poses in which both cameras see the "
            "reflection, or more of them"
        )
    normal = vt[2]
    lever = 2.0 * np.cross(normal, sight)
    height = np.sum(across * lever, axis=1) / np.maximum(np.sum(lever * lever, axis=1), 1e-12)
    side = np.copysign(1.0, float(np.median(height)))
    return Plane(side * normal, side * float(np.median(height - point @ normal)))


def virtual_points(reflections: Reflections) -> NDArray:
    """Rebuild reflections behind the glass, where both cameras saw them.

    Returns:
        Points in the frame of the first camera [m]; nan where one camera missed it or its pixel has
        no ray. Shape (N, 3).
    """
    found = np.full((len(reflections), 3), np.nan)
    if len(reflections.cameras) != 2:
        return found
    rig = StereoRig(*reflections.cameras)
    return apply(rig.left.X_CW, rebuilt_points(rig, reflections.pixels))


def rebuilt_points(rig: StereoRig, pixels: NDArray) -> NDArray:
    """Triangulate what can be: nan where a camera saw nothing, or lines of sight do not meet.

    Args:
        pixels: Shape (N, 4).

    Returns:
        Points [m]. Shape (N, 3).
    """
    found = np.full((len(pixels), 3), np.nan)
    usable = has_rays(rig.left, pixels[:, :2]) & has_rays(rig.right, pixels[:, 2:])
    try:
        found[usable] = rig.triangulate(pixels[usable]).p_WQ
    except np.linalg.LinAlgError:
        # One pair of sights that runs apart spoils the whole batch.
        for row in np.flatnonzero(usable):
            with contextlib.suppress(np.linalg.LinAlgError):
                found[row] = rig.triangulate(pixels[row : row + 1]).p_WQ[0]
    return found


def has_rays(camera: Camera, pixels: NDArray) -> NDArray:
    """Return which pixels were seen and belong to a line of sight. Shape (N, 2) -> (N,)."""
    seen = np.asarray(np.isfinite(pixels).all(axis=1))
    return seen & np.asarray(camera.has_rays(np.nan_to_num(pixels)))
