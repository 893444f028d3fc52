"""Simple solids by their distance functions: how far points are from a body made of them.

Distances are positive outside and negative inside. That of an ellipsoid is exact on the surface and
to first order beside it; all others are exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.transform import apply, inverse

_STEP = 1e-6
"""Of the central differences that normals are made of [m]."""
_MARCHES = 40
_ARRIVED = 1e-4
"""What is this near after all marches lies on the surface [m]."""


@dataclass(frozen=True, eq=False)
class Solid:
    """An ellipsoid, capsule, cylinder or box; the first three stand along z."""

    kind: str
    """`ellipsoid`, `capsule`, `cylinder` or `box`."""
    size: tuple[float, ...]
    """Three semi-axes; radius and length of the straight part; radius and length; three sides
    [m]."""
    X_FS: NDArray
    """Pose in the frame of what carries it. Shape (4, 4)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the pose read-only."""
        numbers = {"ellipsoid": 3, "capsule": 2, "cylinder": 2, "box": 3}
        if self.kind not in numbers:
            raise ValueError(f"a solid must be one of {', '.join(numbers)}, got {self.kind!r}")
        if len(self.size) != numbers[self.kind] or not min(self.size) > 0.0:
            raise ValueError(
                f"size of a {self.kind} must be {numbers[self.kind]} positive numbers, got "
                f"{self.size}"
            )
        object.__setattr__(self, "X_FS", frozen_array(self.X_FS, (4, 4), "X_FS"))

    def distance(self, p_FQ: ArrayLike) -> NDArray:
        """Return how far points are outside [m]. Shape (N, 3) -> (N,)."""
        p = apply(inverse(self.X_FS), np.asarray(p_FQ, dtype=float))
        if self.kind == "ellipsoid":
            return _beyond_ellipsoid(p, np.array(self.size))
        if self.kind == "box":
            return _beyond_box(np.abs(p) - 0.5 * np.array(self.size))
        radius, half = self.size[0], 0.5 * self.size[1]
        aside, along = np.linalg.norm(p[:, :2], axis=1), np.abs(p[:, 2])
        if self.kind == "capsule":
            return np.hypot(aside, np.maximum(along - half, 0.0)) - radius
        return _beyond_box(np.stack([aside - radius, along - half], axis=1))


def distance_to_solids(solids: Sequence[Solid], p_FQ: ArrayLike) -> tuple[NDArray, NDArray]:
    """Return how far points are from what solids make together, and which is the nearest.

    Args:
        solids: At least one, all in one frame.
        p_FQ: Points [m]. Shape (N, 3).

    Returns:
        Distances [m] and numbers of solids. Shapes (N,).
    """
    each = np.array([solid.distance(p_FQ) for solid in solids])
    nearest = np.argmin(each, axis=0)
    return each[nearest, np.arange(each.shape[1])], nearest


def normals_of_solids(solids: Sequence[Solid], p_FQ: NDArray) -> NDArray:
    """Return the directions in which the distance grows, of unit length. Shape (N, 3)."""
    steps = _STEP * np.eye(3)
    grown = np.stack(
        [
            distance_to_solids(solids, p_FQ + step)[0] - distance_to_solids(solids, p_FQ - step)[0]
            for step in steps
        ],
        axis=1,
    )
    return grown / np.maximum(np.linalg.norm(grown, axis=1, keepdims=True), 1e-12)


def onto_solids(solids: Sequence[Solid], p_FQ: ArrayLike, way: ArrayLike) -> NDArray:
    """Move points along a direction until they meet the surface, by the distance to it.

    Args:
        solids: All in one frame.
        p_FQ: Points outside [m]. Shape (N, 3).
        way: The direction, of unit length. Shape (3,).

    Returns:
        Where they arrive; nan where they pass by. Shape (N, 3).
    """
    points = np.array(p_FQ, dtype=float)
    way = np.asarray(way, dtype=float)
    distance = np.zeros(len(points))
    for _ in range(_MARCHES):
        distance = distance_to_solids(solids, points)[0]
        points += distance[:, None] * way
    points[~(np.abs(distance) < _ARRIVED)] = np.nan
    return points


def _beyond_ellipsoid(p: NDArray, axes: NDArray) -> NDArray:
    """Return k (k - 1) / |p / a^2| with k = |p / a|, which is f / |grad f| near f = k - 1 = 0."""
    k = np.linalg.norm(p / axes, axis=1)
    slope = np.linalg.norm(p / axes**2, axis=1)
    return np.where(slope > 0.0, k * (k - 1.0) / np.maximum(slope, 1e-12), -axes.min())


def _beyond_box(beyond: NDArray) -> NDArray:
    """Return the distance where coordinates are beyond the sides by so much. Shape (N,)."""
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)
