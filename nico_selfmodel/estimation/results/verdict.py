"""A verdict, and the tests of significance that it rests on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_OUTLIERS = 0.25
"""A larger share of outliers is no accident."""
FEWEST_HELD_OUT = 8
"""Held-out poses below which nothing is shown."""
FEWEST_BOARDS = 2
"""The same of boards, each of which shows dozens of corners."""
FEWEST_COMPARED = 5
"""Errors of either kind below which held-out and cross-validated ones are not compared."""
SIGNIFICANT = 3.3
"""Standard scores of a rank test beyond which held-out errors count as larger: one in 2000."""
NOTABLE = 1.3
"""And the ratio of the medians that makes it worth a failure."""


@dataclass(frozen=True)
class Verdict:
    """Status of a calibration and why."""

    status: str
    """`PASS`, `FAIL` or `NOT_EVALUATED`."""
    reasons: tuple[str, ...]
    """Failed checks, or what was checked."""
    warnings: tuple[str, ...] = ()
    """What the data cannot support, or what the model lacks, though nothing fails."""


def outliers_are_many(outliers: NDArray) -> float | None:
    """Return the share of outliers where it is no accident, else None. Boolean, shape (N,)."""
    share = float(np.mean(outliers)) if len(outliers) else 0.0
    return share if share > MOST_OUTLIERS else None


def held_out_is_worse(expected: NDArray, found: NDArray) -> tuple[float, float] | None:
    """Return the medians where held-out errors are larger than cross-validated ones.

    Args:
        expected: Errors of training poses, predicted without them. Shape (n,).
        found: Errors of held-out poses. Shape (m,).

    Returns:
        Median found and expected where the ranks say so surely and notably; else None.
    """
    if min(len(expected), len(found)) < FEWEST_COMPARED:
        return None
    medians = float(np.median(found)), float(np.median(expected))
    notable = medians[0] >= NOTABLE * max(medians[1], 1e-12)
    return medians if notable and rank_score(expected, found) >= SIGNIFICANT else None


def significantly_above(errors: NDArray, median: float, n: float, known_from: float) -> bool:
    """Return whether errors are significantly, and notably, above an expected median.

    A sign test: half of them should lie above the median, which is itself known from a sample.

    Args:
        errors: What was found. Shape (k,).
        median: What was expected, in the same unit.
        n: How many independent ones there are among them.
        known_from: How many there were in the sample.
    """
    share = float(np.mean(errors > median))
    score = (share - 0.5) / np.sqrt(0.25 * (1.0 / n + 1.0 / known_from))
    return bool(score >= SIGNIFICANT and np.median(errors) >= NOTABLE * median)


def rank_score(a: NDArray, b: NDArray) -> float:
    """Return the standard score of b's ranks over a's (Mann and Whitney 1947).

    Args:
        a: First sample. Shape (n,).
        b: Second sample. Shape (m,).

    Returns:
        About standard normal where both come from one distribution; positive where b is larger.
    """
    _, which, counts = np.unique(np.concatenate([a, b]), return_inverse=True, return_counts=True)
    # Equal values share the mean of their ranks.
    ranks = (np.cumsum(counts) - 0.5 * (counts - 1))[which]
    n, m = len(a), len(b)
    u = ranks[n:].sum() - 0.5 * m * (m + 1)
    return float((u - 0.5 * n * m) / np.sqrt(n * m * (n + m + 1) / 12.0))
