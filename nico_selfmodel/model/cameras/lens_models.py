"""Lenses as a camera has them: `RadialLens` bends X / Z and Y / Z, `FisheyeLens` bends angles."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.model.cameras import fisheye, lens

_ON_AXIS = 1e-24
"""Squared radius X / Z, Y / Z of a point on the axis."""


class Lens(Protocol):
    """Between points in a camera's frame and distorted coordinates, before the intrinsic matrix."""

    @property
    def reach(self) -> float:
        """Largest radius X / Z, of a fisheye angle [rad], up to which it is monotone."""
        ...

    @property
    def widest(self) -> float:
        """Largest radius X / Z that it shows."""
        ...

    def shown(self, p_CQ: NDArray) -> NDArray:
        """Return distorted coordinates of points; nan where it shows none. (3, ...) -> (2, ...)."""
        ...

    def distort(self, ideal: NDArray) -> NDArray:
        """Return distorted coordinates of X / Z, Y / Z. Shape (2, ...) -> (2, ...)."""
        ...

    def bent(self, p_CQ: NDArray) -> NDArray:
        """Return distorted coordinates of points, shown or not; of Drake's scalars, too.

        Shape (3, ...) -> (2, ...).
        """
        ...

    def has_rays(self, distorted: NDArray) -> NDArray:
        """Tell which distorted coordinates come from X / Z, Y / Z. Shape (2, ...) -> (...)."""
        ...

    def folds(self, distorted: NDArray) -> NDArray:
        """Tell which lie beyond the monotone part. Shape (2, ...) -> (...)."""
        ...

    def undistort(self, distorted: NDArray) -> NDArray:
        """Return X / Z, Y / Z; nan stays nan. Shape (2, ...) -> (2, ...).

        Raises:
            ModelError: If there are none.
        """
        ...

    def directions(self, distorted: NDArray) -> NDArray:
        """Return unit vectors in the camera's frame; nan without a ray. (2, N) -> (N, 3)."""
        ...

    def profile(self, radii: NDArray) -> tuple[NDArray, NDArray]:
        """Return how far from the axis it shows radii, tangential distortion left out.

        Args:
            radii: X / Z, or of a fisheye angles off the axis [rad]. Shape (n,).

        Returns:
            Distorted radii, shape (n,), and their derivatives by k1, k2, ..., shape (n, k).
        """
        ...


@dataclass(frozen=True, eq=False)
class RadialLens:
    """Three radial coefficients, or the six of a rational lens, and two tangential ones."""

    k: NDArray
    """k1 to k3, or to k6."""
    p: NDArray
    """p1, p2."""

    @property
    def reach(self) -> float:
        """Largest radius X / Z up to which it is monotone."""
        return lens.largest_radius(self.k)

    @property
    def widest(self) -> float:
        """The same: it shows nothing beyond."""
        return self.reach

    def shown(self, p_CQ: NDArray) -> NDArray:
        """Return distorted coordinates of points; nan behind the camera and beyond `reach`."""
        x, y, z = p_CQ
        with np.errstate(divide="ignore", invalid="ignore"):
            ideal = np.stack([x / z, y / z])
            seen = (z > 0.0) & (np.hypot(*ideal) < self.reach)
        return self.distort(np.where(seen, ideal, np.nan))

    def distort(self, ideal: NDArray) -> NDArray:
        """Return distorted coordinates of X / Z, Y / Z."""
        return lens.distort(ideal, self.k, self.p)

    def bent(self, p_CQ: NDArray) -> NDArray:
        """Return distorted coordinates of points, shown or not; of Drake's scalars, too."""
        x, y, z = p_CQ
        return self.distort(np.stack([x / z, y / z]))

    def has_rays(self, distorted: NDArray) -> NDArray:
        """Tell which coordinates lie inside the monotone part; False for nan."""
        return lens.within_fold(distorted, self.k)

    def folds(self, distorted: NDArray) -> NDArray:
        """Tell which coordinates lie outside it."""
        return np.asarray(~lens.within_fold(distorted, self.k))

    def undistort(self, distorted: NDArray) -> NDArray:
        """Return X / Z, Y / Z, by Newton per point.

        Raises:
            ModelError: If a point lies outside the radius where the distortion is monotone.
        """
        return lens.undistort(distorted, self.k, self.p)

    def directions(self, distorted: NDArray) -> NDArray:
        """Return unit vectors in the camera's frame."""
        long = np.full((distorted.shape[1], 3), np.nan)
        seen = self.has_rays(distorted)
        long[seen] = np.stack([*self.undistort(distorted[:, seen]), np.ones(int(seen.sum()))], 1)
        return long / np.linalg.norm(long, axis=1, keepdims=True)

    def profile(self, radii: NDArray) -> tuple[NDArray, NDArray]:
        """Return distorted radii of X / Z, and derivatives by the radial coefficients."""
        ideal = np.stack([radii, np.zeros_like(radii)])
        bent, _, by = lens.bend(ideal, self.k, np.zeros(2))
        return bent[0], np.delete(by[0], (3, 4), axis=0).T  # without p1 and p2


@dataclass(frozen=True, eq=False)
class FisheyeLens:
    """Four coefficients of the angle off the axis."""

    k: NDArray
    """k1 to k4."""

    @property
    def reach(self) -> float:
        """Largest angle off the axis up to which it is monotone [rad]."""
        return fisheye.largest_angle(self.k)

    @property
    def widest(self) -> float:
        """Largest radius X / Z worth computing with."""
        return float(np.tan(min(self.reach, fisheye.WIDEST)))

    def shown(self, p_CQ: NDArray) -> NDArray:
        """Return distorted coordinates of points; nan beyond the angle where it folds."""
        x, y, z = p_CQ
        off = np.arctan2(np.hypot(x, y), z)
        seen = (off < self.reach) & (np.linalg.norm(p_CQ, axis=0) > 0.0)
        bent = fisheye.bend(np.where(seen, p_CQ, 1.0), self.k)[0]
        return np.where(seen, bent, np.nan)

    def distort(self, ideal: NDArray) -> NDArray:
        """Return distorted coordinates of X / Z, Y / Z."""
        r = np.sqrt(np.sum(ideal * ideal, axis=0) + _ON_AXIS)
        return ideal * (fisheye.bent_angle(np.arctan(r), self.k)[0] / r)

    def bent(self, p_CQ: NDArray) -> NDArray:
        """Return distorted coordinates of points, shown or not; of Drake's scalars, too."""
        x, y, z = p_CQ
        # Off the axis by nothing that counts: so that there is a slope on it.
        rho = np.sqrt(x * x + y * y + _ON_AXIS * z * z)
        return np.stack([x, y]) * (fisheye.bent_angle(np.arctan2(rho, z), self.k)[0] / rho)

    def has_rays(self, distorted: NDArray) -> NDArray:
        """Tell which coordinates lie within `fisheye.WIDEST` of the axis; False for nan."""
        return np.asarray(np.isfinite(fisheye.undistort(distorted, self.k)).all(axis=0))

    def folds(self, distorted: NDArray) -> NDArray:
        """Tell which coordinates lie beyond the angle where it folds, if there is one."""
        limit = np.array(self.reach)
        edge = fisheye.bent_angle(limit, self.k)[0]
        return np.asarray((limit < np.pi) & (np.hypot(*distorted) >= edge))

    def undistort(self, distorted: NDArray) -> NDArray:
        """Return X / Z, Y / Z.

        Raises:
            ImpossibleModelError: If a point lies beyond `fisheye.WIDEST`.
        """
        ideal = fisheye.undistort(distorted, self.k)
        lost = np.isnan(ideal).any(axis=0) & np.isfinite(distorted).all(axis=0)
        if lost.any():
            raise ImpossibleModelError(
                f"{int(lost.sum())} of {lost.size} points lie 89 deg and more off the axis of "
                "the fisheye: they have no coordinates X / Z; use points nearer to its centre"
            )
        return ideal

    def directions(self, distorted: NDArray) -> NDArray:
        """Return unit vectors in the camera's frame, past 90 deg too."""
        theta, size = fisheye.angles_of(distorted, self.k), np.hypot(*distorted)
        across = np.sin(theta) * distorted / np.where(size > 0.0, size, 1.0)
        return np.stack([*across, np.cos(theta)], axis=1)

    def profile(self, radii: NDArray) -> tuple[NDArray, NDArray]:
        """Return bent angles of angles off the axis, and derivatives by the coefficients."""
        powers = np.stack([radii ** (2 * i + 3) for i in range(len(self.k))], axis=1)
        return fisheye.bent_angle(radii, self.k)[0], powers
