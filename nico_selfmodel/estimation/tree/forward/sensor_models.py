"""What sensors show of a point or frame in their own frame S, with derivatives.

Each returns the prediction (N, k), its derivatives by the point p_SM (N, k, 3) and by a turn of the
marker's frame, given in S (N, k, 3), and by a camera's intrinsics (N, k, 10) or None.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import (
    rotation_from_vector,
    rotation_vector_slope,
    rotation_vectors_of,
    turned_to_z,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import project_in_camera

_NEAREST = 1e-3
"""A camera sees no nearer than this [m]; in front of it or not is the bearings' to tell."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Residuals of a sensor, predicted minus measured, with their derivatives."""

    residual: NDArray
    """Shape (N, k)."""
    by_point: NDArray
    """By p_SM. Shape (N, k, 3)."""
    by_turn: NDArray | None = None
    """By a turn of the marker's frame, expressed in S. Shape (N, k, 3)."""
    by_lens: NDArray | None = None
    """By a camera's intrinsics. Shape (N, k, 10)."""

    @classmethod
    def together(cls, parts: Sequence["Shown"]) -> "Shown":
        """Return what several sensors of one kind show, but for their intrinsics."""
        if len(parts) == 1:
            return parts[0]
        turned = [part.by_turn for part in parts if part.by_turn is not None]
        return cls(
            np.concatenate([part.residual for part in parts]),
            np.concatenate([part.by_point for part in parts]),
            np.concatenate(turned) if turned else None,
        )


def shown_points(p_SM: NDArray, measured: NDArray) -> Shown:
    """A tracker: the point itself, by a frame of which z is the line of sight."""
    R_DS = turned_to_z(measured)
    return Shown((R_DS @ (p_SM - measured)[:, :, None])[:, :, 0], R_DS)


def shown_poses(p_SM: NDArray, R_SM: NDArray, measured: NDArray) -> Shown:
    """A tracker of frames: the point and e = log(R_SM R_measured'), which J(e)^-1 dw moves.

    Both are in a frame of which z is the line of sight: a camera knows least of depth.
    """
    R_measured, R_DS = rotation_from_vector(measured[:, 3:]), turned_to_z(measured[:, :3])
    e = rotation_vectors_of(R_SM @ np.swapaxes(R_measured, 1, 2))
    N = len(p_SM)
    by_point, by_turn = np.zeros((N, 6, 3)), np.zeros((N, 6, 3))
    by_point[:, :3] = R_DS
    by_turn[:, 3:] = R_DS @ np.linalg.inv(rotation_vector_slope(e))
    both = np.stack([p_SM - measured[:, :3], e], axis=1) @ np.swapaxes(R_DS, 1, 2)
    return Shown(both.reshape(N, 6), by_point, by_turn)


def shown_pixels(p_SM: NDArray, lens: Camera, measured: NDArray) -> Shown:
    """A camera: pixels."""
    p = np.array(p_SM.T)
    near = np.abs(p[2]) < _NEAREST
    if near.any():
        p[2, near] = np.copysign(_NEAREST, p[2, near])
    pixels, by_point, by_lens = project_in_camera(p, lens.values, lens.lens)
    return Shown(
        pixels.T - measured, by_point.transpose(2, 0, 1), by_lens=by_lens.transpose(2, 0, 1)
    )


def shown_bearings(p_SM: NDArray, lens: Camera, rays: NDArray) -> Shown:
    """A camera, for starts: f (u - ray), u = p / |p|, du/dp = (I - u u') / |p|.

    No point behind the camera can trap it, as pixels would.
    """
    f = 0.5 * (lens.fx + lens.fy)
    length = np.maximum(np.linalg.norm(p_SM, axis=1), _NEAREST)
    u = p_SM / length[:, None]
    slope = f * (np.eye(3) - u[:, :, None] * u[:, None, :]) / length[:, None, None]
    return Shown(f * (u - rays), slope)


def shown_distances(p_SM: NDArray, measured: NDArray) -> Shown:
    """The distance of two markers, of which S is the second; of what touches less what it is."""
    length = np.maximum(np.linalg.norm(p_SM, axis=1), 1e-9)
    return Shown(length[:, None] - measured, (p_SM / length[:, None])[:, None, :])


def shown_heights(p_SM: NDArray) -> Shown:
    """The height over a plane z = 0 in which the marker lies."""
    return Shown(p_SM[:, 2:], np.broadcast_to(np.eye(3)[2:], (len(p_SM), 1, 3)))
