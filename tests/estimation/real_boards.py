"""The real pairs of a chessboard, with corners as OpenCV finds them."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews

_END = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 0.1)
_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE


@cache
def stereo_chessboard(data: Path) -> BoardViews:
    """Return 13 pairs of 9 x 6 corners, or skip the test with the reason.

    Args:
        data: Folder of real measurements.
    """
    folder = data / "stereo_chessboard"
    images = sorted(folder.glob("left*.jpg"))
    if not images:
        pytest.skip(f"no images in {folder}")
    names = tuple(image.stem.removeprefix("left") for image in images)
    cameras = [
        np.array([_corners(folder / f"{camera}{name}.jpg") for name in names])
        for camera in ("left", "right")
    ]
    grid = np.stack(np.meshgrid(np.arange(9.0), np.arange(6.0)), axis=-1).reshape(-1, 2)
    board = 0.025 * np.column_stack([grid, np.zeros(54)])
    return BoardViews(
        board, names, ("left", "right"), np.concatenate(cameras, axis=2), ((640, 480),) * 2
    )


def _corners(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    found, corners = cv2.findChessboardCorners(image, (9, 6), flags=_FLAGS)
    assert found, path
    return cv2.cornerSubPix(image, corners, (11, 11), (-1, -1), _END).reshape(-1, 2).astype(float)
