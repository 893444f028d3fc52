"""Which joint was read wrongly where points were set aside: that along which all of them lie.

A joint that is read wrongly by any angle moves a point along one line, that of its derivative by
the joint. Whitened, with e what a point is off by, c that derivative and rest = e'e - (c'e)^2/c'c,
the point is as likely as exp(-rest / 2) / (2 pi)^((k - 1) / 2) across the line, in k coordinates. A
point that is wrong in any way lies in any direction: on half a sphere of radius |e|, of the area
pi^(k/2) |e|^(k-1) / Gamma(k/2). The ratio of both,

    B = pi^(k/2) / Gamma(k/2) (e'e / 2 pi)^((k-1)/2) exp(-rest / 2),

in space e'e exp(-rest / 2), is weighed for each joint over all points, of which half may be wrong
in another way: sum log (1 + B) / 2, a logarithm of likelihoods.

A joint that slips does so anywhere. Where most poses of one part of its turn are wrong, and few
others, its encoder or gear is uneven there: the scan statistic (Kulldorff 1997), with k of m poses
wrong in a window, K of N in all, is the largest over windows of

    k log(k/m) + (m-k) log(1 - k/m) + (K-k) log((K-k)/(N-m)) + (N-m-K+k) log(1 - (K-k)/(N-m)).
"""

from collections.abc import Callable
from math import lgamma

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_noise import whitening_of
from nico_selfmodel.estimation.noise.joint_slips import FEWEST_SLIPS, OFTEN_AT
from nico_selfmodel.estimation.observations.outlier_words import chance_of_more

_ALIKE = 5.0
"""Difference of the logarithms below which the points do not tell two joints apart."""
_RARE = 1e-5
"""Chance that poses which are wrong anywhere lie together so, the windows tried counted."""
_MOSTLY = 0.5
"""Part of the poses of a window, and of all wrong ones, that are wrong there, at least."""
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


def uneven_place(place: NDArray, wrong: NDArray) -> tuple[float, float] | None:
    """Return within which readings a joint is mostly read wrongly, and seldom elsewhere.

    Args:
        place: What the joint read in each pose. Shape (P,).
        wrong: Whether that was wrong. Boolean, shape (P,).

    Returns:
        Lowest and highest of these readings; None where the wrong ones lie anywhere.
    """
    order = np.argsort(place)
    place, wrong = place[order], wrong[order]
    at, total, poses = np.flatnonzero(wrong), int(wrong.sum()), len(place)
    if total < FEWEST_SLIPS or total == poses:
        return None
    first, last = np.triu_indices(total)
    k, m = last - first + 1, at[last] - at[first] + 1
    inside, outside = _bernoulli(k, m), _bernoulli(total - k, poses - m)
    best = int(np.argmax(np.where(k * poses > total * m, inside + outside, -np.inf)))
    k, m = int(k[best]), int(m[best])
    chance = chance_of_more(k, m, total - k, poses - m) * poses * (poses + 1) / 2.0
    if chance > _RARE or k < _MOSTLY * m or k < _MOSTLY * total:
        return None
    return float(place[at[first[best]]]), float(place[at[last[best]]])


def _bernoulli(k: NDArray, m: NDArray) -> NDArray:
    """Return the largest log likelihood of k of m."""
    part = k / np.maximum(m, 1)
    likely = np.maximum(part, np.finfo(float).tiny), np.maximum(1.0 - part, np.finfo(float).tiny)
    return np.asarray(k * np.log(likely[0]) + (m - k) * np.log(likely[1]))
