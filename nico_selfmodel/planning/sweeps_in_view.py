"""Sweeps of single joints about one home pose, as wide as the hand stays in view."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.plant import ArmDescription

_RADIUS = 0.06
"""Smallest circle that a sweep should make [m]."""
_HALF = 30
"""Poses that are looked at on each side of home."""


def widest_sweeps(
    arm: ArmDescription,
    candidates: NDArray,
    in_view: Callable[[NDArray], NDArray],
    arc: float,
    markers: Sequence[str],
) -> tuple[NDArray, NDArray]:
    """Return the home whose smallest sweep in view is largest, and its sweeps.

    Args:
        candidates: Poses in view, one of which becomes home [rad]. Shape (N, n).
        in_view: Tells at which poses all is seen. Shapes (K, n) -> (K,).
        arc: Largest arc of a sweep [rad].
        markers: Points of the arm, each of which must move on circles that are large enough.

    Returns:
        Home [rad], shape (n,), and lower and upper end of each joint's sweep [rad], shape (n, 2);
        zeros where no candidate's circles are large enough.
    """
    n = len(arm.lower)
    best, home, arcs = -1.0, np.zeros(n), np.zeros((n, 2))
    for q in candidates:
        if (_radii(arm, q, markers) < _RADIUS).any():
            continue
        found = np.array([_sweep(arm, q, i, in_view, arc) for i in range(n)])
        size = float(np.ptp(found, axis=1).min())
        if size > best:
            best, home, arcs = size, q, found
    return home, arcs


def _sweep(
    arm: ArmDescription, q: NDArray, i: int, in_view: Callable[[NDArray], NDArray], arc: float
) -> tuple[float, float]:
    """Return how far a joint may turn about a pose with the hand in view [rad]."""
    steps = np.linspace(-0.5 * arc, 0.5 * arc, 2 * _HALF + 1)
    values = np.clip(q[i] + steps, arm.lower[i], arm.upper[i])
    poses = np.tile(q, (len(values), 1))
    poses[:, i] = values
    hidden = np.flatnonzero(~in_view(poses))
    below, above = hidden[hidden < _HALF], hidden[hidden > _HALF]
    first = below.max() + 1 if len(below) else 0
    last = above.min() - 1 if len(above) else 2 * _HALF
    return float(values[first]), float(values[last])


def _radii(arm: ArmDescription, q: NDArray, markers: Sequence[str]) -> NDArray:
    """Return the radius of each joint's circle at a pose, the least of all points [m]."""
    at = arm.chain.rezeroed(q)
    rows = [arm.markers.index(marker) for marker in markers]
    arms = at.p_WH_zero[rows][:, None] - at.points
    return np.linalg.norm(np.cross(at.directions, arms), axis=2).min(axis=0)
