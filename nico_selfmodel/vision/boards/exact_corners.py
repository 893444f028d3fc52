"""Corners of boards to a fraction of a pixel, seen whole or in part.

A rough corner comes from tags or from a detector of chessboards; the exact one is the place about
which the picture around it, which holds nothing but the corner, is symmetric. A hand, a shadow or
the picture's edge may cut in, so a corner stays only where what is around it looks the same after
half a turn, as a crossing of two edges does, and where all others would have it.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.crossings import Crossings, straightened
from nico_selfmodel.vision.boards.stray_corners import BoardBehindLens, stray_points

WINDOW = 11
"""Default radius of the largest window in which a corner is looked at [px]."""
FEWEST = 6
"""Corners below which a board counts as not seen: eight numbers of a homography, and some to
tell."""
_NARROWEST = 2.0
"""Radius of the smallest window [px]."""
_SYMMETRY = 0.95
"""Least correlation of what is around a corner with itself after half a turn."""
_CROSSING = 0.02
"""Least share of what the worse direction is told by: a stripe tells one alone."""
_CONTRAST = 5.0
"""Least standard deviation of what is around a corner [grey levels]."""
_EDGE = 1.0
"""Room between a window and the image's edge [px]."""
_CLEAR = 0.8
"""Share of the way to the next line in which nothing but a corner counts: boards end there."""
_STRAIGHT = 0.01
"""By how much curved edges may move a corner [px]; where they would by more the window is made
smaller: a tenth of it is not known."""


def exact_corners(
    points: NDArray,
    gray: NDArray,
    rough: NDArray,
    clear: Callable[[NDArray], NDArray],
    window: int = WINDOW,
) -> NDArray:
    """Return corners that are plain to see, those too that the rough ones lack among others.

    Args:
        points: The board's points, in any unit. Shape (P, 2).
        gray: The image, 8 bits. Shape (h, w).
        rough: Where they are to a pixel or two; nan where that is not known. Shape (P, 2).
        clear: Returns how far from corners there is nothing else [px], from how pixels move
            along x and y of the board, as columns [px per unit]. Shape (n, 2, 2) -> (n,).
        window: Radius of the largest window [px].

    Returns:
        [px]. Shape (P, 2), nan where a corner is not plain to see.

    Raises:
        ValueError: If the rough corners lie on one line.
    """
    found = np.full_like(rough, np.nan)
    if seen_count(rough) < FEWEST:
        return found
    size = gray.shape[::-1]
    board = BoardBehindLens.of_seen(points, rough, size)
    radius = np.minimum(clear(board.steps_at(points)), window)
    found = without_strays(points, located(gray, rough, radius), size)
    lost = _among(points, found)
    if len(lost):
        board = BoardBehindLens.of_seen(points, found, size)
        found[lost] = located(gray, board.pixels_of(points[lost]), radius[lost])
        found = without_strays(points, found, size)
    return straight(points, gray, found, radius)


def straight(points: NDArray, gray: NDArray, found: NDArray, radius: NDArray) -> NDArray:
    """Take off what curved edges move places of symmetry by, in smaller windows where it is much.

    Args:
        points: The board's points, in any unit. Shape (P, 2).
        gray: The image, 8 bits. Shape (h, w).
        found: Places of symmetry, nan where not seen [px]. Shape (P, 2).
        radius: Of the windows in which they were found [px]. Shape (P,).

    Returns:
        [px]. Shape (P, 2), nan where a corner is not plain to see.
    """
    radius = np.fmin(radius, _to_edge(found, gray) - _EDGE)  # as `located` has looked
    straightened_once = straightened(points, found, radius)
    moved = np.nan_to_num(np.linalg.norm(found - straightened_once, axis=1))
    again = np.flatnonzero(moved > _STRAIGHT)
    if not len(again):
        return straightened_once
    found = found.copy()
    # By the square of the window's radius.
    radius[again] = np.maximum(radius[again] * np.sqrt(_STRAIGHT / moved[again]), _NARROWEST)
    found[again] = located(gray, found[again], radius[again])
    return straightened(points, found, radius)


def _among(points: NDArray, corners: NDArray) -> NDArray:
    """Return which corners are not seen, but others all around them; indices.

    Beyond these a lens may be another one than it is between them.
    """
    lost = np.flatnonzero(np.isnan(corners[:, 0]))
    if not len(lost) or seen_count(corners) < FEWEST:
        return lost[:0]
    hull = cv2.convexHull(points[np.isfinite(corners[:, 0])].astype(np.float32))
    inside = [cv2.pointPolygonTest(hull, (float(x), float(y)), False) >= 0 for x, y in points[lost]]
    return lost[inside]


def located(gray: NDArray, rough: NDArray, radius: NDArray) -> NDArray:
    """Return places of symmetry that are plain to see.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        rough: Where corners are to a pixel or two; nan where they are not seen. Shape (n, 2).
        radius: Of the window of each [px]. Shape (n,).

    Returns:
        [px]. Shape (n, 2), nan where a corner is not plain to see.
    """
    found = np.full_like(rough, np.nan)
    inside = np.minimum(radius, _to_edge(rough, gray) - _EDGE)
    rows = np.flatnonzero(inside >= _NARROWEST)  # not of corners not seen
    crossings = Crossings.near(gray, rough[rows], inside[rows])
    moved = np.linalg.norm(crossings.places - rough[rows], axis=1)
    plain = (crossings.sameness > _SYMMETRY) & (crossings.contrast > _CONTRAST)
    plain &= (crossings.along > _CROSSING) & (moved < inside[rows])
    plain &= ~_taken(crossings.places, np.where(plain, moved, np.inf))
    found[rows[plain]] = crossings.places[plain]
    return found


def _taken(places: NDArray, moved: NDArray) -> NDArray:
    """Tell of which places another search, that began nearer, has found the same. (n,)."""
    x, y = places.T
    apart = (x[:, None] - x) ** 2 + (y[:, None] - y) ** 2
    nearer = (moved[:, None] > moved) & np.isfinite(moved)
    return np.asarray((nearer & (apart < _NARROWEST**2)).any(axis=1))


def _to_edge(pixels: NDArray, gray: NDArray) -> NDArray:
    """Return how far pixels are from the image's edge; nan stays nan. Shape (n, 2) -> (n,)."""
    far = np.array(gray.shape[::-1]) - 1.0 - pixels
    return np.asarray(np.minimum(pixels, far).min(axis=1))


def without_strays(points: NDArray, corners: NDArray, image_size: tuple[int, int]) -> NDArray:
    """Set aside corners that lie far from where the others have them.

    Args:
        points: The board's points, in any unit. Shape (P, 2).
        corners: Where they were found, nan where not seen. Shape (P, 2).
        image_size: Width and height [px].

    Returns:
        The corners, nan for those set aside too. Shape (P, 2).
    """
    kept = corners.copy()
    while True:
        seen = np.flatnonzero(np.isfinite(kept[:, 0]))
        if len(seen) < FEWEST:
            return kept
        try:
            stray = stray_points(points[seen], kept[seen], image_size)
        except ValueError:  # on one line; they are seen, though they place no board
            return kept
        if not stray.any():
            return kept
        kept[seen[stray]] = np.nan


def seen_count(corners: NDArray) -> int:
    """Return how many corners are seen. Shape (P, 2)."""
    return int(np.count_nonzero(np.isfinite(corners[:, 0])))


def clear_of_lines(maps: NDArray) -> NDArray:
    """Return how far from a chessboard's corners there is nothing else [px].

    Args:
        maps: Steps to the next corner along a row and a column [px]. Shape (n, 2, 2).

    Returns:
        Shape (n,).
    """
    return _CLEAR * between_lines(maps)


def between_lines(maps: NDArray) -> NDArray:
    """Return how far lines of a lattice are from the next, the nearer of both kinds [px].

    Args:
        maps: Steps of the lattice, as columns [px]. Shape (P, 2, 2).

    Returns:
        Shape (P,).
    """
    longest = np.linalg.norm(maps, axis=1).max(axis=1)
    return np.asarray(np.abs(np.linalg.det(maps)) / np.maximum(longest, 1e-12))
