"""Places of a picture that are more surprising than all places of a hundred pictures should be."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.vision.surprise.surprise import Surprise

_WINDOW = 3
"""Sides of the places that are looked at [px]."""
FALSE_ALARM = 0.01
"""How often one picture of what was expected has a surprising place."""
_HALVINGS = 80
_HIGHEST = 200.0


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
    """Mean of z^2 over its most surprising place."""


def surprising_places(surprise: Surprise) -> tuple[Blob, ...]:
    """Return what stands out of a chi-square picture, the most surprising place first.

    A place is the mean of z^2 over 3 x 3 pixels that are all judged. Colours and places are wrong
    alike in neighbouring pixels, so that the mean counts as one chi-square of three degrees of
    freedom, not as nine. Of n places one or more exceeds the threshold T with at most the
    probability n P(chi^2_3 > T), which is set to `FALSE_ALARM`.

    Args:
        surprise: Of a picture.

    Returns:
        Connected places above the threshold.
    """
    judged = np.isfinite(surprise.chi_square)
    filled = np.where(judged, surprise.chi_square, 0.0)
    whole = cv2.erode(judged.astype(np.uint8), np.ones((_WINDOW, _WINDOW), np.uint8)) > 0
    places = np.where(whole, cv2.blur(filled, (_WINDOW, _WINDOW)), 0.0)
    above = places > threshold_of(int(whole.sum()))
    count, labels = cv2.connectedComponents(above.astype(np.uint8), connectivity=8)
    blobs = [_blob(labels == label, places) for label in range(1, count)]
    return tuple(sorted(blobs, key=lambda blob: -blob.chi_square))


def threshold_of(places: int) -> float:
    """Return T with n P(chi^2_3 > T) = `FALSE_ALARM`, by bisection.

    Args:
        places: n.
    """
    low, high = 0.0, _HIGHEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if max(places, 1) * chi_square_tail(middle, 3) > FALSE_ALARM:
            low = middle
        else:
            high = middle
    return high


def _blob(inside: NDArray, places: NDArray) -> Blob:
    rows, columns = np.nonzero(inside)
    weight = places[rows, columns]
    return Blob(
        float(np.average(columns, weights=weight)),
        float(np.average(rows, weights=weight)),
        len(rows),
        float(weight.max()),
    )
