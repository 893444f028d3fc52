"""A camera turned about its own centre towards a part of what it sees.

A renderer wants the principal point inside the picture. A hand in the corner would so be rendered
with all that lies between it and the middle; a camera turned to the hand renders the hand alone,
and a homography tells where in its picture each ray of the camera is.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_STEP = 32
"""Sides are multiples of this, so that buffers can be used again [px]."""
_BESIDE = 4
"""Pixels between what is looked at and the sides, for smoothing and interpolation."""


@dataclass(frozen=True, eq=False)
class TurnedView:
    """A pinhole that shares its centre with a camera C and looks along its own axes T."""

    R_CT: NDArray
    """How it is turned. Shape (3, 3)."""
    K: NDArray
    """Intrinsic matrix, from the edge of the first pixel [px]. Shape (3, 3)."""
    size: tuple[int, int]
    """Width and height [px]."""
    deepest: float
    """Largest distance along its axis of what is 1 along the camera's, of what is looked at."""

    @classmethod
    def of(cls, rays: NDArray, focal: NDArray) -> "TurnedView":
        """Turn to rays.

        Args:
            rays: X/Z, Y/Z around all that is looked at. Shape (N, 2).
            focal: Pixels to a unit of X/Z and Y/Z in the middle of the picture. Shape (2,).
        """
        corners = np.column_stack([rays, np.ones(len(rays))])
        ways = corners / np.linalg.norm(corners, axis=1, keepdims=True)
        z = ways.mean(axis=0)
        z /= np.linalg.norm(z)
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        R_CT = np.column_stack([x, np.cross(z, x), z])
        turned = corners @ R_CT
        places = turned[:, :2] / turned[:, 2:] * focal
        first = np.floor(places.min(axis=0)) - _BESIDE
        size = np.ceil(places.max(axis=0)) + _BESIDE - first
        room = -size % _STEP
        first -= room // 2
        K = np.array([[focal[0], 0.0, -first[0]], [0.0, focal[1], -first[1]], [0.0, 0.0, 1.0]])
        width, height = (size + room).astype(int).tolist()
        return cls(R_CT, K, (width, height), float(turned[:, 2].max()))

    @property
    def area(self) -> int:
        """Number of its pixels."""
        return self.size[0] * self.size[1]

    @property
    def H(self) -> NDArray:
        """From X/Z, Y/Z, 1 of the camera to places from the first pixel's edge. Shape (3, 3)."""
        return self.K @ self.R_CT.T

    def border(self) -> tuple[NDArray, NDArray, NDArray]:
        """Return rows and columns of the pixels on its sides, and their X/Z, Y/Z.

        Shapes (N,), (N,) and (N, 2); nan where they look behind the camera.
        """
        width, height = self.size
        across, down = np.arange(width), np.arange(height)
        rows = np.concatenate([0 * across, 0 * across + height - 1, down, down])
        columns = np.concatenate([across, across, 0 * down, 0 * down + width - 1])
        centers = np.column_stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
        ways = np.linalg.solve(self.H, centers.T).T
        depth = np.where(ways[:, 2:] > 0.0, ways[:, 2:], np.nan)
        return rows, columns, ways[:, :2] / depth
