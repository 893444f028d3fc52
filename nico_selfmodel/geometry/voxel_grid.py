"""A regular grid of points in space, and values between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """Points at equal distances along the axes of one frame W."""

    p_WG: NDArray
    """The first point [m]. Shape (3,)."""
    pitch: float
    """From point to point [m]."""
    shape: tuple[int, int, int]
    """Points along x, y and z."""

    def __post_init__(self) -> None:
        """Check the numbers and make the point read-only."""
        object.__setattr__(self, "p_WG", frozen_array(self.p_WG, (3,), "p_WG"))
        if not (self.pitch > 0.0 and np.isfinite(self.pitch)):
            raise ValueError(f"pitch must be a positive length [m], got {self.pitch}")
        if len(self.shape) != 3 or min(self.shape) < 2:
            raise ValueError(f"shape must be three numbers of at least 2, got {self.shape}")

    @classmethod
    def about(cls, points: ArrayLike, margin: float, pitch: float) -> "VoxelGrid":
        """Lay a grid about points.

        Args:
            points: At least one [m]. Shape (N, 3).
            margin: How far the grid reaches beyond them [m].
            pitch: From point to point [m].
        """
        points = np.asarray(points, dtype=float)
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        nx, ny, nz = (np.maximum(np.ceil((high - low) / pitch), 1).astype(int) + 1).tolist()
        return cls(low, pitch, (nx, ny, nz))

    @property
    def points(self) -> NDArray:
        """All points, z fastest [m]. Shape (nx ny nz, 3)."""
        axes = [self.p_WG[k] + self.pitch * np.arange(self.shape[k]) for k in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def place(self, index: ArrayLike) -> NDArray:
        """Return where indices are, fractions too [m]. Shape (N, 3) -> (N, 3)."""
        return self.p_WG + self.pitch * np.asarray(index, dtype=float)

    def interpolated(self, values: NDArray, p_WQ: ArrayLike) -> tuple[NDArray, NDArray]:
        """Return values between points, linear along each axis, and their slopes.

        Args:
            values: One a point. Shape `shape`.
            p_WQ: Where; places beyond the grid take those of its outermost cells [m]. (N, 3).

        Returns:
            Values and their derivatives by the place, nan next to a point without a value.
            Shapes (N,) and (N, 3).
        """
        at = (np.asarray(p_WQ, dtype=float) - self.p_WG) / self.pitch
        cell = np.clip(np.floor(at).astype(int), 0, np.array(self.shape) - 2)
        part = at - cell
        value, slope = np.zeros(len(at)), np.zeros((len(at), 3))
        for corner in np.ndindex(2, 2, 2):
            upper = np.array(corner, dtype=bool)
            own = values[tuple((cell + corner).T)]
            share = np.where(upper, part, 1.0 - part)
            value += own * share.prod(axis=1)
            for k in range(3):
                others = np.delete(share, k, axis=1).prod(axis=1)
                slope[:, k] += own * others * (1.0 if upper[k] else -1.0)
        return value, slope / self.pitch
