"""Corners of boards that carry tags: each is told by its tags, so that a part of a board will do.

The rough corner comes from the tags, the exact one is the place about which the picture around it,
which holds nothing but the corner, is symmetric. A hand, a shadow or the picture's edge may cut in,
so a corner stays only where what is around it looks the same after half a turn, as a crossing of
two edges does, and where all others would have it.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.crossings import Crossings
from nico_selfmodel.vision.boards.stray_corners import stray_points

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


def located(gray: NDArray, rough: NDArray, reach: NDArray, window: int) -> NDArray:
    """Return corners to a fraction of a pixel.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        rough: Where corners are to a pixel or two; nan where they are not seen. Shape (P, 2).
        reach: How far from each corner there is nothing else [px]. Shape (P,).
        window: Radius of the largest window [px].

    Returns:
        Shape (P, 2), nan where a corner is not plain to see.
    """
    found = np.full_like(rough, np.nan)
    radius = np.minimum(np.nan_to_num(reach), window)
    room = np.ceil(radius)[:, None] + 1.0
    with np.errstate(invalid="ignore"):  # of corners not seen
        inside = np.all((rough > room) & (rough < gray.shape[::-1] - room - 1.0), axis=1)
    rows = np.flatnonzero(inside & (radius >= _NARROWEST))
    crossings = Crossings.near(gray, rough[rows], radius[rows])
    moved = np.linalg.norm(crossings.places - rough[rows], axis=1)
    plain = (crossings.sameness > _SYMMETRY) & (crossings.contrast > _CONTRAST)
    plain &= (crossings.along > _CROSSING) & (moved < radius[rows])
    found[rows[plain]] = crossings.places[plain]
    return found


def without_strays(
    points: NDArray, corners: NDArray, image_size: tuple[int, int]
) -> tuple[NDArray, int]:
    """Set aside corners that lie far from where the others have them.

    Args:
        points: The board's points. Shape (P, 3).
        corners: Where they were found, nan where not seen. Shape (P, 2).
        image_size: Width and height [px].

    Returns:
        The corners, nan for those set aside too, shape (P, 2), and how many those are.
    """
    kept = corners.copy()
    count = 0
    while True:
        seen = np.flatnonzero(np.isfinite(kept[:, 0]))
        if len(seen) < FEWEST:
            return kept, count
        try:
            stray = stray_points(points[seen, :2], kept[seen], image_size)
        except ValueError:  # on one line; they are seen, though they place no board
            return kept, count
        if not stray.any():
            return kept, count
        kept[seen[stray]] = np.nan
        count += int(stray.sum())
