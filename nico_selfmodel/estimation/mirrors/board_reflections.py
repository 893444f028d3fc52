"""Boards seen directly as a body that knows itself: reflections alone then tell the mirrors."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.mirrored_boards import MirroredBoards
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.mirrors.board_mirrors import place_boards
from nico_selfmodel.estimation.mirrors.reflections import Reflections, SharedErrors
from nico_selfmodel.geometry.rotation import skew
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.camera import Camera


def board_reflections(boards: MirroredBoards, camera: Camera, sigma: float = 0.5) -> Reflections:
    """Take corners where their direct views put them, and their reflections as what was seen.

    One camera places a board well across its line of sight and badly along it; that error is common
    to all corners of a board and is handed on as such.

    Args:
        boards: Corners seen directly, in every photograph, and in mirrors.
        camera: The camera, calibrated by other means.
        sigma: Standard deviation of a pixel coordinate [px].

    Returns:
        One row for each corner and mirror; `sample` is the photograph, `rows` the corner.

    Raises:
        DataError: If a photograph does not show the board directly, or there is no reflection.
    """
    X_LG, covariance = place_boards(boards, camera)
    views, ways, corners = np.nonzero(boards.seen)
    reflected = ways > 0
    if not reflected.any():
        raise DataError("no photograph shows a reflection of the board")
    views, ways, corners = views[reflected], ways[reflected], corners[reflected]
    p_LQ = apply(X_LG[:, None], boards.p_GQ)
    arm = p_LQ - X_LG[:, None, :3, 3]
    slopes = np.zeros((len(views), 3, len(boards), 6))
    row = np.arange(len(views))
    slopes[row, :, views, :3] = -skew(arm[views, corners])
    slopes[row, :, views, 3:] = np.eye(3)
    return Reflections(
        boards.mirrors,
        ways - 1,
        (camera,),
        boards.pixels[views, ways, corners],
        p_LQ[views, corners],
        np.zeros((len(views), 3, 3)),
        np.zeros((len(views), 3, 0)),
        views,
        views,
        corners,
        SharedErrors(_root(sigma**2 * covariance), slopes.reshape(len(views), 3, -1)),
    )


def _root(covariance: NDArray) -> NDArray:
    """Return the Cholesky factors of all boards as one block-diagonal matrix. (6 V, 6 V)."""
    count = len(covariance)
    root = np.zeros((count, 6, count, 6))
    root[np.arange(count), :, np.arange(count)] = np.linalg.cholesky(covariance)
    return root.reshape(6 * count, 6 * count)
