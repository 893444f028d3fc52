"""Is it me: log odds of self against another and against nobody, by the timing of motion alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.contingency.motion_response import STILL, MotionResponse, series

SELF, NOT_ME, NOBODY, CANNOT_TELL = "self", "not me", "nobody", "cannot tell"
"""Verdicts."""
ODDS = 100.0 * 100.0
"""Odds at which the test stops: 100 to 1 that of a hundred verdicts not one is wrong."""
_HIDES, _SHOWS = 0.03, 0.2
"""How often, of pictures between which one moves, a mirror begins not to show it, and to show it
again: its edge, or the own arm before it."""
_LATEST = 5.0
"""Who repeats one's motion later than this counts as anybody else [s]."""


@dataclass(frozen=True, eq=False)
class Contingency:
    """What the timing of motion says of what is seen."""

    verdict: str
    """`self`, `not me`, `nobody` or `cannot tell`."""
    seconds: float
    """When self was told or ruled out; the whole time where it was neither [s]."""
    settled: bool
    """Whether more pictures could change nothing: self was told, or ruled out and it is known
    whether anybody is there."""
    log_odds: NDArray
    """Of self against all else, after each picture: against the likeliest where it is likelier than
    that, against their mean where it is less likely than that, else 0. Shape (T,)."""

    def __post_init__(self) -> None:
        """Make the array read-only."""
        object.__setattr__(self, "log_odds", read_only(self.log_odds, float))


def tell_contingency(moved: ArrayLike, seen: ArrayLike, response: MotionResponse) -> Contingency:
    """Tell whether what moves in the image is oneself.

    Three hypotheses, the last two each half as likely beforehand as the first:

        self      a hidden Markov chain: where a mirror shows what moves, P(y_t | m_(t-d-1),
                  m_(t-d)) with the delay d as learned; where it does not, P(y_t | nobody)
        another   half as likely one who moves as it likes, log L = sum_t log P(y_t | y_(t-1)), a
                  Markov chain that starts and stops as often as one does oneself; half as likely
                  one who repeats one's motion k pictures later, P(y_t | m_(t-d-k-1), m_(t-d-k)),
                  with k = 2, 3, ... as likely as 1 / k, and before that is remembered as the chain
        nobody    log L_N = sum_t log P(y_t | y_(t-1), nobody), what is seen where nothing moves: a
                  Markov chain, too, for where the own arm shows unexpectedly it does so for a while

    Who repeats one's motion pauses when oneself does: a chain loses log odds to self by each
    picture of such a pause, though self explains it no better than the one who is late.

    The test is sequential (Wald 1945): odds of `ODDS` to 1 against each of the others, by itself,
    tell self; odds of `ODDS` to 1 of their mean against it rule it out. By either no hypothesis
    that is true is told wrongly more than once in `ODDS`; odds of self against the mean would take
    one of those others for oneself as often as its share of the mean is small. Whether anybody is
    there is then told by the same odds between the other two, and where these are not reached the
    verdict is `not me`.

    Args:
        moved: m_t, how the encoders moved before each picture: `STILL`, `LITTLE` or `MUCH`. Shape
            (T,).
        seen: y_t, whether the image did, where it does not show the own body directly. Shape (T,).
        response: What was learned of oneself.

    Returns:
        The verdict, and when it fell.

    Raises:
        ValueError: If the series differ in length, or m_t is something else.
    """
    m, y = series(moved, seen)
    own, others, nobody = _logs(m, y, response)
    share = _shares(len(others))
    odds = _odds(own, np.vstack([others, nobody]), np.append(share, 1.0) / 2.0)
    empty = _odds(nobody, others, share)
    decided = np.flatnonzero(np.abs(odds) >= np.log(ODDS))
    if not len(decided):
        return Contingency(CANNOT_TELL, len(m) * response.period, False, odds)
    at = int(decided[0])
    seconds = (at + 1) * response.period
    if odds[at] > 0.0:
        return Contingency(SELF, seconds, True, odds)
    known = at + np.flatnonzero(np.abs(empty[at:]) >= np.log(ODDS))
    verdict = NOBODY if len(known) and empty[known[0]] > 0.0 else NOT_ME
    return Contingency(verdict, seconds, len(known) > 0, odds)


def _shares(count: int) -> NDArray:
    """Return how likely who moves as it likes and each of the late are beforehand. Shape (H,)."""
    late = 1.0 / np.arange(2, count + 1)
    return np.append(1.0, late / late.sum()) / 2.0


def _odds(log: NDArray, others: NDArray, shares: NDArray) -> NDArray:
    """Return the log odds of one hypothesis against others (`Contingency.log_odds`). Shape (T,).

    Args:
        log: Its log likelihood after each picture. Shape (T,).
        others: Theirs. Shape (H, T).
        shares: How likely each of them is beforehand; they sum to 1. Shape (H,).
    """
    mean = np.logaddexp.reduce(others + np.log(shares)[:, None], axis=0)
    return np.maximum(log - others.max(axis=0), 0.0) + np.minimum(log - mean, 0.0)


def _logs(m: NDArray, y: NDArray, response: MotionResponse) -> tuple[NDArray, NDArray, NDArray]:
    """Return the log likelihoods of all hypotheses after each picture.

    Returns:
        Of oneself, shape (T,); of who moves as it likes and of each of the late, shape (H, T); of
        nobody, shape (T,).
    """
    first, latest = response.delay + 1, int(_LATEST / response.period)
    if len(m) <= first:
        return np.zeros(len(m)), np.zeros((latest, len(m))), np.zeros(len(m))
    found, before = y[first:], y[first - 1 : -1]

    def each(rate: NDArray) -> NDArray:
        return np.where(found, rate, 1.0 - rate)

    moved = m[1 : len(m) - response.delay] > STILL
    rate = response.after(m)
    nothing = each(np.full(len(found), response.unprompted))
    empty = each(np.where(before, response.lingers, response.unprompted))
    chain = each(np.where(before, response.stays, response.starts))
    others = np.vstack([_summed(chain), _of_the_late(found, rate, chain, latest)])
    logs = _of_self(each(rate), nothing, moved), others, _summed(empty)
    own, other, nobody = (np.concatenate([np.zeros((*log.shape[:-1], first)), log], -1)
                          for log in logs)  # fmt: skip
    return own, other, nobody


def _of_the_late(found: NDArray, rate: NDArray, chain: NDArray, latest: int) -> NDArray:
    """Return log L of those who repeat one's motion, after each picture. Shape (latest - 1, K).

    Args:
        found: y_t. Shape (K,).
        rate: P(y_t = 1) of oneself. Shape (K,).
        chain: Likelihood of each picture by who moves as it likes. Shape (K,).
        latest: Most pictures that it may come later.
    """
    then = np.arange(len(found)) - np.arange(2, latest + 1)[:, None]
    repeated = rate[np.maximum(then, 0)]
    repeated = np.where(found, repeated, 1.0 - repeated)
    return _summed(np.where(then >= 0, repeated, chain))


def _summed(likelihood: NDArray) -> NDArray:
    return np.cumsum(np.log(likelihood), axis=-1)


def _of_self(shown: NDArray, hidden: NDArray, moved: NDArray) -> NDArray:
    """Return log L_S after each picture: the forward algorithm of two states.

    Args:
        shown: Likelihood of each picture where the image shows what moves. Shape (K,).
        hidden: The same where it does not. Shape (K,).
        moved: Whether the encoders did, so that the next picture may show what this one hides.
            Shape (K,).
    """
    steps = np.where(moved, 1.0, 0.0)[:, None, None] * [[-_HIDES, _HIDES], [_SHOWS, -_SHOWS]]
    steps = steps + np.eye(2)
    state = np.array([_SHOWS, _HIDES]) / (_SHOWS + _HIDES)
    total, out = 0.0, np.zeros(len(shown))
    for k, likelihood in enumerate(np.stack([shown, hidden], axis=1)):
        state = state * likelihood
        total += np.log(state.sum())
        out[k] = total
        state = state / state.sum() @ steps[k]
    return out
