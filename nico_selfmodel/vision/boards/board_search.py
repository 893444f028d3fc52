"""Where OpenCV's two detectors have the corners of a board, in images of any size.

`findChessboardCorners` compares every quadrangle it finds with every other: a megapixel of noise
takes it ten seconds, four take minutes. So large images are searched in smaller copies, and where
`findChessboardCornersSB`, which minds neither, has seen the board, only there.
"""

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.images.image_array import reduced

CLASSIC, SECTOR = "findChessboardCorners", "findChessboardCornersSB"
_FLAGS = (
    cv2.CALIB_CB_NORMALIZE_IMAGE,
    cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE,
)
"""One threshold for all of a picture is tried before one for each part: it takes a quarter less of
pictures that both find a board in, and a quarter of the other where there is none."""
_SMALL = 500_000
"""Pixels up to which either detector may look as long as it likes."""
_SEARCHED = 2_500_000
"""Pixels of the copy in which a larger image is searched."""
_FEW_PIECES = 2000
"""Pieces of dark and light up to which the classic detector is done in seconds."""
_AROUND = 0.3
"""Of a board's size, looked at around it."""


def rough_boards(
    gray: NDArray, columns: int, rows: int
) -> Iterator[tuple[str, NDArray | None, float]]:
    """Look for a board with one detector after the other.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        columns: Inner corners in a row.
        rows: Inner corners in a column.

    Yields:
        Name of the detector; the corners, shape (P, 2), or None; and how many pixels of the image
        one pixel of the searched copy is.
    """
    size = (columns, rows)
    if gray.size <= _SMALL:
        yield CLASSIC, _classic(gray, size), 1.0
        yield SECTOR, _sector(gray, size), 1.0
        return
    copy, scale = reduced(gray, _SEARCHED)
    sector = _sector(copy, size)
    if sector is not None:
        left, top, right, bottom = _surroundings(sector, copy)
        found = _classic(np.ascontiguousarray(copy[top:bottom, left:right]), size)
        yield CLASSIC, _enlarged(found, scale, (left, top)), scale
        yield SECTOR, _enlarged(sector, scale), scale
        return
    small, small_scale = reduced(gray, _SMALL)
    found = _enlarged(_classic(small, size), small_scale)
    if found is None and cv2.checkChessboard(copy, size) and _pieces(copy) <= _FEW_PIECES:
        found, small_scale = _enlarged(_classic(copy, size), scale), scale
    yield CLASSIC, found, small_scale
    yield SECTOR, None, scale


def _classic(gray: NDArray, size: tuple[int, int]) -> NDArray | None:
    for flags in _FLAGS:
        found, corners = cv2.findChessboardCorners(gray, size, flags=flags)
        if found:
            return np.asarray(corners.reshape(-1, 2))
    return None


def _sector(gray: NDArray, size: tuple[int, int]) -> NDArray | None:
    found, corners = cv2.findChessboardCornersSB(gray, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    return corners.reshape(-1, 2) if found else None


def _surroundings(corners: NDArray, gray: NDArray) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of a board with what is around it."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = _AROUND * (high - low).max()
    left, top = np.maximum(low - room, 0.0).astype(int).tolist()
    right, bottom = np.minimum(high + room + 1.0, gray.shape[::-1]).astype(int).tolist()
    return left, top, right, bottom


def _enlarged(
    corners: NDArray | None, scale: float, corner: tuple[int, int] = (0, 0)
) -> NDArray | None:
    if corners is None:
        return None
    return ((corners + np.array(corner) + 0.5) * scale - 0.5).astype(np.float32)


def _pieces(gray: NDArray) -> int:
    """Return how many pieces of light there are, at a threshold like the detector's own."""
    block = int(0.2 * min(gray.shape)) | 1
    light = cv2.adaptiveThreshold(
        gray, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, max(block, 3), 0
    )
    return int(cv2.connectedComponents(light)[0])
