"""What stands out of one picture: of the own body, of what is beside it, and by other pictures."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.surprise.blobs import FALSE_ALARM, Blob, blob_of, connected, threshold_of
from nico_selfmodel.vision.surprise.surprise import Surprise

WEAK = 1.0
"""Places of a picture that may surprise where both cameras and both looks must agree."""
_NEAR, _GAP = 6.0, 2.0
"""Surprising places as near to each other are one spot, or with so little between them [px]."""
_PLACES_ABOUT = 113
"""Places within 6 px of one."""
_BESIDE = 2
"""Places about one that must be judged for it to count as looked at [px]."""


def seen_places(
    own: Surprise,
    rest: Surprise | None = None,
    shared: NDArray | None = None,
    where: Sequence[tuple[float, float]] = (),
    body: NDArray | None = None,
) -> list[tuple[Blob, bool]]:
    """Return surprising places of one picture, and which of them are so beyond chance.

    What is told by the expected body and what by an earlier picture are one picture: a spot that
    lies half on the body and half beside it is one spot.

    Args:
        own: What differs from the expected body.
        rest: What has changed where that does not judge; None if it is not known.
        shared: What surprises by this and other pictures together. Shape (h, w).
        where: Columns and rows at which another camera's spot must be seen, if it is what that one
            takes it for. The places about them are few, so that less is weakly surprising there.
        body: What shows the body, its outline too; what `own` judges if omitted. It is a tenth of
            a picture, and has false alarms of its own, lest less be seen on it for all that is
            beside it. Shape (h, w).

    Returns:
        Places, near ones as one, the largest first; and whether one place of each surprises as
        not one picture in a hundred does, or as all pictures together do not.
    """
    places = own.chi_square if rest is None else own.places_beside(rest)
    together = np.zeros(places.shape, dtype=bool) if shared is None else shared
    shown = np.isfinite(own.chi_square) if body is None else body
    certain, least = (_thresholds(places, shown, rate) for rate in (FALSE_ALARM, WEAK))
    filled = np.nan_to_num(places)
    sure = (filled > certain) | together
    weak = (filled > least) | together | _expected(filled, where)
    above = _with_what_is_near(weak, filled)
    found = [(blob_of(i, places, certain), bool(sure[i].any())) for i in connected(above)]
    return _merged(found)


def _thresholds(places: NDArray, body: NDArray, false_alarms: float) -> NDArray:
    """Return what a place must exceed, by how many there are of the body or beside it. (h, w)."""
    judged = np.isfinite(places)
    own, rest = (threshold_of(int((judged & shown).sum()), false_alarms) for shown in (body, ~body))
    return np.where(body, own, rest)


def _expected(places: NDArray, where: Sequence[tuple[float, float]]) -> NDArray:
    """Return what is weakly surprising among the places where another camera's spots must be."""
    v, u = np.ogrid[: places.shape[0], : places.shape[1]]
    about = np.zeros(places.shape, dtype=bool)
    for column, row in where:
        about |= np.hypot(u - column, v - row) < _NEAR
    return about & (places > threshold_of(int(about.sum()), WEAK))


def _with_what_is_near(above: NDArray, places: NDArray) -> NDArray:
    """Return what surprises, and what is near to it and surprises among the places about one.

    They are few, so that T of n P(chi^2_3 > T) = 0.01 is less than that of the whole picture: paint
    that crosses a colour that it is like shows in parts, and a faint one is a part too.

    Args:
        above: What surprises. Shape (h, w).
        places: How much each place does. Shape (h, w).
    """
    reach = int(_NEAR)
    v, u = np.indices((2 * reach + 1,) * 2) - reach
    about = (np.hypot(u, v) < _NEAR).astype(np.uint8)
    near = cv2.dilate(above.astype(np.uint8), about) > 0
    return above | (near & (places > threshold_of(int(about.sum()), FALSE_ALARM)))


def _merged(found: list[tuple[Blob, bool]]) -> list[tuple[Blob, bool]]:
    """Return near places as one."""
    merged: list[tuple[Blob, bool]] = []
    for blob, sure in sorted(found, key=lambda one: -one[0].area * one[0].chi_square):
        for k, (other, known) in enumerate(merged):
            # What is large, as seen from near by, lies in parts farther apart.
            if blob.apart(other) < max(_NEAR, blob.reach + other.reach + _GAP):
                merged[k] = other.with_part(blob), known or sure
                break
        else:
            merged.append((blob, sure))
    return merged


def beyond_chance(first: Blob, second: Blob, places: int, alike: float = 0.0) -> bool:
    """Return whether places of two pictures that may show one spot surprise together.

    Of n places of one picture each has m = 113 in the other that may be of the same spot:

        n m P(chi^2_6 > (z_1^2 + z_2^2) / (1 + a)) < 0.01

    with a the share of their covariances C that is alike in both: of two equal differences e it is
    2 e' (C + a C)^-1 e, and less of others.

    Args:
        first: Of one camera's picture.
        second: Of the other's, of the same look.
        places: n.
        alike: a.
    """
    least = threshold_of(places * _PLACES_ABOUT, FALSE_ALARM, 6)
    return first.chi_square + second.chi_square > (1.0 + alike) * least


def reaches(blob: Blob, shown: NDArray) -> bool:
    """Return whether a spot comes to within 6 px of what is marked.

    Args:
        blob: The spot.
        shown: What is marked. Shape (h, w).
    """
    rows, columns = np.nonzero(shown)
    apart = np.hypot(columns - blob.u, rows - blob.v)
    return bool(np.any(apart < _NEAR + blob.reach))


def spots_at(surprise: Surprise, u: float, v: float) -> list[Blob]:
    """Return what surprises beyond chance within 6 px of a place.

    Args:
        u: Column of the place [px].
        v: Row of the place [px].
    """
    return [
        blob
        for blob, sure in seen_places(surprise)
        if sure and np.hypot(blob.u - u, blob.v - v) < _NEAR
    ]


def nothing_at(surprise: Surprise, u: float, v: float) -> bool:
    """Return whether a place is judged, and nothing within 6 px is even weakly surprising.

    Args:
        u: Column of the place [px].
        v: Row of the place [px].
    """
    return all_judged(surprise, u, v) and not _expected(surprise.chi_square, [(u, v)]).any()


def all_judged(surprise: Surprise, u: float, v: float, beside: int = _BESIDE) -> bool:
    """Return whether all places about one are judged.

    Args:
        u: Column of the place [px].
        v: Row of the place [px].
        beside: How far about it [px].
    """
    rows, columns = (slice(max(round(k) - beside, 0), round(k) + beside + 1) for k in (v, u))
    window = np.isfinite(surprise.chi_square[rows, columns])
    return bool(window.size and window.all())
