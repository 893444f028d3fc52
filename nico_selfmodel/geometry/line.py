"""Lines in space and the common normal of two of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.checked_points import checked_points


@dataclass(frozen=True, eq=False)
class Line:
    """A line in space."""

    point: NDArray
    """A point on the line [m]. Shape (3,)."""
    direction: NDArray
    """Unit direction. Shape (3,)."""

    @classmethod
    def from_points(cls, points: ArrayLike) -> "Line":
        """Fit the line that minimises the squared distances to points.

        Args:
            points: Shape (n, 3) with n >= 2.

        Returns:
            The line through the centroid along the largest principal direction.

        Raises:
            ValueError: If `points` has another shape or is not finite, or all points coincide.
        """
        points = checked_points(points, 2)
        centroid = points.mean(axis=0)
        _, values, vt = np.linalg.svd(points - centroid, full_matrices=False)
        if values[0] == 0.0:
            raise ValueError("a line needs two different points, all given points coincide")
        return cls(centroid, vt[0])

    def distance_to(self, points: ArrayLike) -> NDArray:
        """Return the distances of points to the line [m]. Shape (..., 3) -> (...)."""
        offset = np.asarray(points, dtype=float) - self.point
        along = offset @ self.direction
        return np.linalg.norm(offset - along[..., None] * self.direction, axis=-1)


def common_normal_feet(
    point_a: ArrayLike, direction_a: ArrayLike, point_b: ArrayLike, direction_b: ArrayLike
) -> tuple[NDArray, NDArray]:
    """Return the feet of the common normal of two lines that are not parallel.

    Solves a + s da + r x = b + t db with x along da x db (the thesis' eq. 6.10 without the detour
    of eq. 6.11-6.13).

    Args:
        point_a: A point of line a. Shape (3,).
        direction_a: Unit direction of line a. Shape (3,).
        point_b: A point of line b. Shape (3,).
        direction_b: Unit direction of line b. Shape (3,).

    Returns:
        The foot on a and the foot on b. Each of shape (3,).

    Raises:
        ValueError: If the lines are parallel to machine precision.
    """
    a, da = np.asarray(point_a, dtype=float), np.asarray(direction_a, dtype=float)
    b, db = np.asarray(point_b, dtype=float), np.asarray(direction_b, dtype=float)
    normal = np.cross(da, db)
    if np.linalg.norm(normal) < 1e-12:
        raise ValueError("parallel lines have no single common normal")
    s, t, _ = np.linalg.solve(np.stack([da, -db, normal], axis=1), b - a)
    return a + s * da, b + t * db
