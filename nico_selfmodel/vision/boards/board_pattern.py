"""The dark and light squares between and around found corners: is it the board, and all of it?

A grid of corners has shape (rows, columns, 2). A detector that is asked for a board of another size
than the one in the image may answer with a part of it, or with corners picked here and there.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.homography import apply_homography, homography

_ALTERNATING = 0.95  # of the pairs of neighbouring squares
_UNEVEN = 0.5  # of a step along a row, by which the next one may differ: perspective, distortion
_CONTINUES = 0.5  # of the contrast between the inner squares
_DARK_IN_LIGHT = 0.15  # of a light square that is as dark as the dark ones ...
_SPOILT = 0.3  # ... in so many of them: more than glare, dirt and fingers spoil
_BEYOND = 1.25  # squares behind the last corners: printed boards often end in half squares


def is_regular(grid: NDArray, gray: NDArray) -> bool:
    """Tell whether corners follow each other evenly, with squares between them that alternate.

    Args:
        grid: Corners [px]. Shape (rows, columns, 2).
        gray: The image.

    Returns:
        True if they can be the corners of a chessboard.
    """
    for along in (grid, grid.swapaxes(0, 1)):
        mean_step = 0.5 * np.linalg.norm(along[2:] - along[:-2], axis=2)
        change = np.linalg.norm(along[2:] - 2.0 * along[1:-1] + along[:-2], axis=2)
        if np.any(change > _UNEVEN * mean_step):
            return False
    inside = _points_in_squares(grid, (0.3, 0.7), (0.3, 0.7))
    squares = brightness(smoothed(gray), np.stack(inside))
    sign = 1.0 - 2.0 * (np.indices(squares.shape[1:]).sum(axis=0) % 2)
    lighter = [
        (sign[:, 1:] * np.diff(squares, axis=2)).ravel(),
        (sign[1:] * np.diff(squares, axis=1)).ravel(),
    ]
    share = float(np.mean(np.concatenate(lighter) > 0.0))
    return max(share, 1.0 - share) >= _ALTERNATING


def is_plain(grid: NDArray, gray: NDArray) -> bool:
    """Tell whether the light squares between corners are light all over.

    Those of a ChArUco board have markers in them, whose edges draw a chessboard's corners aside.

    Args:
        grid: Corners [px]. Shape (rows, columns, 2).
        gray: The image.

    Returns:
        True if nothing dark stands in most of the light squares.
    """
    shares = np.linspace(0.3, 0.7, 5)
    values = brightness(smoothed(gray), np.stack(_points_in_squares(grid, shares, shares)))
    light = np.indices(values.shape[1:]).sum(axis=0) % 2 == 1
    if values[:, light].mean() < values[:, ~light].mean():
        light = ~light
    # Light falls unevenly: each light square is compared with the dark ones beside it.
    dark = np.pad(np.where(light, np.nan, np.median(values, axis=0)), 1, constant_values=np.nan)
    beside = np.stack([dark[:-2, 1:-1], dark[2:, 1:-1], dark[1:-1, :-2], dark[1:-1, 2:]])
    middle = 0.5 * (np.nanmean(beside[:, light], axis=0) + np.quantile(values[:, light], 0.9, 0))
    spoilt = np.mean(values[:, light] < middle, axis=0) > _DARK_IN_LIGHT
    return bool(spoilt.mean() <= _SPOILT)


def continues_beyond(grid: NDArray, gray: NDArray) -> bool:
    """Tell whether the found corners are only a part of a larger board.

    A board ends with the squares around its outermost inner corners. Where the pattern of dark and
    light goes on behind those, the detector has found a smaller board inside a larger one.

    Args:
        grid: Corners [px]. Shape (rows, columns, 2).
        gray: The image.

    Returns:
        True if the pattern goes on at one of the four sides, as far as the image shows it.
    """
    rows, columns = grid.shape[:2]
    across, down = np.arange(-0.5, columns), np.arange(-0.5, rows)
    sides = [
        *(_rectangle(across, [v]) for v in (-_BEYOND, rows - 1 + _BEYOND)),
        *(_rectangle([u], down) for u in (-_BEYOND, columns - 1 + _BEYOND)),
    ]
    H, smooth = _from_squares(grid), smoothed(gray)
    inner = _contrast(H, smooth, _between(grid))
    if inner == 0.0:
        return False
    return any(_contrast(H, smooth, side) / inner > _CONTINUES for side in sides)


def contrast(grid: NDArray, gray: NDArray, squares: NDArray | None = None) -> float:
    """Return by how much light squares are lighter than dark ones.

    Args:
        grid: Corners [px]. Shape (rows, columns, 2).
        gray: The image.
        squares: Points in squares, in units of squares from the first corner; the centres of the
            squares between the corners by default. Shape (n, 2).

    Returns:
        The difference of the means, negative if the first inner square is a light one; NaN where
        fewer than two squares of a kind are in the image.
    """
    inside = _between(grid) if squares is None else squares
    return _contrast(_from_squares(grid), smoothed(gray), inside)


def _contrast(H: NDArray, smooth: NDArray, squares: NDArray) -> float:
    pixels = apply_homography(H, squares)
    height, width = smooth.shape
    visible = np.all((pixels >= 0.0) & (pixels <= (width - 1.0, height - 1.0)), axis=1)
    light = np.floor(squares[visible]).sum(axis=1) % 2 == 1
    if min(light.sum(), (~light).sum()) < 2:
        return float("nan")
    values = brightness(smooth, pixels[visible])
    return float(values[light].mean() - values[~light].mean())


def _from_squares(grid: NDArray) -> NDArray:
    """Return the homography from places in units of squares to pixels. Shape (3, 3)."""
    rows, columns = grid.shape[:2]
    board = _rectangle(np.arange(columns), np.arange(rows))
    return homography(board, grid.reshape(-1, 2))


def _between(grid: NDArray) -> NDArray:
    """Return the middles of the squares between corners, in units of squares. Shape (n, 2)."""
    rows, columns = grid.shape[:2]
    return _rectangle(np.arange(columns - 1) + 0.5, np.arange(rows - 1) + 0.5)


def smallest_square(grid: NDArray) -> float:
    """Return the shortest distance between neighbours of a grid of corners [px]."""
    lengths = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    return float(min(lengths))


def _rectangle(across: NDArray | list[float], down: NDArray | list[float]) -> NDArray:
    """Return all points of a rectangle, row by row. Shape (n, 2)."""
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def _points_in_squares(grid: NDArray, across: ArrayLike, down: ArrayLike) -> list[NDArray]:
    """Return points in every square by their shares of its sides, each (rows - 1, columns - 1, 2).

    One for each pair of shares.
    """
    corners = grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]
    return [
        (1 - t) * ((1 - s) * corners[0] + s * corners[1])
        + t * ((1 - s) * corners[2] + s * corners[3])
        for s in np.asarray(across)
        for t in np.asarray(down)
    ]


def smoothed(gray: NDArray) -> NDArray:
    """Return means of 3 x 3 pixels. Shape (h, w)."""
    return cv2.blur(gray, (3, 3))


def brightness(smooth: NDArray, pixels: NDArray) -> NDArray:
    """Return what a smoothed image shows at the pixels nearest to places. (..., 2) -> (...)."""
    height, width = smooth.shape
    u, v = np.moveaxis(np.rint(pixels).astype(int), -1, 0)
    return smooth[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
