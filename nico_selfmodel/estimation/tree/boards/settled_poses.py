"""Poses that nobody reads, as those that fit best what was seen of them, sample by sample.

Of given parameters x the poses y_k of what moves freely minimise |r_k(x, y_k)|^2 on their own
(variable projection; Golub, Pereyra 1973): all samples at once, each with a damping of its own.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform

SETTLING_ROUNDS = 30
_SETTLED = 1e-12
"""Part of a sample's sum of squares below which a step that promises no more is not taken."""
_EXACT = 1e-14
"""Mean square, in the sensors' variances, below which residuals are those of rounding."""
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-12, 1e6
"""At first; what a board that has gone far away, where nothing moves its image, needs; and most."""

Evaluate = Callable[[NDArray], tuple[NDArray, NDArray]]
"""Whole poses by joint, (P, n, 4, 4), to residuals in their sensors' sigmas, (R,), and their
derivatives by turns and shifts of the free ones, (R, 6 F)."""


def settled_poses(
    evaluate: Evaluate,
    flanges: NDArray,
    free: tuple[int, ...],
    sample: NDArray,
    rounds: int = SETTLING_ROUNDS,
) -> tuple[NDArray, NDArray]:
    """Return poses with the free ones where they fit best.

    Args:
        evaluate: The forward model.
        flanges: Where to begin. Shape (P, n, 4, 4).
        free: Which joints move freely, F of them.
        sample: Sample of each residual. Shape (R,).
        rounds: Most steps.

    Returns:
        The poses, shape (P, n, 4, 4), and each sample's sum of squares, shape (P,).
    """
    count = len(flanges)
    damping = np.full(count, _DAMPING)
    r, A = evaluate(flanges)
    cost = np.bincount(sample, r * r, minlength=count)
    exact = _EXACT * np.bincount(sample, minlength=count)
    going = cost > exact
    for _ in range(rounds):
        H, g = _by_sample(r, A, sample, count)
        going &= ~_flat(H, g, cost)
        if not going.any():
            break
        step = -_solved(H, g, damping) * going[:, None]
        tried = _moved(flanges, free, step)
        now, slopes = evaluate(tried)
        fresh = np.bincount(sample, now * now, minlength=count)
        better = fresh < cost
        flanges = np.where(better[:, None, None, None], tried, flanges)
        kept = better[sample]
        r, A = np.where(kept, now, r), np.where(kept[:, None], slopes, A)
        small = cost - fresh < _SETTLED * cost
        damping = np.maximum(np.where(better, damping / 10.0, damping * 10.0), _LEAST_DAMPING)
        going &= (better & ~small) | (~better & (damping < _MOST_DAMPING))
        cost = np.where(better, fresh, cost)
        going &= cost > exact
        if not going.any():
            break
    return flanges, cost


def _flat(H: NDArray, g: NDArray, cost: NDArray) -> NDArray:
    """Whether no step promises to gain anything: g'H^-1 g. Boolean, shape (P,)."""
    gain = np.sum(g * _solved(H, g, np.full(len(H), _LEAST_DAMPING)), axis=1)
    return np.asarray(gain <= _SETTLED * cost)


def _solved(H: NDArray, g: NDArray, damping: NDArray) -> NDArray:
    """Return (H + damping diag H)^-1 g, 0 along what nothing moves. Shape (P, m)."""
    diagonal = np.einsum("kii->ki", H)
    added = damping[:, None] * diagonal + (diagonal == 0.0)
    H = H + np.eye(g.shape[1]) * added[:, None, :]
    return np.asarray(np.linalg.solve(H, g[:, :, None])[:, :, 0])


def _by_sample(r: NDArray, A: NDArray, sample: NDArray, count: int) -> tuple[NDArray, NDArray]:
    """Return A'A and A'r of each sample. Shapes (P, m, m) and (P, m)."""
    m = A.shape[1]
    H, g = np.empty((count, m, m)), np.empty((count, m))
    for i in range(m):
        g[:, i] = np.bincount(sample, A[:, i] * r, minlength=count)
        for j in range(i + 1):
            H[:, i, j] = H[:, j, i] = np.bincount(sample, A[:, i] * A[:, j], minlength=count)
    return H, g


def _moved(flanges: NDArray, free: tuple[int, ...], step: NDArray) -> NDArray:
    """Return poses turned in their own frames and shifted in their parents'. Step (P, 6 F)."""
    out = flanges.copy()
    for k, joint in enumerate(free):
        turn, shift = step[:, 6 * k : 6 * k + 3], step[:, 6 * k + 3 : 6 * k + 6]
        X = flanges[:, joint]
        out[:, joint] = transform(X[:, :3, :3] @ rotation_from_vector(turn), X[:, :3, 3] + shift)
    return out
