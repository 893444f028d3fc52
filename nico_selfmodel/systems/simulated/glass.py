"""The glass of a mirror that stands somewhere: what lines of sight meet it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.transform import apply, inverse


@dataclass(frozen=True, eq=False)
class Glass:
    """A flat rectangle in W."""

    X_WM: NDArray
    """Its pose: z into it, x right and y down for whoever looks into it. Shape (4, 4)."""
    width: float
    """Along x [m]."""
    height: float
    """Along y [m]."""

    def __post_init__(self) -> None:
        """Make the pose read-only."""
        object.__setattr__(self, "X_WM", frozen_array(self.X_WM, (4, 4), "pose of the glass"))

    @property
    def plane(self) -> Plane:
        """Its plane, the normal out of the glass."""
        normal = -self.X_WM[:3, 2]
        return Plane(normal, float(-normal @ self.X_WM[:3, 3]))

    def between(self, start: NDArray, end: NDArray, edge: float = 0.0) -> NDArray:
        """Return whether straight ways pass through the glass.

        Args:
            start: Where they begin [m]. Shape (..., 3).
            end: Where they end [m]. Shape (..., 3).
            edge: How far from its edges they must pass [m].

        Returns:
            Boolean. Shape (...).
        """
        a, b = (apply(inverse(self.X_WM), p) for p in np.broadcast_arrays(start, end))
        gap = a[..., 2] - b[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = a + (a[..., 2] / gap)[..., None] * (b - a)
        half = 0.5 * np.array([self.width, self.height]) - edge
        with np.errstate(invalid="ignore"):
            inside = (np.abs(at[..., :2]) < half).all(axis=-1)
        return np.asarray((a[..., 2] * b[..., 2] < 0.0) & inside)
