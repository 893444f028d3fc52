"""Derivatives of what is seen of a body by what bends in it; those of the moments are left out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.arm.bending import (
    BACKLASH,
    BEARING,
    COUPLING,
    HARMONICS,
    LOADS,
    PIVOTS,
    RIPPLE,
    SAG,
    Bending,
)
from nico_selfmodel.model.arm.line_kinematics import cross


@dataclass(frozen=True, eq=False)
class Bent:
    """A body at poses where it bends, as far as derivatives need it; k numbers are seen of each."""

    q: NDArray
    """Displacements, as the encoders tell. Shape (N, n)."""
    approach: NDArray
    """How each encoder last moved. Shape (N, n)."""
    before: NDArray
    """Orientations of the frames before each joint turns; nothing bends. Shape (n, N, 3, 3)."""
    after: NDArray
    """Those of the links. Shape (n, N, 3, 3)."""
    moments: NDArray
    """In the frame before each joint. Shape (n, N, 3)."""
    by_turn: NDArray
    """Derivatives of what is seen by turns of what is read. Shape (k, n, N)."""
    by_bearing: tuple[NDArray, NDArray]
    """By turns about x and y of the frame before each joint, through its pivot. (k, n, N) each."""
    by_shift: tuple[NDArray, NDArray]
    """By shifts along x and y of that frame. Shape (k, n, N) each."""
    carries: NDArray | None = None
    """Whether a joint (row) carries a link (column); each all that follow if None. (n, n)."""
    drives: NDArray | None = None
    """Displacements of joints (rows) by what is read (columns); each its own if None. (n, n)."""


def bending_slopes(bending: Bending, at: Bent) -> NDArray:
    """Return derivatives of what is seen by `Bending.values`.

    Args:
        at: The body where it bends.

    Returns:
        Shape (k, N, len(bending.names)).
    """
    parts = {SAG: _by_sag, BEARING: _by_bearing_sag, BACKLASH: _by_backlash, RIPPLE: _by_ripple}
    parts |= {COUPLING: _by_coupling, LOADS: _by_loads, PIVOTS: _by_pivots}
    nothing = np.zeros((len(at.by_turn), len(at.q), 0))
    found = (parts[effect](bending, at) for effect in bending.effects)
    return np.concatenate([nothing, *found], axis=2)


def _by_sag(_: Bending, at: Bent) -> NDArray:
    return np.swapaxes(at.by_turn * at.moments[None, :, :, 2], 1, 2)


def _by_bearing_sag(_: Bending, at: Bent) -> NDArray:
    x, y = at.by_bearing
    moved = x * at.moments[None, :, :, 0] + y * at.moments[None, :, :, 1]
    return np.swapaxes(moved, 1, 2)


def _by_backlash(_: Bending, at: Bent) -> NDArray:
    return -np.swapaxes(at.by_turn * at.approach.T, 1, 2)


def _by_ripple(_: Bending, at: Bent) -> NDArray:
    waves = [wave(h * at.q.T) for h in HARMONICS for wave in (np.sin, np.cos)]
    found = at.by_turn[:, :, None] * np.stack(waves, axis=1)
    return np.moveaxis(found.reshape(len(at.by_turn), -1, len(at.q)), 1, 2)


def _by_coupling(bending: Bending, at: Bent) -> NDArray:
    i, j = np.nonzero(bending.others)
    return np.swapaxes(at.by_turn[:, i] * at.q.T[None, j], 1, 2)


def _by_loads(bending: Bending, at: Bent) -> NDArray:
    """a_i . (R_j e x -up) = e . R_j' (-up x a_i), for every axis a_i of a joint that carries j."""
    by_turn = at.by_turn * bending.sag[:, None]
    if at.drives is not None:
        by_turn = np.tensordot(by_turn, at.drives, ([1], [1])).swapaxes(1, 2)
    x, y = (by * bending.bearing_sag[:, None] for by in at.by_bearing)
    pulls = np.zeros((len(by_turn), *at.before.shape[:2], 3))
    for axis, by in ((2, by_turn), (0, x), (1, y)):
        a = np.moveaxis(at.before[..., axis], -1, 0)
        pull = np.moveaxis(cross(-bending.up.reshape(3, 1, 1), a), 0, -1)
        pulls = pulls + by[..., None] * pull
    if at.carries is None:
        felt = np.cumsum(pulls, axis=1)
    else:
        felt = np.moveaxis(np.tensordot(at.carries.T.astype(float), pulls, ([1], [1])), 1, 0)
    out = (felt[..., None, :] @ at.after)[..., 0, :]
    return out.transpose(0, 2, 1, 3).reshape(len(by_turn), len(at.q), -1)


def _by_pivots(bending: Bending, at: Bent) -> NDArray:
    """A bearing that turns by w = (w_x, w_y) about c + z shifts all beyond by -w x z."""
    wx, wy = np.moveaxis(at.moments[..., :2], -1, 0) * bending.bearing_sag[:, None]
    x, y = at.by_shift
    return np.swapaxes(y * wx - x * wy, 1, 2)
