"""Reflections in a spherical mirror, to see whether an estimator notices that it is not flat."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import move_on_sphere
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror

_NEWTON_STEPS = 30
_STEP = 1e-7


def curved_reflection(
    camera: Camera, mirror: Mirror, radius: float, p_LQ: NDArray, X_LC: NDArray
) -> NDArray:
    """Return where a camera sees reflections in a sphere that touches a mirror's plane.

    Light takes the path of stationary length over the glass (Fermat), found by Newton. The sphere
    touches the plane at the left camera's foot.

    Args:
        camera: Lens of the camera; its own pose is not used.
        mirror: The plane in the left camera's frame L.
        radius: Of the sphere [m]; positive bulges towards the cameras, negative away from them.
        p_LQ: Points [m]. Shape (N, 3).
        X_LC: Pose of the camera in L. Shape (4, 4).

    Returns:
        Pixels; nan where the camera cannot see one. Shape (N, 2).
    """
    p_LC = X_LC[:3, 3]
    centre = -(mirror.distance + radius) * mirror.normal
    tilt = np.zeros((len(p_LQ), 2))
    for _ in range(_NEWTON_STEPS):
        slope = _path_slope(centre, radius, mirror.normal, tilt, p_LC, p_LQ)
        bend = np.stack(
            [
                _path_slope(centre, radius, mirror.normal, tilt + _STEP * axis, p_LC, p_LQ) - slope
                for axis in np.eye(2)
            ],
            axis=-1,
        )
        step = np.linalg.solve(bend / _STEP, -slope[:, :, None])[:, :, 0]
        tilt = tilt + step
        if np.abs(step).max(initial=0.0) < 1e-14:
            break
    on_glass = centre + radius * move_on_sphere(mirror.normal, tilt)[0]
    return camera.at(X_LC).project(on_glass)


def _path_slope(
    centre: NDArray, radius: float, normal: NDArray, tilt: NDArray, p_LC: NDArray, p_LQ: NDArray
) -> NDArray:
    """Return the derivative of the path's length by where it meets the glass. Shape (N, 2)."""
    outward, by_tilt = move_on_sphere(np.broadcast_to(normal, (len(tilt), 3)), tilt)
    at = centre + radius * outward
    towards = [at - p_LC, at - p_LQ]
    pull = sum(v / np.linalg.norm(v, axis=1, keepdims=True) for v in towards)
    return radius * np.einsum("nij,ni->nj", by_tilt, pull)
