"""Reflections in planes n.x + d = 0: points, matrices and their derivatives."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.plane import Plane


def reflect(plane: Plane, points: ArrayLike) -> NDArray:
    """Reflect points, x' = x - 2 (n.x + d) n.

    Args:
        plane: The mirror.
        points: Shape (..., 3).

    Returns:
        Shape (..., 3).
    """
    points = np.asarray(points, dtype=float)
    return points - 2.0 * plane.distance_to(points)[..., None] * plane.normal


def reflection(plane: Plane) -> NDArray:
    """Return the reflection as a matrix [S, -2 d n; 0, 1] with S = I - 2 n n', det -1.

    It is its own inverse. A pose reflected by it has a left-handed frame. Shape (4, 4).
    """
    matrix = np.eye(4)
    matrix[:3, :3] -= 2.0 * np.outer(plane.normal, plane.normal)
    matrix[:3, 3] = -2.0 * plane.offset * plane.normal
    return matrix


def reflection_slopes(plane: Plane, points: ArrayLike) -> NDArray:
    """Return derivatives of reflected points by the plane, n as a free vector and then d.

    dx' = -2 ((x.dn) n + (n.x + d) dn) - 2 n dd; by the point itself it is S.

    Args:
        plane: The mirror.
        points: Shape (N, 3).

    Returns:
        Shape (N, 3, 4).
    """
    points = np.asarray(points, dtype=float)
    slopes = np.empty((len(points), 3, 4))
    slopes[:, :, :3] = -2.0 * plane.normal[:, None] * points[:, None, :]
    slopes[:, :, :3] -= 2.0 * plane.distance_to(points)[:, None, None] * np.eye(3)
    slopes[:, :, 3] = -2.0 * plane.normal
    return slopes
