"""In which order the corners of a chessboard are listed, by the board and not by the detector.

OpenCV's detectors begin at different corners, and one of them may list a board from left to right
and the next from top to bottom. Here the columns turn into the rows as u turns into v, and the
first inner square is dark. With an odd and an even number of corners (9x6) that leaves one order
only, whichever way up the board is held. With two even or two odd numbers a board looks the same
after half a turn (a square one perhaps after a quarter), so that no image alone can tell: then the
first row points to the right, and `same_order` makes the second camera agree with the first.

A grid of corners has shape (rows, columns, 2).
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.board_pattern import FoundSquares


def standard_order(found: FoundSquares) -> NDArray:
    """Return the corners of a board in the order described above.

    Args:
        found: Corners as some detector lists them, and the squares between them.

    Returns:
        The same corners. Shape (rows, columns, 2).
    """
    grid, rows = found.grid, len(found.grid)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    turned_over = along[0] * down[1] - along[1] * down[0] < 0.0
    if turned_over:
        grid = grid[::-1]
    if sum(grid.shape[:2]) % 2:
        # Of an odd number of rows the last one begins with a dark square where the first does not.
        lighter = -found.contrast if turned_over and rows % 2 else found.contrast
        return grid if lighter > 0.0 else grid[::-1, ::-1]
    return max(_rotations(grid), key=_rightwards)


def same_order(left: NDArray, right: NDArray, columns: int, rows: int) -> NDArray:
    """Return the right camera's corners in the order of the left camera's.

    The cameras look in nearly the same direction, so that of the orders that look alike the right
    one is the nearest to the left one's once both are centred. That holds while one camera is
    rolled against the other by less than 90 degrees (45 for a square board).

    Args:
        left: Corners in the left image, nan where not seen [px]. Shape (rows * columns, 2).
        right: Corners in the right image, nan where not seen [px]. Shape (rows * columns, 2).
        columns: Inner corners in a row.
        rows: Inner corners in a column.

    Returns:
        The corners of `right`. Shape (rows * columns, 2).
    """
    orders = [order.reshape(-1, 2) for order in _rotations(right.reshape(rows, columns, 2))]
    return min(orders, key=lambda order: _apart(left, order))


def rightwards(nodes: NDArray, corners: NDArray) -> float:
    """Return how much the rows of a part of a board point to the right: the cosine.

    Args:
        nodes: Columns and rows. Shape (n, 2).
        corners: Where they are [px]. Shape (n, 2).
    """
    steps, *_ = np.linalg.lstsq(nodes - nodes.mean(axis=0), corners - corners.mean(axis=0))
    return float(steps[0, 0] / np.linalg.norm(steps[0]))


def _apart(left: NDArray, right: NDArray) -> float:
    """Return the mean square by which corners that both see lie apart, once centred."""
    moved = right - left
    return float(np.nanmean((moved - np.nanmean(moved, axis=0)) ** 2))


def _rotations(grid: NDArray) -> list[NDArray]:
    """Return the orders that half turns of the board (quarters of a square one) lead to."""
    quarter_turns = range(4) if grid.shape[0] == grid.shape[1] else (0, 2)
    return [np.rot90(grid, k) for k in quarter_turns]


def _rightwards(grid: NDArray) -> float:
    row = grid[0, -1] - grid[0, 0]
    return float(row[0] / np.linalg.norm(row))
