"""Balls that a surface seen from outside lies on: what collides as it would, and bulges nowhere.

Of each point the largest ball that touches the surface there from within and holds no other point
deeper than e: with d to another point and n the outward normal, |d + r n| >= r - e gives

    r <= (|d|^2 - e^2) / (-2 (d . n + e))    where d . n < -e

(Ma, Bae and Choi 2012, 3D medial axis point approximation, for e = 0). Then those balls are taken,
one by one, on which within e most points lie that lie on none yet (Chvatal 1979).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.checked_points import checked_points
from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.geometry.transform import transform

_UNIT = 1e-6
"""By how much a normal's length may miss 1: of another one a point lies on no ball."""
_AT_ONCE = 1_000_000
"""Pairs of points that are looked at at once."""


def fit_balls(p_FQ: ArrayLike, n_FQ: ArrayLike, close: float, largest: float) -> tuple[Solid, ...]:
    """Return few balls on which all points lie.

    Args:
        p_FQ: Points of the surface [m]. Shape (N, 3) with N >= 1.
        n_FQ: Outward normals there, of unit length. Shape (N, 3).
        close: Within which of a ball's surface a point lies on it [m].
        largest: Radius of a ball: twice that, behind what was seen, counts as inside [m].

    Raises:
        ValueError: If there is no point, shapes differ, a number is not finite, a normal is not of
            unit length, or not 0 < close < largest.
    """
    points = checked_points(p_FQ, 1)
    normals = frozen_array(n_FQ, points.shape, "n_FQ")
    if not 0.0 < close < largest:
        raise ValueError(f"0 < close < largest must hold, got {close:g} and {largest:g} m")
    if (np.abs(np.linalg.norm(normals, axis=1) - 1.0) > _UNIT).any():
        raise ValueError("normals must be of unit length")
    radii = np.minimum(_largest(points, normals, close), largest)
    centers = points - radii[:, None] * normals
    on = np.empty((len(points), len(points)), dtype=bool)
    for part in _parts(len(points)):
        far = np.linalg.norm(centers[part, None] - points, axis=2)
        on[part] = np.abs(far - radii[part, None]) <= close
    return tuple(
        Solid("ellipsoid", (float(radii[k]),) * 3, transform(np.eye(3), centers[k]))
        for k in _covering(on)
    )


def _largest(points: NDArray, normals: NDArray, close: float) -> NDArray:
    """Return the radii of the largest balls that hold no point deeper than that. Shape (N,)."""
    found = np.empty(len(points))
    for part in _parts(len(points)):
        d = points - points[part, None]
        below = np.einsum("ijk,ik->ij", d, normals[part]) + close
        room = np.einsum("ijk,ijk->ij", d, d) - close**2
        held = (below < 0.0) & (room > 0.0)
        found[part] = np.where(held, room / np.where(held, -2.0 * below, 1.0), np.inf).min(axis=1)
    return found


def _covering(on: NDArray) -> list[int]:
    """Return balls on which all points lie. Shape (balls, points) -> numbers of balls."""
    left = np.ones(on.shape[1], dtype=bool)
    taken = []
    while left.any():
        best = int(np.argmax(on[:, left].sum(axis=1)))
        taken.append(best)
        left &= ~on[best]
    return taken


def _parts(count: int) -> list[slice]:
    """Return slices of so many points that no step takes much memory."""
    step = max(1, _AT_ONCE // count)
    return [slice(k, k + step) for k in range(0, count, step)]
