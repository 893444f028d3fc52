"""Planes n.x + d = 0 fitted to points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.checked_points import checked_points


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane n.x + d = 0 with a unit normal."""

    normal: NDArray
    """Unit normal n. Shape (3,)."""
    offset: float
    """d [m]: minus the signed distance of the origin along the normal."""

    @classmethod
    def from_points(cls, points: ArrayLike, weights: ArrayLike | None = None) -> "Plane":
        """Fit the plane that minimises the squared distances to points.

        The normal is the smallest right singular vector of the centred points; the thesis' eq. A.3,
        which it names for this, defines homogeneous points instead.

        Args:
            points: Shape (n, 3) with n >= 3.
            weights: Of the squared distances, positive; alike if omitted. Shape (n,).

        Returns:
            The plane through the weighted centroid.

        Raises:
            ValueError: If `points` has another shape or is not finite, the points are collinear
                or coincide, or there is not a positive weight each.
        """
        points = checked_points(points, 3)
        w = np.ones(len(points)) if weights is None else np.asarray(weights, dtype=float)
        if w.shape != points.shape[:1] or not (np.isfinite(w) & (w > 0.0)).all():
            raise ValueError(f"weights must be {len(points)} positive numbers, got {w}")
        w = w / w.mean()
        centroid = np.average(points, axis=0, weights=w)
        _, values, vt = np.linalg.svd(np.sqrt(w)[:, None] * (points - centroid))
        if values[1] <= 1e-12 * max(values[0], np.abs(centroid).max()):
            raise ValueError("the points are collinear or coincide: they do not span a plane")
        return cls(vt[2], float(-vt[2] @ centroid))

    def distance_to(self, points: ArrayLike) -> NDArray:
        """Return the signed distances of points along the normal [m]. Shape (..., 3) -> (...)."""
        return np.asarray(points, dtype=float) @ self.normal + self.offset

    def met_between(self, starts: NDArray, ends: NDArray) -> NDArray:
        """Return where straight ways meet the plane, as lines of sight do. Shape (..., 3)."""
        near, far = self.distance_to(starts), self.distance_to(ends)
        return starts + (near / (near - far))[..., None] * (ends - starts)
