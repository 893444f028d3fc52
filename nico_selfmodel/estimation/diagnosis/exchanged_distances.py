"""Two markers of a hand whose names are exchanged now and then, by distances alone.

On a rigid hand d_ac and d_bc are constant for every other marker c. Where the names of a and b are
exchanged in some samples these two change places, and only the smaller and the larger of them stay.
It needs no arm, so that it also tells where neither way of naming prevails.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.outlier_words import EXCHANGED_CURE, name_samples

_FEWEST = 5
"""Samples that show two markers and a third for their distances to tell anything."""
_NOTABLE = 0.1
"""Share of samples with names exchanged below which that is no cause: an arm tells it."""
_MOST = 0.9
"""Share of the distances that must stay."""


def exchanged_by_distance(observations: Observations, rigid: float) -> str | None:
    """Say which two markers' names are exchanged, where that makes all distances constant.

    Args:
        observations: What was measured.
        rigid: Scatter of a distance above which two points are not on one link [m].

    Returns:
        A sentence, or None.
    """
    p, samples = _by_sample(observations)
    m = p.shape[1]
    apart = np.linalg.norm(p[:, :, None] - p[:, None], axis=3)
    found = []
    for a, b in combinations(range(m), 2):
        others = [c for c in range(m) if c not in (a, b)]
        turned = _exchanged(apart[:, a, others], apart[:, b, others], rigid)
        rest = [apart[:, c, d] for c, d in combinations(others, 2)] + [apart[:, a, b]]
        if turned is not None and all(_scatter(one) < rigid for one in rest):
            found.append((a, b, turned))
    if len(found) != 1:
        return None
    a, b, turned = found[0]
    seen = int(np.isfinite(p[:, [a, b]]).all(axis=(1, 2)).sum())
    pair = " and ".join(sorted((observations.markers[a], observations.markers[b])))
    return (
        f"markers {pair} are exchanged in {turned.sum()} of {seen} samples "
        f"({name_samples(samples[turned])}): their distances to the other markers change "
        f"places; {EXCHANGED_CURE}"
    )


def _by_sample(observations: Observations) -> tuple[NDArray, NDArray]:
    """Return the points of each sample, nan where not seen, (S, M, 3), and the samples, (S,)."""
    samples, which = np.unique(observations.sample, return_inverse=True)
    p = np.full((len(samples), len(observations.markers), 3), np.nan)
    p[which, observations.marker] = observations.p_WH
    return p, samples


def _exchanged(first: NDArray, second: NDArray, rigid: float) -> NDArray | None:
    """Return in which samples two markers' distances to others change places.

    Args:
        first: Distances of one of them. Shape (S, M - 2).
        second: Of the other. Shape (S, M - 2).
        rigid: See `exchanged_by_distance`.

    Returns:
        Those in which fewer agree. Boolean, shape (S,); None where that does not make them stay.
    """
    pairs = np.sort(np.stack([first, second]), axis=0)
    known = np.isfinite(first) & np.isfinite(second)
    if not known.size or (known.sum(axis=0) < _FEWEST).any():
        return None
    if any(_scatter(one) >= rigid for part in pairs for one in part.T):
        return None
    widths = [np.nanmedian(pairs[1, :, c] - pairs[0, :, c]) for c in range(pairs.shape[2])]
    c = int(np.argmax(widths))
    if widths[c] < 2.0 * rigid:
        return None  # nearly as far from it as each other: nobody can tell
    larger = known[:, c] & (first[:, c] > second[:, c])
    smaller = known[:, c] & ~larger
    turned = larger if larger.sum() <= smaller.sum() else smaller
    return turned if turned.sum() >= _NOTABLE * known[:, c].sum() else None


def _scatter(apart: NDArray) -> float:
    """Return how far nine of ten distances are from their median at most [m]."""
    known = apart[np.isfinite(apart)]
    return float(np.quantile(np.abs(known - np.median(known)), _MOST)) if len(known) else 0.0
