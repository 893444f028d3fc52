"""The dark and light squares between and around found corners: is it the board, and all of it?

A grid of corners has shape (rows, columns, 2). A detector that is asked for a board of another size
than the one in the image may answer with a part of it, or with corners picked here and there.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.geometry.homography import apply_homography, homography
from nico_selfmodel.vision.boards.board_detection import grid_points

_ALTERNATING = 0.95  # of the pairs of neighbouring squares
_UNEVEN = 0.5  # of a step along a row, by which the next one may differ: perspective, distortion
_CONTINUES = 0.5  # of the contrast between the inner squares
_DARK_IN_LIGHT = 0.15  # of a light square that is as dark as the dark ones ...
_SPOILT = 0.3  # ... in so many of them: more than glare, dirt and fingers spoil
_BEYOND = 1.25  # squares behind the last corners: printed boards often end in half squares
_SHARES = np.stack([np.linspace(0.7, 0.3, 5), np.linspace(0.3, 0.7, 5)])
_IN_SQUARE = read_only(np.einsum("dt,as->stda", _SHARES, _SHARES).reshape(-1, 4))
"""From a square's corners to 25 points in its middle. Shape (25, 4)."""


@dataclass(frozen=True, eq=False)
class FoundSquares:
    """Squares between and around found corners, as an image shows them."""

    grid: NDArray
    """Corners [px]. Shape (rows, columns, 2)."""
    gray: NDArray
    """The image."""

    @cached_property
    def smooth(self) -> NDArray:
        """The image, smoothed."""
        return smoothed(self.gray)

    @cached_property
    def homography(self) -> NDArray:
        """From places in units of squares to pixels. Shape (3, 3)."""
        rows, columns = self.grid.shape[:2]
        board = grid_points(columns, rows, 1.0)[:, :2]
        return homography(board, self.grid.reshape(-1, 2))

    @property
    def contrast(self) -> float:
        """By how much light squares between corners are lighter than dark ones.

        Negative if the first inner square is a light one; NaN where fewer than two squares of a
        kind are in the image.
        """
        return float(self._contrasts[0])

    @property
    def is_regular(self) -> bool:
        """Whether corners follow each other evenly, with squares between them that alternate.

        They can be the corners of a chessboard then.
        """
        for along in (self.grid, self.grid.swapaxes(0, 1)):
            mean_step = 0.5 * np.linalg.norm(along[2:] - along[:-2], axis=2)
            change = np.linalg.norm(along[2:] - 2.0 * along[1:-1] + along[:-2], axis=2)
            if np.any(change > _UNEVEN * mean_step):
                return False
        squares = self._shown[[0, 4, 20, 24]]
        sign = 1.0 - 2.0 * (np.indices(squares.shape[1:]).sum(axis=0) % 2)
        lighter = [
            (sign[:, 1:] * np.diff(squares, axis=2)).ravel(),
            (sign[1:] * np.diff(squares, axis=1)).ravel(),
        ]
        share = float(np.mean(np.concatenate(lighter) > 0.0))
        return max(share, 1.0 - share) >= _ALTERNATING

    @property
    def is_plain(self) -> bool:
        """Whether the light squares between corners are light all over, most of them.

        Those of a ChArUco board have markers in them, whose edges draw a chessboard's corners
        aside.
        """
        values = np.sort(self._shown, axis=0)
        light = np.indices(values.shape[1:]).sum(axis=0) % 2 == 1
        if values[:, light].mean() < values[:, ~light].mean():
            light = ~light
        # Light falls unevenly: each light square is compared with the dark ones beside it.
        dark = _sum_beside(np.where(light, 0.0, values[12]))[light] / _sum_beside(~light)[light]
        bright = 0.4 * values[21] + 0.6 * values[22]  # their quantile of 0.9; 12 is the median
        middle = 0.5 * (dark + bright[light])
        spoilt = np.mean(values[:, light] < middle, axis=0) > _DARK_IN_LIGHT
        return bool(spoilt.mean() <= _SPOILT)

    @property
    def continue_beyond(self) -> bool:
        """Whether the found corners are only a part of a larger board.

        A board ends with the squares around its outermost inner corners. Where the pattern of dark
        and light goes on behind those, at one of the four sides and as far as the image shows it,
        the detector has found a smaller board inside a larger one.
        """
        inner, *beyond = self._contrasts.tolist()
        return inner != 0.0 and any(one / inner > _CONTINUES for one in beyond)

    @cached_property
    def _contrasts(self) -> NDArray:
        """`contrast` between the corners, and beyond them on each of four sides. Shape (5,)."""
        squares, kind = _around(*self.grid.shape[:2])
        pixels = apply_homography(self.homography, squares)
        height, width = self.smooth.shape
        visible = np.all((pixels >= 0.0) & (pixels <= (width - 1.0, height - 1.0)), axis=1)
        values, kind = brightness(self.smooth, pixels[visible]), kind[visible]
        counts = np.bincount(kind, minlength=10).reshape(-1, 2)
        sums = np.bincount(kind, values, minlength=10).reshape(-1, 2)
        dark, light = (sums / np.maximum(counts, 1)).T
        return np.where(counts.min(axis=1) < 2, np.nan, light - dark)

    @cached_property
    def _shown(self) -> NDArray:
        """Brightness of 25 points in the middle of every square. (25, rows - 1, columns - 1)."""
        grid = self.grid
        corners = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]])
        points = _IN_SQUARE @ corners.reshape(4, -1)
        return brightness(self.smooth, points.reshape(-1, *corners.shape[1:]))


def smallest_square(grid: NDArray) -> float:
    """Return the shortest distance between neighbours of a grid of corners [px]."""
    lengths = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    return float(min(lengths))


def _rectangle(across: NDArray | list[float], down: NDArray | list[float]) -> NDArray:
    """Return all points of a rectangle, row by row. Shape (n, 2)."""
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


@lru_cache(maxsize=16)
def _around(rows: int, columns: int) -> tuple[NDArray, NDArray]:
    """Return middles of squares between corners, and beyond them on each of four sides.

    Returns:
        In units of squares, shape (n, 2); twice the number of the group, one more for light ones.
    """
    across, down = np.arange(-0.5, columns), np.arange(-0.5, rows)
    groups = (
        _rectangle(across[1:-1], down[1:-1]),
        *(_rectangle(across, [v]) for v in (-_BEYOND, rows - 1 + _BEYOND)),
        *(_rectangle([u], down) for u in (-_BEYOND, columns - 1 + _BEYOND)),
    )
    squares = np.concatenate(groups)
    kind = 2 * np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    return read_only(squares), read_only(kind + (np.floor(squares).sum(axis=1) % 2 == 1))


def _sum_beside(values: NDArray) -> NDArray:
    """Return the sum of the up to four values beside each. Shape (h, w)."""
    wide = np.pad(values.astype(float), 1)
    return wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]


def smoothed(gray: NDArray) -> NDArray:
    """Return means of 3 x 3 pixels. Shape (h, w)."""
    return cv2.blur(gray, (3, 3))


def brightness(smooth: NDArray, pixels: NDArray) -> NDArray:
    """Return what a smoothed image shows at the pixels nearest to places. (..., 2) -> (...)."""
    height, width = smooth.shape
    u, v = np.moveaxis(np.rint(pixels).astype(int), -1, 0)
    return smooth[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
