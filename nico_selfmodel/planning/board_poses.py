"""Where a chessboard is held before a robot."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.vision.boards.chessboard import Board

_NEAR, _FAR = 0.24, 0.45
"""Distances at which boards are held before the left camera [m]."""
_TILT = 0.38
"""Standard deviation of a board's attitude about each axis [rad]."""
_ROOM = 0.09
"""How far before the base's frame all of a board is held [m]."""


def board_poses(
    workspace: VisibleWorkspace, board: Board, count: int, rng: np.random.Generator
) -> NDArray:
    """Draw poses in which a board should be seen whole by both cameras, before the body.

    Returns:
        X_BG, as `NicoStation.hold_board` takes them. Shape (count, 4, 4).

    Raises:
        ModelError: If such a board never fits into both images.
    """
    center = board.points.mean(axis=0)
    found: list[NDArray] = []
    for _ in range(4000 * count):
        depth = rng.uniform(_NEAR, _FAR)
        aside = rng.uniform(-0.5, 0.5, 2) * depth + [0.035, 0.0]
        attitude = rotation_from_vector(rng.normal(0.0, _TILT, 3))
        X_BG = workspace.rig.left.X_WC @ transform(attitude, [aside[0], aside[1], depth])
        X_BG = X_BG @ transform(np.eye(3), -center)
        corners = apply(X_BG, board.points)
        if workspace.shows(corners).all() and corners[:, 0].min() > _ROOM:
            found.append(X_BG)
            if len(found) == count:
                return np.array(found)
    raise ModelError(f"a {board} board with squares of {1e3 * board.square:.0f} mm does not fit")
