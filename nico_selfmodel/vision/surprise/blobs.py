"""Places of a picture that are more surprising than all places of a hundred pictures should be."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.vision.surprise.surprise import Surprise

FALSE_ALARM = 0.01
"""How often one picture of what was expected has a surprising place."""
_HALVINGS = 80
_HIGHEST = 400.0
_LEAST = 1e-9
_ENOUGH = 2.0
"""A place counts for the middle of a blob by its surprise up to so many thresholds: beyond, it is
the paint that differs, not how much of the place it covers."""


@dataclass(frozen=True)
class Blob:
    """A surprising place of a picture."""

    u: float
    """Column of its middle, weighed by surprise [px]."""
    v: float
    """Row of its middle [px]."""
    area: int
    """Of all that is surprising about it [px]."""
    chi_square: float
    """z^2 of its most surprising place."""
    parts: tuple[tuple[float, float], ...] = ()
    """Column and row of each part of a spot that is seen in several [px]."""
    reach: float = 0.0
    """How far its farthest pixel is from its middle, at most [px]."""

    def apart(self, other: "Blob") -> float:
        """Return how far the middles of this and another place are apart [px]."""
        return float(np.hypot(self.u - other.u, self.v - other.v))

    def with_part(self, other: "Blob") -> "Blob":
        """Return this and another place of the same spot as one, each weighed by its surprise."""
        own, added = self.area * self.chi_square, other.area * other.chi_square
        share, apart = added / (own + added), self.apart(other)
        return Blob(
            self.u + share * (other.u - self.u),
            self.v + share * (other.v - self.v),
            self.area + other.area,
            max(self.chi_square, other.chi_square),
            tuple(part for one in (self, other) for part in one.parts or ((one.u, one.v),)),
            max(self.reach + share * apart, other.reach + (1.0 - share) * apart),
        )


def surprising_places(surprise: Surprise, false_alarms: float = FALSE_ALARM) -> tuple[Blob, ...]:
    """Return what stands out of a chi-square picture, the most surprising place first.

    Of n places, each a chi-square of three degrees of freedom, one or more exceeds the threshold T
    with at most the probability n P(chi^2_3 > T), which is set to `false_alarms`.

    Args:
        false_alarms: Places of a picture of what was expected that may surprise.

    Returns:
        Connected places above the threshold.
    """
    places = surprise.chi_square
    threshold = threshold_of(int(np.isfinite(places).sum()), false_alarms)
    blobs = [blob_of(i, places, threshold) for i in connected(np.nan_to_num(places) > threshold)]
    return tuple(sorted(blobs, key=lambda blob: -blob.chi_square))


def connected(above: NDArray) -> list[NDArray]:
    """Return the connected parts of what is marked, each as a picture of its own.

    Args:
        above: What is marked. Shape (h, w).
    """
    count, labels = cv2.connectedComponents(above.astype(np.uint8), connectivity=8)
    return [labels == label for label in range(1, count)]


def threshold_of(places: int, false_alarms: float = FALSE_ALARM, freedom: int = 3) -> float:
    """Return T with n P(chi^2_k > T) = `false_alarms`, by bisection.

    Args:
        places: n.
        false_alarms: How many of them may be above it by chance.
        freedom: k, three for each picture or pixel that errs by itself.
    """
    low, high = 0.0, _HIGHEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if max(places, 1) * chi_square_tail(middle, freedom) > false_alarms:
            low = middle
        else:
            high = middle
    return high


def blob_of(inside: NDArray, places: NDArray, threshold: NDArray | float) -> Blob:
    """Return one connected part as a blob.

    Args:
        inside: Its pixels. Shape (h, w).
        places: How surprising each is, by `surprise`. Shape (h, w).
        threshold: What one of them must exceed to surprise. Shape () or (h, w).
    """
    rows, columns = np.nonzero(inside)
    each = np.nan_to_num(places[rows, columns])
    most = np.broadcast_to(threshold, places.shape)[rows, columns]
    weight = np.minimum(each / most, _ENOUGH) + _LEAST
    u, v = (float(np.average(one, weights=weight)) for one in (columns, rows))
    reach = float(np.hypot(columns - u, rows - v).max())
    return Blob(u, v, len(rows), float(each.max()), reach=reach)
