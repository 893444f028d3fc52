"""Whether tags lie on a board as it was stated: which size of tags, which number of columns.

The homography of the tags' centres misses where columns are others than stated. One column more or
less is a shear, which it follows; then the tags at the ends of rows are out of place. Of two
neighbouring tags of width t, p apart, four corners A, B, C, D lie on one line, and AC BD / (BC AD),
which no perspective changes and no lens by much over so short a way, is p^2 / (p^2 - t^2).
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.homography import apply_homography
from nico_selfmodel.vision.markers.tags_seen import TagsSeen

T = TypeVar("T")

_FEWEST = 6
"""Tags of which a homography of the centres says something (four fit any), and lines of corners."""
_MISS = 0.15
"""Median miss of a tag's centre, in tags, above which a layout is none. A lens bends by less."""
_BEYOND = 0.5
"""The same above which one tag is out of place: half a tag from where none is."""
_OFF = 0.06
"""Share by which tags are of another size than stated."""


def wrong_tag(corners: NDArray, tag: float, seen: NDArray) -> str | None:
    """Say that the tags are of another size than stated; None where they are not.

    Args:
        corners: Of all tags on the board as stated [m]. Shape (T, 4, 2).
        tag: Their side as stated [m].
        seen: Exact corners, nan where not seen [px]. Shape (T, 4, 2).
    """
    lines = np.concatenate([_lines(corners, seen, axis) for axis in (0, 1)])
    if len(lines) < _FEWEST:
        return None
    a, b, c, d = np.moveaxis(lines, 1, 0)
    ac, bd, bc, ad = (np.linalg.norm(p - q, axis=1) for p, q in ((a, c), (b, d), (b, c), (a, d)))
    share = float(np.median(np.sqrt(np.maximum(1.0 - bc * ad / (ac * bd), 0.0))))
    stated = tag / _pitch(corners)
    if abs(share / stated - 1.0) < _OFF:
        return None
    return (
        f"the tags are {1e3 * tag * share / stated:.1f} mm wide where --tag-mm says "
        f"{1e3 * tag:.1f}: one of --square-mm and --tag-mm is wrong"
    )


def _lines(corners: NDArray, seen: NDArray, axis: int) -> NDArray:
    """Return four corners on one line, of two neighbours along an axis, in a row. (n, 4, 2)."""
    apart = corners[None, :, 0] - corners[:, None, 0]
    step = np.zeros(2)
    step[axis] = _pitch(corners)
    one, other = np.nonzero(np.linalg.norm(apart - step, axis=2) < 1e-3 * step[axis])
    # Clockwise from the upper left: the two edges along x, or along y.
    edges = ((0, 1), (3, 2)) if axis == 0 else ((0, 3), (1, 2))
    found = np.concatenate([np.hstack([seen[one][:, e], seen[other][:, e]]) for e in edges])
    return found[np.isfinite(found).all(axis=(1, 2))]


def _pitch(corners: NDArray) -> float:
    """Return the distance from a tag to the next."""
    return float(np.ptp(corners[:2, 0], axis=0).max())


def layout_of(boards: Sequence[T], corners: Callable[[T], NDArray], tags: TagsSeen) -> T | None:
    """Return that of some boards on which most tags lie as they were seen.

    Args:
        corners: Returns the corners of all tags on one [m]. Shape (T, 4, 2).

    Returns:
        None where they lie so on none, or on several equally.
    """
    in_place = [_in_place(corners(board), tags) for board in boards]
    most = max(in_place, default=0)
    return boards[in_place.index(most)] if most and in_place.count(most) == 1 else None


def _in_place(corners: NDArray, tags: TagsSeen) -> int:
    """Return how many tags lie as on a board; 0 where there is no homography of most of them."""
    H = _centres_homography(corners, tags) if max(tags.ids) < len(corners) else None
    return 0 if H is None else int(np.count_nonzero(_missed(H, corners, tags) < _BEYOND))


def lie_on(corners: NDArray, tags: TagsSeen, some: Sequence[int]) -> bool:
    """Tell whether most of some tags lie where all others say that a board has them.

    Args:
        corners: Of all tags on the board [m]. Shape (T, 4, 2).
        some: Ids of those that are asked about.
    """
    H = _centres_homography(corners, tags.among(set(tags.ids) - set(some)))
    return H is not None and bool(np.median(_missed(H, corners, tags.among(some))) < _BEYOND)


def _centres_homography(corners: NDArray, tags: TagsSeen) -> NDArray | None:
    """Return the homography of the tags' centres from board to image; None where there is none."""
    if len(tags.ids) < _FEWEST:
        return None
    there, here = corners[list(tags.ids)].mean(axis=1), tags.corners.mean(axis=1)
    H, _ = cv2.findHomography(there, here, cv2.LMEDS)
    if H is None or abs(np.linalg.det(H)) < 1e-12:
        return None
    missed = _missed(H, corners, tags)
    return H if np.median(missed) < _MISS and np.quantile(missed, 0.8) < 2.0 * _MISS else None


def _missed(H: NDArray, corners: NDArray, tags: TagsSeen) -> NDArray:
    """Return how far centres lie from where a homography has them, in sides of tags. Shape (n,)."""
    there, here = corners[list(tags.ids)].mean(axis=1), tags.corners.mean(axis=1)
    sides = np.linalg.norm(tags.corners - np.roll(tags.corners, 1, axis=1), axis=2).mean(axis=1)
    return np.asarray(np.linalg.norm(apply_homography(H, there) - here, axis=1) / sides)
