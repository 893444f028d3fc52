"""Where a board of known corners is before a camera, by homography or direct linear transform.

A flat board that is small or far has two poses that fit nearly alike, tilted by opposite angles
about one axis across the line of sight (Schweighofer, Pinz 2006).
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_initialization import flat_boards
from nico_selfmodel.geometry.resection import FEWEST, camera_pose
from nico_selfmodel.geometry.rotation import (
    nearest_rotation,
    rotation_from_vector,
    rotation_vectors_of,
)
from nico_selfmodel.geometry.transform import inverse, transform

FEWEST_CORNERS = 4
_FLAT = 1e-6
"""Thickness of a board, over its width, below which it is flat."""


def board_poses_seen(p_BQ: NDArray, rays: NDArray) -> tuple[NDArray, NDArray] | None:
    """Return the two poses of a board that rays allow; one pose twice where it is not flat.

    Args:
        p_BQ: Corners in the board's frame [m]. Shape (N, 3).
        rays: Unit directions in which a camera sees them, nan where it has none. Shape (N, 3).

    Returns:
        X_CB twice, shape (4, 4) each; None where too few corners tell.
    """
    told = np.isfinite(rays).all(axis=1)
    p, rays = p_BQ[told], rays[told]
    if len(p) < FEWEST_CORNERS:
        return None
    middle = p.mean(axis=0)
    axes = np.linalg.svd(p - middle, full_matrices=False)[2]
    if not is_flat(p):
        if len(p) < FEWEST:
            return None
        X = inverse(camera_pose(p, rays))
        return X, X
    axes = axes * np.array([[1.0], [1.0], [np.linalg.det(axes)]])
    X_BF = transform(axes.T, middle)
    try:
        (pose,) = flat_boards((p - middle) @ axes[:2].T, rays[None])
    except ValueError:  # on one line, or nearly across
        return None
    return pose @ inverse(X_BF), _tilted_back(pose) @ inverse(X_BF)


def is_flat(p_BQ: NDArray) -> bool:
    """Tell whether points lie in one plane. Shape (N, 3), N >= 3."""
    size = np.linalg.svd(p_BQ - p_BQ.mean(axis=0), compute_uv=False)
    return bool(size[2] <= _FLAT * size[0])


def _tilted_back(X_CF: NDArray) -> NDArray:
    """Return the pose with the opposite tilt against the line of sight."""
    sight = X_CF[:3, 3] / np.linalg.norm(X_CF[:3, 3])
    normal = X_CF[:3, 2] * np.copysign(1.0, X_CF[:3, 2] @ sight)
    axis = np.cross(sight, normal)
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, sight @ normal)
    back = rotation_from_vector(-2.0 * angle * axis / max(sine, 1e-12))
    return transform(back @ X_CF[:3, :3], X_CF[:3, 3])


def mirrored_back(X: NDArray) -> NDArray:
    """Return the pose whose z axis is turned round: R diag(1, 1, -1), a left-handed frame.

    A board of corners p seen in a mirror S is seen as one of corners diag(1, 1, -1) p whose frame
    S R diag(1, 1, -1) is right-handed. Shape (..., 4, 4).
    """
    return X * np.array([1.0, 1.0, -1.0, 1.0])


def mean_pose(X: NDArray) -> NDArray:
    """Return the middle one of poses: mean turn and median place of those near it. (N, 4, 4)."""
    turns = rotation_vectors_of(np.swapaxes(X[:, None, :3, :3], -1, -2) @ X[None, :, :3, :3])
    turn = np.linalg.norm(turns, axis=-1)
    apart = np.linalg.norm(X[:, None, :3, 3] - X[None, :, :3, 3], axis=-1)
    size = max(float(np.median(np.linalg.norm(X[:, :3, 3], axis=1))), 1e-12)
    far = turn + apart / size
    middle = int(np.argmin(np.median(far, axis=1)))
    near = X[far[middle] <= max(0.05, 3.0 * float(np.median(far[middle])))]
    return transform(
        nearest_rotation(near[:, :3, :3].sum(axis=0)), np.median(near[:, :3, 3], axis=0)
    )
