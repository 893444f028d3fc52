"""Corners of boards that carry tags: each is told by its tags, so that a part of a board will do.

The rough corner comes from the tags, the exact one from `cornerSubPix` in a window that holds
nothing but the corner. A hand, a shadow or the picture's edge may cut into that window, so a corner
stays only where its window looks the same after half a turn, as a crossing of two edges does, and
where all others would have it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.stray_corners import stray_points

FEWEST = 6
"""Corners below which a board counts as not seen: eight numbers of a homography, and some to
tell."""
_NARROWEST = 2
"""Half side of the smallest window [px]."""
_END = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 0.005)
_SYMMETRY = 0.9
"""Least correlation of a window with itself after half a turn."""
_CONTRAST = 8.0
"""Least standard deviation of a window [grey levels]."""


def located(gray: NDArray, rough: NDArray, reach: NDArray, window: int) -> NDArray:
    """Return corners to a fraction of a pixel.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        rough: Where corners are to a pixel or two; nan where they are not seen. Shape (P, 2).
        reach: How far from each corner there is nothing else [px]. Shape (P,).
        window: Half side of the largest window [px].

    Returns:
        Shape (P, 2), nan where a corner is not plain to see.
    """
    found = np.full_like(rough, np.nan)
    half = np.clip(np.floor(np.nan_to_num(reach)), 0, window).astype(int)
    size = np.array(gray.shape[::-1])
    for side in np.unique(half[np.isfinite(rough[:, 0])]):
        if side < _NARROWEST:
            continue
        rows = np.flatnonzero((half == side) & np.isfinite(rough[:, 0]))
        inside = np.all((rough[rows] > side + 1) & (rough[rows] < size - side - 2), axis=1)
        rows = rows[inside]
        if not len(rows):
            continue
        start = rough[rows].astype(np.float32).reshape(-1, 1, 2)
        end = cv2.cornerSubPix(gray, start.copy(), (int(side),) * 2, (-1, -1), _END)
        end = end.reshape(-1, 2).astype(float)
        moved = np.linalg.norm(end - rough[rows], axis=1)
        plain = (moved > 0.0) & (moved < side) & _is_crossing(gray, end, int(side))
        found[rows[plain]] = end[plain]
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


def _is_crossing(gray: NDArray, corners: NDArray, side: int) -> NDArray:
    """Tell which windows look the same after half a turn about the corner. Shape (n,)."""
    steps = np.arange(-side, side + 1, dtype=np.float32)
    across, down = np.meshgrid(steps, steps)
    u = corners[:, 0, None, None] + across
    v = corners[:, 1, None, None] + down
    rows = (len(corners), -1)
    across, down = (m.astype(np.float32).reshape(rows) for m in (u, v))
    values = cv2.remap(gray, across, down, cv2.INTER_LINEAR).astype(float)
    values -= values.mean(axis=1, keepdims=True)
    power = np.sum(values**2, axis=1)
    same = np.sum(values * values[:, ::-1], axis=1)
    strong = power > values.shape[1] * _CONTRAST**2
    return np.asarray(strong & (same > _SYMMETRY * power))
