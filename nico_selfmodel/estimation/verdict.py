"""PASS, FAIL or NOT_EVALUATED, with reasons: the checks that every calibration has to pass."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MOST_OUTLIERS = 0.25
"""A larger share of what was measured that is not believed is no accident."""
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
_BLIND_SHOWN = 3
"""Blind directions among the reasons; the result lists them all."""


@dataclass(frozen=True)
class Verdict:
    """Status of a calibration and why."""

    status: str
    """`PASS`, `FAIL` or `NOT_EVALUATED`."""
    reasons: tuple[str, ...]
    """Failed checks, or what was checked."""
    warnings: tuple[str, ...] = ()
    """What the data cannot support, or what the model lacks, though nothing fails."""


def conclude(
    checks: Iterable[str | None],
    held_out: int,
    what: str,
    passed: Iterable[str],
    warnings: Iterable[str] = (),
    *,
    fewest: int = FEWEST_HELD_OUT,
) -> Verdict:
    """Return the verdict that checks come to.

    Args:
        checks: What fails, in words; None or empty where it does not.
        held_out: How many held-out poses (or boards) were evaluated.
        what: What is held out: `poses`, `boards`.
        passed: What to say where nothing fails, the held-out error first.
        warnings: What is doubtful though nothing fails.
        fewest: Of what is held out, below which nothing is shown.

    Returns:
        FAIL where a check fails; NOT_EVALUATED where too little was held out; else PASS.
    """
    failed = tuple(reason for reason in checks if reason)
    doubts = tuple(warnings)
    if failed:
        return Verdict("FAIL", failed, doubts)
    if not held_out:
        reason = "nothing was held out: give --test or --test-fraction"
        return Verdict("NOT_EVALUATED", (reason,), doubts)
    if held_out < fewest:
        reason = f"only {held_out} {what} held out, too few to show anything: hold out {fewest}"
        return Verdict("NOT_EVALUATED", (reason, *passed), doubts)
    return Verdict("PASS", tuple(passed), doubts)


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


def bound_reason(mean: float | None, bound: float | None, unit: str) -> str | None:
    """Say when a held-out error misses a bound that the user gave.

    Args:
        mean: The error; None where nothing was held out.
        bound: The bound; None where none was given.
        unit: `mm` or `px`.
    """
    if bound is None:
        return None
    if mean is None:
        return f"--require-test-{unit} was given but nothing was held out"
    if mean <= bound:
        return None
    return f"mean held-out error {mean:.3f} {unit}, required at most {bound:g} {unit}"


def shortened(words: list[str]) -> list[str]:
    """Return the first sentences on blind directions, and how many more there are."""
    more = len(words) - _BLIND_SHOWN
    return words if more <= 0 else [*words[:_BLIND_SHOWN], f"and {more} more blind directions"]


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
