"""Boards in a scene: flat chessboards at their estimated poses, coloured by how well they fit."""

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.photographs import png
from nico_selfmodel.viz.scene.lettering import label
from nico_selfmodel.viz.scene.scene_items import Item, Picture

_SQUARE_PIXELS, _EDGE_PIXELS = 20, 4
"""Size of a square in the picture of a board, and of the board's edge."""
_DARKER, _GLASS = 0.72, 0.45


def board_item(path: str, p_GQ: NDArray, X_WG: NDArray, color: ArrayLike) -> Picture:
    """Return a board as a picture with squares between its corners and one more on every side.

    Args:
        p_GQ: Corners on the board [m]. Shape (P, 3).
        X_WG: Pose of the board. Shape (4, 4).
        color: Red, green and blue of its dark squares. Shape (3,).
    """
    low, high, square = board_extent(p_GQ)
    size = high - low
    middle = transform(np.eye(3), [*(0.5 * (low + high)), 0.0])
    counts = np.maximum(np.round(size / square).astype(int), 1)
    return Picture(
        path=path,
        color=(1.0, 1.0, 1.0, 1.0),
        X_WI=X_WG @ middle,
        width=size[0],
        height=size[1],
        image=png(_pattern(counts, np.asarray(color))),
    )


def board_name(
    path: str, name: str, p_GQ: NDArray, X_WG: NDArray, color: str, R_WL: NDArray
) -> Item:
    """Return the name of a board over its highest corner, turned towards the first camera.

    Args:
        p_GQ: Corners on the board [m]. Shape (P, 3).
        X_WG: Pose of the board. Shape (4, 4).
        R_WL: Attitude of the first camera. Shape (3, 3).
    """
    outline = board_outline(p_GQ, X_WG)
    top = outline[np.argmax(outline[:, 2])]
    _, _, square = board_extent(p_GQ)
    return label(path, name, color, 1.1 * square, transform(R_WL, top), (0.5, 1.0))


def board_extent(p_GQ: NDArray) -> tuple[NDArray, NDArray, float]:
    """Return least and largest x and y of a board with a square around its corners, and the square.

    Args:
        p_GQ: Corners [m]. Shape (P, 3).
    """
    distances = np.linalg.norm(p_GQ[:, None] - p_GQ, axis=2)
    square = float(distances[distances > 0.0].min())
    return p_GQ[:, :2].min(axis=0) - square, p_GQ[:, :2].max(axis=0) + square, square


def board_outline(p_GQ: NDArray, X_WG: NDArray) -> NDArray:
    """Return the corners of a board's edge in the world [m]. Shape (4, 3)."""
    low, high, _ = board_extent(p_GQ)
    edge = [[low[0], low[1], 0.0], [high[0], low[1], 0.0], [*high, 0.0], [low[0], high[1], 0.0]]
    return apply(X_WG, np.array(edge))


def _pattern(counts: NDArray, color: NDArray) -> NDArray:
    """Return squares by turns coloured and of glass, inside an edge. Shape (h, w, 4)."""
    columns, rows = counts.tolist()
    dark = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
    squares = np.where(dark[:, :, None], [*color, 1.0], [1.0, 1.0, 1.0, _GLASS])
    image = np.repeat(np.repeat(_bytes(squares), _SQUARE_PIXELS, axis=0), _SQUARE_PIXELS, axis=1)
    edge = _DARKER * color + (1.0 - _DARKER) * np.array(to_rgb(palette.INK))
    for rim in (np.s_[:_EDGE_PIXELS], np.s_[-_EDGE_PIXELS:]):
        image[rim], image[:, rim] = _bytes([*edge, 1.0]), _bytes([*edge, 1.0])
    return image


def _bytes(color: ArrayLike) -> NDArray:
    return np.round(255.0 * np.asarray(color)).astype(np.uint8)
