"""The weight of an arm of which only the geometry is known: uniform rods from axis to axis.

Rods join the feet c_i of the axes, from the tracked points' middle backwards, each foot the nearest
to the next, so that they stay where they are on their links however the arm moves. With weights m_j
by length, one in all, M_j of all beyond link j, and d_j = c_{j+1} - c_j:

    l_j = (m_j / 2 + M_j) d_j

Links are no rods. What is known of one without data: its weight w_j to a factor of two, s = ln 2;
w_j is half by length and half one n-th of all, for short links have motors, too; its centre of mass
is anywhere along the rod, and beside it by a part a of a rod of mean length d. Along each axis x of
the link's frame:

    var l_jx = (w_j^2 / 12 + s^2 (w_j^2 / 4 + sum over k > j of w_k^2)) d_jx^2 + (a d w_j)^2

That a weight moves the loads of all links before it alike is left out: it tells nothing more.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.dh_table import DhTable

_FACTOR = float(np.log(2.0))
"""Standard deviation of the logarithm of a link's weight."""
_BESIDE = 0.2
"""Standard deviation of a centre of mass across its rod, as a part of a mean rod."""


def uniform_rods(table: DhTable) -> tuple[NDArray, NDArray]:
    """Return the loads and pivots of a `Bending`.

    Returns:
        First moments in the frame after each row, shape (n, 3), and the places of the feet along
        their axes, shape (n,) [m].
    """
    rods = _Rods.of(table)
    beyond = rods.weight[::-1].cumsum()[::-1] - rods.weight
    return (0.5 * rods.weight + beyond)[:, None] * rods.along, rods.pivots


def load_sigmas(table: DhTable) -> NDArray:
    """Return how far loads may be from those of uniform rods, as standard deviations.

    Returns:
        In the frame after each row [m of the arm's weight]. Shape (n, 3).
    """
    rods = _Rods.of(table)
    w = 0.5 * (rods.weight + 1.0 / len(rods.weight))
    squares = w**2
    beyond = squares[::-1].cumsum()[::-1] - squares
    along = squares / 12.0 + _FACTOR**2 * (squares / 4.0 + beyond)
    across = _BESIDE * float(np.mean(np.linalg.norm(rods.along, axis=1))) * w
    return np.sqrt(along[:, None] * rods.along**2 + across[:, None] ** 2)


@dataclass(frozen=True, eq=False)
class _Rods:
    along: NDArray
    """From foot to foot, in the frame after each row [m]. Shape (n, 3)."""
    weight: NDArray
    """By length, one in all. Shape (n,)."""
    pivots: NDArray
    """Places of the feet along their axes [m]. Shape (n,)."""

    @classmethod
    def of(cls, table: DhTable) -> "_Rods":
        frames = table.frames(np.zeros(len(table.joints)))
        o, z = frames[:-1, :3, 3], frames[:-1, :3, 2]
        feet = [frames[-1, :3, :3] @ table.p_NH.mean(axis=0) + frames[-1, :3, 3]]
        for origin, axis in zip(o[::-1], z[::-1], strict=True):
            feet.append(origin + axis * (axis @ (feet[-1] - origin)))
        c = np.stack(feet[::-1])
        rod = np.diff(c, axis=0)
        length = np.linalg.norm(rod, axis=1)
        weight = length / max(float(length.sum()), np.finfo(float).tiny)
        along = (np.swapaxes(frames[1:, :3, :3], 1, 2) @ rod[:, :, None])[:, :, 0]
        return cls(along, weight, np.sum((c[:-1] - o) * z, axis=1))
