"""Whether outliers gather at one end of a recording, where chance would have strewn them.

A robust fit accepts the larger part of a recording that changed, and calls the rest outliers. The
statistic is the largest standardised excess before or after any sample; its distribution is that
of outliers in random order (a permutation test, Good 2005), with seeds of its own.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.changes_in_time import Change, mixed_in_time
from nico_selfmodel.estimation.observations.observations import Observations

LARGEST_CHANCE = 1e-3
"""Of outliers that gather so by chance."""
_FEWEST, _MARGIN = 4, 3
"""Visits with outliers below which nothing gathers, and visits on either side of a split."""
_ORDERS = 4000
"""Random orders that are drawn ..."""
_AT_ONCE = 200
"""... so many at a time, until chance is seen to do it too."""
_MOST_VISITS = 2000
"""Visits beyond which nobody asks: so many random orders cost more than they tell."""


def outliers_in_time(observations: Observations, outliers: NDArray) -> Change | None:
    """Find whether outliers lie at one end of a recording.

    Args:
        observations: What was measured; samples are numbered in the order of time.
        outliers: Rows that are outliers. Boolean, shape (N,).

    Returns:
        What it says, or None where they are strewn over the recording, or few.
    """
    # Frames of one visit are off together: chance strews visits, not frames.
    visits, of = np.unique(observations.visit, return_inverse=True)
    wrong = np.bincount(of.reshape(-1), outliers) > 0
    if not _FEWEST <= wrong.sum() <= len(wrong) - _FEWEST or len(wrong) > _MOST_VISITS:
        return None
    found, at = _excess(wrong[None])
    rng, beyond = np.random.default_rng(0), 0
    for _ in range(_ORDERS // _AT_ONCE):
        orders = rng.permuted(np.tile(wrong, (_AT_ONCE, 1)), axis=1)
        beyond += int(np.sum(_excess(orders)[0] >= found[0]))
        if (1.0 + beyond) / (1.0 + _ORDERS) > LARGEST_CHANCE:  # more orders can only add to it
            return None
    late = observations.visit > visits[at[0]]
    before = wrong[: at[0] + 1].mean() > wrong[at[0] + 1 :].mean()
    inside = outliers & ~late if before else outliers & late
    words = (
        f"{inside.sum()} of {outliers.sum()} outliers lie {'up to' if before else 'after'} sample "
        f"{observations.sample[~late].max()}: something moved or jumped there"
    )
    # The inlier poses are explained already: there is no ratio that could be too small.
    return Change(words, np.inf, mixed_in_time(observations.angles, late.astype(float)))


def _excess(wrong: NDArray) -> tuple[NDArray, NDArray]:
    """Return the largest standardised excess at a split, and the last sample before it.

    Of k in n samples, those among the first t have the mean k t / n and a variance proportional to
    t (n - t) (hypergeometric).

    Args:
        wrong: Boolean, shape (orders, n).
    """
    n = wrong.shape[1]
    t = np.arange(1, n)
    score = np.cumsum(wrong, axis=1)[:, :-1] - wrong.sum(axis=1, keepdims=True) * t / n
    score = np.abs(score) / np.sqrt(t * (n - t))
    score[:, : _MARGIN - 1] = score[:, n - _MARGIN :] = 0.0
    return score.max(axis=1), score.argmax(axis=1)
