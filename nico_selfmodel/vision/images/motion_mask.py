"""Where something moved between two pictures of a camera that stands still."""

import cv2
import numpy as np
from numpy.typing import NDArray

CELL = 16
"""Sides of the cells that a picture is divided into [px]."""
_NORMAL = 4.79
"""A standard normal deviate exceeds this once in 1.2 million cells, a thousand pictures of 1200."""
_LEAST = 2.0 / 12.0
"""Least variance of a difference: that of rounding both pictures [grey levels squared]."""


def moving_cells(before: NDArray, after: NDArray) -> NDArray:
    """Return which cells of a picture show motion.

    Of a cell of k values whose noise has the standard deviation s, the mean squared difference of
    two pictures is D = (1/k) sum (I_2 - I_1)^2. Where nothing moves, its mean is V = 2 s^2 and its
    variance (2 V^2 + V) / k: a chi-square's, and that of counting in whole grey levels (Skellam).
    V is the median of D over the cells: less than half of the picture may move. The threshold
    follows from one false cell in a thousand still pictures (`still_limit`), if noise is alike
    everywhere and pixels err on their own.

    Args:
        before: The earlier picture, BGR, 8 bits. Shape (h, w, 3).
        after: The later one. Shape (h, w, 3).

    Returns:
        A truth value a cell of `CELL` pixels; an incomplete last row or column of cells is left
        out. Shape (h // CELL, w // CELL).

    Raises:
        ValueError: If the pictures differ in shape, are not BGR, or are smaller than a cell.
    """
    squares, count = _mean_squares(before, after)
    return squares > still_limit(_still(squares), count)


def still_limit(still: float, count: int) -> float:
    """Return what the mean squared difference of a cell exceeds by chance once in 1.2 million.

    It is V chi^2_n / n with n = 2 k V / (2 V + 1), which has the mean V and the variance
    (2 V^2 + V) / k; its quantile, z being the normal's, by Wilson and Hilferty (1931)

        V (1 - 2 / (9 n) + z sqrt(2 / (9 n)))^3

    A normal with that variance exceeds its own seven times as often: a chi-square is skew.

    Args:
        still: V, the mean where nothing moves [grey levels squared].
        count: k, values in a cell.
    """
    share = 2.0 / 9.0 * (2.0 * still + 1.0) / (2.0 * count * still)
    return still * (1.0 - share + _NORMAL * np.sqrt(share)) ** 3


def picture_noise(before: NDArray, after: NDArray) -> float:
    """Return the standard deviation of a grey level, of two pictures of which most stood still.

    Args:
        before: A picture, BGR, 8 bits. Shape (h, w, 3).
        after: Another one. Shape (h, w, 3).

    Raises:
        ValueError: If the pictures differ in shape, are not BGR, or are smaller than a cell.
    """
    return float(np.sqrt(0.5 * _still(_mean_squares(before, after)[0])))


def _still(squares: NDArray) -> float:
    """Return the variance of the difference of two pictures where nothing moves."""
    return max(float(np.median(squares)), _LEAST)


def _mean_squares(before: NDArray, after: NDArray) -> tuple[NDArray, int]:
    """Return the mean squared difference of each cell, and how many values it is the mean of.

    Raises:
        ValueError: If the pictures do not belong together.
    """
    if before.shape != after.shape or before.ndim != 3 or min(before.shape[:2]) < CELL:
        raise ValueError(
            f"two pictures must have one shape (h, w, 3) of {CELL} pixels a side at least, got "
            f"{before.shape} and {after.shape}"
        )
    rows, columns = before.shape[0] // CELL, before.shape[1] // CELL
    whole = (slice(rows * CELL), slice(columns * CELL))
    apart = cv2.absdiff(before[whole], after[whole]).astype(np.float32)
    squares = (apart * apart).reshape(rows, CELL, columns, CELL, -1).mean(axis=(1, 3, 4))
    return squares, CELL * CELL * before.shape[2]
