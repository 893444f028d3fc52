"""Which joint was read wrongly where points were set aside: that along which all of them lie.

A joint that is read wrongly by any angle moves a point along one line, that of its derivative by
the joint. Whitened, with e what a point is off by, c that derivative and rest = e'e - (c'e)^2/c'c,
the point is as likely as exp(-rest / 2) / (2 pi)^((k - 1) / 2) across the line, in k coordinates. A
point that is wrong in any way lies in any direction: on half a sphere of radius |e|, of the area
pi^(k/2) |e|^(k-1) / Gamma(k/2). The ratio of both,

    B = pi^(k/2) / Gamma(k/2) (e'e / 2 pi)^((k-1)/2) exp(-rest / 2),

in space e'e exp(-rest / 2), is weighed for each joint over all points, of which half may be wrong
in another way: sum log (1 + B) / 2, a logarithm of likelihoods.
"""

from collections.abc import Callable
from math import lgamma

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_noise import whitening_of
from nico_selfmodel.estimation.noise.joint_slips import FEWEST_SLIPS, OFTEN_AT

_ALIKE = 5.0
"""Difference of the logarithms below which the points do not tell two joints apart."""


TRIED_TURNS = (
    np.radians(np.arange(-180.0, 180.0, 4.0)),
    np.radians(np.arange(-4.0, 4.1, 0.4)),
    np.radians(np.arange(-0.4, 0.41, 0.04)),
)
"""Angles by which a joint may have been off, each about the best of those before [rad]."""


def nearest_turns(points: Callable[[NDArray, NDArray], NDArray], p: NDArray, n: int) -> NDArray:
    """Return by which angle of each joint alone points come nearest to where they were measured.

    Args:
        points: Predicts points, some of them by their number, shape (K,), with the joints turned
            by angles beyond their readings, shape (K, n) -> (K, 3).
        p: Where they were measured. Shape (N, 3).
        n: How many joints there are.

    Returns:
        Shape (N, n).
    """
    found = np.zeros((len(p), n))
    for j in range(n):
        for grid in TRIED_TURNS:
            tried = found[:, j, None] + grid
            which, turns = np.repeat(np.arange(len(p)), len(grid)), np.zeros((tried.size, n))
            turns[:, j] = tried.ravel()
            off = np.linalg.norm(points(which, turns) - p[which], axis=1).reshape(tried.shape)
            found[:, j] = tried[np.arange(len(p)), np.argmin(off, axis=1)]
    return found


def misread_joints(
    residuals: NDArray,
    by_angle: NDArray,
    covariance: NDArray,
    turned: tuple[NDArray, NDArray] | None = None,
) -> tuple[tuple[int, ...], NDArray]:
    """Return which joint may have been read wrongly where points were set aside.

    Args:
        residuals: Measured minus predicted, of these points. Shape (N, k).
        by_angle: Derivatives of what is predicted by the joints. Shape (N, k, n).
        covariance: Of what is expected of each. Shape (N, k, k).
        turned: Angles by which each joint alone is turned where its derivatives are, shape (N, n),
            and the residuals there, shape (N, k, n); none is if omitted.

    Returns:
        The likeliest joint and those that the points do not tell from it, none where no joint
        explains them; and by how much the likeliest was off at each point, nan where another cause
        is likelier [the joints' unit]. Shape (N,).
    """
    off = np.full(len(residuals), np.nan)
    if len(residuals) < FEWEST_SLIPS:
        return (), off
    white = whitening_of(covariance, np.ones(residuals.shape, dtype=bool))
    e = np.einsum("nab,nb->na", white, residuals)
    c = white @ by_angle
    power = np.maximum(np.sum(c * c, axis=1), np.finfo(float).tiny)
    at, left = (0.0, e[:, :, None]) if turned is None else (turned[0], white @ turned[1])
    step = np.sum(c * left, axis=1) / power
    angle, rest = at + step, np.sum(left * left, axis=1) - step**2 * power
    square = np.sum(e * e, axis=1)[:, None]
    k = residuals.shape[1]
    sphere = 0.5 * k * np.log(np.pi) - lgamma(0.5 * k)
    ways = sphere + 0.5 * (k - 1) * np.log(square / (2.0 * np.pi))
    ratio = ways - 0.5 * rest
    gain = np.sum(np.logaddexp(0.0, ratio) - np.log(2.0), axis=0)
    best = int(np.argmax(gain))
    if gain[best] - np.log(len(gain)) < OFTEN_AT:
        return (), off
    own = ratio[:, best] > 0.0
    off[own] = angle[own, best]
    alike = np.flatnonzero(gain > gain[best] - _ALIKE)
    return tuple(alike[np.argsort(-gain[alike])].tolist()), off
