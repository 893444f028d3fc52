"""Where a picture may show a part of a chessboard: corners that follow each other like its own.

At a crossing of two edges brightness is a saddle: Ixx Iyy - Ixy^2 < 0 under a Gaussian filter. Its
axes turn by a quarter from each crossing to the next along an edge, as dark and light change sides:
the direction (Ixx - Iyy, 2 Ixy) of the doubled angle turns round.
"""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.exact_corners import located

_BLUR = 1.5
"""Standard deviation of the filter [px]."""
_STRONG, _MOST = 0.02, 600
"""Share of the strongest saddle from which others are looked at, and how many at most."""
_RADIUS = 5.0
"""Of the windows in which they are plain [px]."""
_NEIGHBOURS = 10
"""Saddles near one among which the next ones along its edges are."""
_TURNED = -0.6
"""Largest cosine of the doubled angle between neighbours."""
_OPPOSITE = 0.3
"""Share of a step by which two neighbours may differ from each other's opposite."""
_ASIDE = 0.35
"""Least sine of the angle between the two ways to neighbours."""


def crosses(gray: NDArray) -> Iterator[NDArray]:
    """Return grids of 3 x 3 corners of which the cross at least is seen, the plainest first.

    Args:
        gray: The image, 8 bits. Shape (h, w).

    Yields:
        Corners, nan where not seen [px]. Shape (3, 3, 2).
    """
    places, axes = _saddles(gray)
    if len(places) < _NEIGHBOURS:
        return
    used = np.zeros(len(places), dtype=bool)
    for k in range(len(places)):
        if used[k]:
            continue
        grid = _cross(places, axes, k)
        if grid is not None:
            on = np.linalg.norm(places[:, None] - np.nan_to_num(grid.reshape(1, -1, 2)), axis=2)
            used |= on.min(axis=1) < 1.0
            yield grid


def _saddles(gray: NDArray) -> tuple[NDArray, NDArray]:
    """Return plain crossings, the strongest first, and their doubled axes. Shapes (n, 2)."""
    smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), _BLUR)
    xx, yy, xy = (cv2.Sobel(smooth, -1, *order, ksize=3) for order in ((2, 0), (0, 2), (1, 1)))
    strength = xy * xy - xx * yy
    peak = (strength == cv2.dilate(strength, np.ones((5, 5)))) & (
        strength > _STRONG * float(strength.max(initial=0.0))
    )
    v, u = np.nonzero(peak)
    order = np.argsort(-strength[v, u], kind="stable")[:_MOST]
    v, u = v[order], u[order]
    found = located(gray, np.stack([u, v], axis=1).astype(float), np.full(len(u), _RADIUS))
    axes = np.stack([xx[v, u] - yy[v, u], 2.0 * xy[v, u]], axis=1)
    plain = np.isfinite(found[:, 0])
    return found[plain], axes[plain] / np.linalg.norm(axes[plain], axis=1, keepdims=True)


def _cross(places: NDArray, axes: NDArray, k: int) -> NDArray | None:
    """Return the grid about one saddle; None where it has no neighbours on all four sides."""
    off = places - places[k]
    away = np.linalg.norm(off, axis=1)
    near = np.argsort(away)[1 : _NEIGHBOURS + 1]
    near = near[axes[near] @ axes[k] < _TURNED]
    steps = off[near]
    miss = np.linalg.norm(steps[:, None] + steps, axis=2)
    pairs = np.argwhere(np.triu(miss < _OPPOSITE * away[near]))
    ways = [0.5 * (steps[i] - steps[j]) for i, j in pairs]
    for one in range(len(ways)):
        for two in range(one + 1, len(ways)):
            x, y = ways[one], ways[two]
            turn = float(x[0] * y[1] - x[1] * y[0])
            if abs(turn) > _ASIDE * np.linalg.norm(x) * np.linalg.norm(y):
                (a, b), (c, d) = near[pairs[one]], near[pairs[two]]
                if turn < 0.0:
                    c, d = d, c
                return _grid(places, k, (a, b), (c, d))
    return None


def _grid(places: NDArray, k: int, right: tuple[int, int], down: tuple[int, int]) -> NDArray:
    """Return a cross with what lies in its four corners."""
    grid = np.full((3, 3, 2), np.nan)
    grid[1, 1], grid[1, 2], grid[1, 0] = places[[k, *right]]
    grid[2, 1], grid[0, 1] = places[list(down)]
    for row in (0, 2):
        for column in (0, 2):
            step = grid[row, 1] + grid[1, column] - 2.0 * grid[1, 1]
            away = np.linalg.norm(places - grid[1, 1] - step, axis=1)
            nearest = int(np.argmin(away))
            if away[nearest] < _OPPOSITE * 0.5 * np.linalg.norm(step):
                grid[row, column] = places[nearest]
    return grid
