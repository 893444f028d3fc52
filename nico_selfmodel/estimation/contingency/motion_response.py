"""How what a robot sees of itself follows its encoders: after which delay, how surely."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array, read_only
from nico_selfmodel.errors import NotIdentifiableError

STILL, LITTLE, MUCH = range(3)
"""Values of m_t: by the encoders nothing moved, so little that it may not be seen, or more."""
_ODDS = 100.0
"""Odds at which a delay is told."""


@dataclass(frozen=True, eq=False)
class MotionResponse:
    """What a robot knows of its own motion in its images."""

    period: float
    """Time between two pictures [s]."""
    delay: int
    """Pictures d by which the image comes after the encoders, or up to one more."""
    seen: NDArray
    """P(y_t = 1 | m_(t-d-1), m_(t-d)): how often the image moves after the encoders stood, moved a
    little or more. Shape (3, 3)."""
    unprompted: float
    """P(y_t = 1 | y_(t-1) = 0) where nobody is: how often motion is seen where nothing moves."""
    lingers: float
    """P(y_t = 1 | y_(t-1) = 1) where nobody is: such motion is often the own arm's, where it is not
    expected, and goes on while that moves."""
    starts: float
    """P(y_t = 1 | y_(t-1) = 0): how often what moves begins to."""
    stays: float
    """P(y_t = 1 | y_(t-1) = 1)."""

    def __post_init__(self) -> None:
        """Make the array read-only."""
        object.__setattr__(self, "seen", frozen_array(self.seen, (3, 3), "seen"))

    def after(self, moved: NDArray) -> NDArray:
        """Return P(y_t = 1) of each picture from number d + 1 on, after what the encoders did.

        Args:
            moved: m_t, `STILL`, `LITTLE` or `MUCH`. Shape (T,).

        Returns:
            Shape (T - d - 1,).
        """
        earlier, later = _before(moved, self.delay, self.delay + 1)
        return self.seen[earlier, later]


def learn_response(
    moved: ArrayLike,
    seen: ArrayLike,
    elsewhere: ArrayLike,
    period: float,
    longest: float = 0.5,
) -> MotionResponse:
    """Learn delay and reliability of one's own motion in the image, where it is surely one's own.

    Pictures arrive after a delay that is no whole number of pictures, so that one shows motion of
    two neighbouring readings. The likelihood of a delay d is that of nine coins,

        L(d) = prod_t P(y_t | m_(t-d-1), m_(t-d)),    P(y = 1 | m) = (n_1m + 1/2) / (n_m + 1),

    over the same pictures for every d; the rates are means of Beta distributions with Jeffreys'
    prior, never 0 or 1. (Gold and Scassellati 2009 have such a model with a given delay.)

    Args:
        moved: m_t, how the encoders moved before each picture: `STILL`, `LITTLE` or `MUCH`. Shape
            (T,).
        seen: y_t, whether the image did, where it shows the own body directly. Shape (T,).
        elsewhere: Whether it did where it does not, while nobody else was there. Shape (T,).
        period: Time between two pictures [s].
        longest: Delay to look for [s].

    Raises:
        NotIdentifiableError: If the motion does not tell the delay, or what is seen does not follow
            the encoders.
        ValueError: If the series differ in length.
    """
    m, y = series(moved, seen)
    false = series(moved, elsewhere)[1]
    most = int(np.ceil(longest / period))
    first = most + 1
    if len(m) <= first + 1:
        raise NotIdentifiableError(
            f"{len(m)} pictures cannot tell a delay of up to {longest:g} s: {first + 2} are the "
            "least, and 200 are rather needed; move for longer"
        )
    fits = np.array([_log_likelihood(m, y, delay, first) for delay in range(most + 1)])
    delay = int(fits.argmax())
    apart = np.abs(np.arange(most + 1) - delay) > 1
    margin = float(fits[delay] - fits[apart].max())
    rates = _rates(*_before(m, delay, first), y[first:])
    if margin < np.log(_ODDS) or rates[MUCH, MUCH] <= rates[STILL, STILL]:
        raise NotIdentifiableError(
            f"what is seen follows the encoders after no certain delay (odds {np.exp(margin):.3g} "
            f"to 1, {_ODDS:.0f} are needed): start and stop the arm more often where it is seen"
        )
    return MotionResponse(period, delay, rates, *_chain(false), *_chain(y))


def _chain(y: NDArray) -> tuple[float, float]:
    """Return P(y_t = 1 | y_(t-1)), of 0 and of 1: as means of Beta distributions, too."""
    began, stayed = (
        (float(y[1:][y[:-1] == was].sum()) + 0.5) / (float((y[:-1] == was).sum()) + 1.0)
        for was in (False, True)
    )
    return began, stayed


def series(moved: ArrayLike, seen: ArrayLike) -> tuple[NDArray, NDArray]:
    """Return m_t as whole numbers and y_t as truth values. Shape (T,) each.

    Raises:
        ValueError: If they differ in length, or m_t is something else.
    """
    m, y = read_only(moved, int), read_only(seen, bool)
    if m.ndim != 1 or m.shape != y.shape:
        raise ValueError(f"moved and seen must have one shape (T,), got {m.shape} and {y.shape}")
    if len(m) and not (m.min() >= STILL and m.max() <= MUCH):
        raise ValueError(f"moved must be {STILL} to {MUCH}, got {m.min()} to {m.max()}")
    return m, y


def _before(m: NDArray, delay: int, first: int) -> tuple[NDArray, NDArray]:
    """Return m_(t-d-1) and m_(t-d) of the pictures from `first` on."""
    return m[first - delay - 1 : len(m) - delay - 1], m[first - delay : len(m) - delay]


def _rates(earlier: NDArray, later: NDArray, found: NDArray) -> NDArray:
    """Return P(found | earlier, later). Shape (3, 3)."""
    kinds = MUCH + 1
    kind, shape = kinds * earlier + later, (kinds, kinds)
    count = np.bincount(kind, minlength=kinds**2)
    hits = np.bincount(kind, found, minlength=kinds**2)
    return ((hits + 0.5) / (count + 1.0)).reshape(shape)


def _log_likelihood(m: NDArray, y: NDArray, delay: int, first: int) -> float:
    """Return log L of a delay over the pictures from `first` on."""
    earlier, later = _before(m, delay, first)
    rate = _rates(earlier, later, y[first:])[earlier, later]
    return float(np.log(np.where(y[first:], rate, 1.0 - rate)).sum())
