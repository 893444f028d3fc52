"""Whether tags lie on a board as it was stated: which size of tags, which number of columns.

Where the centres of tags are on a board its squares alone say, not the tags' size. The homography
of the centres therefore measures the tags, and misses where columns are others than stated.
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
"""Tags of which a homography of the centres says something: four fit any."""
_MISS = 0.15
"""Median miss of a tag's centre, in tags, above which a layout is none. A lens bends by less."""
_OFF = 0.06
"""Share by which tags are of another size than stated. The lens makes up to 4 % of a part of a
board."""


def wrong_tag(corners: NDArray, tag: float, tags: TagsSeen) -> str | None:
    """Say that the tags are of another size than stated; None where they are not.

    Args:
        corners: Of all tags on the board as stated [m]. Shape (T, 4, 2).
        tag: Their side as stated [m].
        tags: On the board, with exact corners.
    """
    H = _centres_homography(corners, tags)
    if H is None:
        return None
    flat = apply_homography(np.linalg.inv(H), tags.corners.reshape(-1, 2)).reshape(-1, 4, 2)
    side = float(np.median(np.linalg.norm(flat - np.roll(flat, 1, axis=1), axis=2)))
    if abs(side / tag - 1.0) < _OFF:
        return None
    return (
        f"the tags are {1e3 * side:.1f} mm wide where --tag-mm says {1e3 * tag:.1f}: one of "
        "--square-mm and --tag-mm is wrong"
    )


def layout_of(boards: Sequence[T], corners: Callable[[T], NDArray], tags: TagsSeen) -> T | None:
    """Return the first of some boards on which tags lie as they were seen.

    Args:
        boards: To be tried.
        corners: Returns the corners of all tags on one [m]. Shape (T, 4, 2).
        tags: Seen.
    """
    for board in boards:
        placed = corners(board)
        if max(tags.ids) < len(placed) and _centres_homography(placed, tags) is not None:
            return board
    return None


def _centres_homography(corners: NDArray, tags: TagsSeen) -> NDArray | None:
    """Return the homography of the tags' centres from board to image; None where there is none."""
    if len(tags.ids) < _FEWEST:
        return None
    there, here = corners[list(tags.ids)].mean(axis=1), tags.corners.mean(axis=1)
    H, _ = cv2.findHomography(there, here, cv2.LMEDS)
    if H is None or abs(np.linalg.det(H)) < 1e-12:
        return None
    sides = np.linalg.norm(tags.corners - np.roll(tags.corners, 1, axis=1), axis=2).mean(axis=1)
    missed = np.linalg.norm(apply_homography(H, there) - here, axis=1) / sides
    return H if np.median(missed) < _MISS and np.quantile(missed, 0.8) < 2.0 * _MISS else None
