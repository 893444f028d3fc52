"""What of a picture another one shows in nearly the same place, be it lit otherwise."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.images.motion_mask import CELL

_ASIDE = 12
"""Pixels by which what stands still may be aside in each direction: play of joints, what gravity
bends, and that a pose is not reached twice alike."""
_ALIKE = 0.85
"""Least correlation of what is the same: noise and edges between pixels leave that of contrasts."""
_SLOPE, _BOTH_WAYS = 1.0, 0.1
"""Times the noise that grey levels must rise by in a pixel, in the direction in which they do
least (rms), and the share that its square must be of that in the other: along a straight edge, or
where all is plain, the same is found anywhere."""
_SMOOTH = 1.0
"""Of the pictures that are compared [px]."""


@dataclass(frozen=True, eq=False)
class StandingCells:
    """Which cells of a picture show something, and which of these another does not show there."""

    shows: NDArray
    """Cells in which what goes elsewhere would be missed. Boolean, shape (rows, columns)."""
    changed: NDArray
    """Those of them that are not found again. Boolean, shape (rows, columns)."""


def standing_cells(before: NDArray, after: NDArray, noise: float) -> StandingCells:
    """Ask of each cell of `CELL` pixels whether another picture shows the same about there.

    It does where the correlation coefficient of grey levels, which light that is more or less all
    over the cell leaves as it is, is `_ALIKE` or more at a place `_ASIDE` pixels away at most.

    Args:
        before: The first picture, BGR, 8 bits. Shape (h, w, 3).
        after: The other. Shape (h, w, 3).
        noise: Standard deviation of a grey level (`picture_noise`).

    Returns:
        An incomplete last row or column of cells is left out. Shapes (h // CELL, w // CELL).

    Raises:
        ValueError: If the pictures differ in shape, are not BGR, or are smaller than a cell.
    """
    if before.shape != after.shape or before.ndim != 3 or min(before.shape[:2]) < CELL:
        raise ValueError(
            f"two pictures must have one shape (h, w, 3) of {CELL} pixels a side at least, got "
            f"{before.shape} and {after.shape}"
        )
    one, other = (
        cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), (0, 0), _SMOOTH)
        for image in (before, after)
    )
    wide = np.pad(other, _ASIDE, mode="edge")
    less, more = _slopes(one)
    shows = (less > (_SLOPE * noise) ** 2) & (less > _BOTH_WAYS * more)
    changed = np.zeros_like(shows)
    for row, column in np.argwhere(shows):
        top, left = row * CELL, column * CELL
        cell = one[top : top + CELL, left : left + CELL]
        about = wide[top : top + CELL + 2 * _ASIDE, left : left + CELL + 2 * _ASIDE]
        found = cv2.matchTemplate(about, cell, cv2.TM_CCOEFF_NORMED)
        changed[row, column] = found.max() < _ALIKE
    return StandingCells(shows, changed)


def _slopes(image: NDArray) -> tuple[NDArray, NDArray]:
    """Return the eigenvalues of each cell's mean of grad I grad I', the smaller first.

    (Harris and Stephens 1988.) Shape (rows, columns) each.
    """
    gray = image.astype(np.float32)
    x, y = (cv2.Sobel(gray, cv2.CV_32F, *way) / 8.0 for way in ((1, 0), (0, 1)))
    rows, columns = gray.shape[0] // CELL, gray.shape[1] // CELL
    xx, xy, yy = (
        one[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL).mean(axis=(1, 3))
        for one in (x * x, x * y, y * y)
    )
    middle, apart = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return middle - apart, middle + apart
