"""Reflections in planes n.x + d = 0: points, matrices and their derivatives."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.geometry.plane import Plane

_ALIKE = 3.0
"""Reflections whose direction differs by this many times the median difference are left out."""
_NEAREST_TURN = np.radians(10.0)
"""Directions that differ less are never left out."""


def reflect(plane: Plane, points: ArrayLike) -> NDArray:
    """Reflect points, x' = x - 2 (n.x + d) n.

    Args:
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


def symmetry_plane(points: NDArray, virtual: NDArray) -> Plane:
    """Return the plane about which points and their reflections lie symmetrically.

    Args:
        points: Points [m]. Shape (N, 3).
        virtual: Their reflections as rebuilt behind the glass [m]. Shape (N, 3).

    Returns:
        The plane, its normal towards the points.

    Raises:
        NotIdentifiableError: If every reflection coincides with its point.
    """
    gap = virtual - points
    length = np.linalg.norm(gap, axis=1)
    if not (length > 0.0).any():
        raise NotIdentifiableError(
            "every reflection lies at its own point: a hand on the glass does not tell how the "
            "glass is tilted"
        )
    points, gap, length = (part[length > 0.0] for part in (points, gap, length))
    direction = gap / length[:, None]
    between = np.arccos(np.clip(direction @ direction.T, -1.0, 1.0))
    middle = int(np.argmin(np.median(between, axis=1)))
    limit = max(_ALIKE * float(np.median(between[middle])), _NEAREST_TURN)
    near = between[middle] <= limit
    normal = np.linalg.svd(gap[near], full_matrices=False)[2][0]
    normal = -normal * np.sign(normal @ direction[middle])
    return Plane(normal, float(-np.median((points + 0.5 * gap)[near] @ normal)))
