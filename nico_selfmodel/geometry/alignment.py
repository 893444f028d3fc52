"""Rigid and similarity alignment of matched points (Umeyama 1991)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.checked_points import checked_points
from nico_selfmodel.geometry.rotation import nearest_rotation


@dataclass(frozen=True, eq=False)
class Alignment:
    """The transform `target = scale * rotation @ source + translation`."""

    rotation: NDArray
    """Shape (3, 3), determinant +1."""
    translation: NDArray
    """Shape (3,) [m]."""
    scale: float
    """1.0 for a rigid alignment."""

    @classmethod
    def from_points(
        cls, source: ArrayLike, target: ArrayLike, *, with_scale: bool = False
    ) -> "Alignment":
        """Align matched points in the least squares sense.

        The scale is unbiased by noise in `target`, unlike a mean of distances.

        Args:
            source: Points to move. Shape (n, 3) with n >= 3, not collinear.
            target: Where they should land. Shape (n, 3).
            with_scale: Estimate the scale too.

        Raises:
            ValueError: If the shapes differ, a point is not finite, or the source points are
                collinear or coincide.
        """
        source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
        if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 3:
            raise ValueError(
                f"source and target must both have shape (n, 3), got {source.shape}, {target.shape}"
            )
        source, target = checked_points(source, 3, "source"), checked_points(target, 3, "target")
        source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
        a, b = source - source_mean, target - target_mean
        spread = np.linalg.svd(a, compute_uv=False)
        if spread[1] <= 1e-12 * max(spread[0], np.abs(source_mean).max()):
            raise ValueError("alignment needs at least three points that are not collinear")
        covariance = b.T @ a
        rotation = nearest_rotation(covariance)
        scale = float(np.sum(rotation * covariance) / np.sum(a * a)) if with_scale else 1.0
        return cls(rotation, target_mean - scale * rotation @ source_mean, scale)

    def apply(self, points: ArrayLike) -> NDArray:
        """Move points. Shape (..., 3) -> (..., 3)."""
        return self.scale * np.asarray(points, dtype=float) @ self.rotation.T + self.translation
