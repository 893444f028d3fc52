"""What is printed and looked at: fiducial markers, cards of them and chessboards, as PNG files."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.board_detection import checkers
from nico_selfmodel.vision.boards.chessboard import Board
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily
from nico_selfmodel.vision.markers.tag_card import TagCard

QUIET = 1
"""Cells of white around a printed marker."""
INK = 18
"""Grey level of black print: real ink reflects some light, of which an over-exposed picture is
white."""
RIM = 0.5
"""Squares of white around the squares of a printed board."""
_CELL, _CARD_CELL, _SQUARE = 48, 24, 64
"""Sides in the picture: of a cell of a marker alone and on a card, of a board's square [px]."""
_DOT, _SPOTS = 4e-3, 150.0
"""Side of a pixel of wallpaper [m], and spots that are printed on it a square metre."""


def fiducial_png(marker: int) -> bytes:
    """Print a marker of the usual family with a white zone of one cell around it.

    Returns:
        A PNG, square, two cells wider than the marker.

    Raises:
        ValueError: If there is no such id.
    """
    pattern = FiducialFamily(DEFAULT_FAMILY).pattern(marker)
    return _png(_enlarged(np.pad(pattern, QUIET, constant_values=True), _CELL))


def card_png(card: TagCard) -> bytes:
    """Print a card of markers; white is all around and between them. It is `card.size` large."""
    family, cell = FiducialFamily(card.family), _CARD_CELL
    pixels = family.cells * cell / card.side  # of a metre
    step = round(card.pitch * pixels)
    picture = np.full((card.rows * step, card.columns * step), 255, np.uint8)
    edge = (step - family.cells * cell) // 2
    for k, marker in enumerate(card.ids):
        column, up = divmod(k, card.rows)
        top, left = (card.rows - 1 - up) * step + edge, column * step + edge
        printed = _enlarged(family.pattern(marker), cell)
        picture[top : top + len(printed), left : left + len(printed)] = printed
    return _png(picture)


def wallpaper_png(size: tuple[float, float], seed: int = 0) -> bytes:
    """Print wallpaper of spots of 1 to 30 cm in all colours, the same for the same seed.

    Args:
        size: Width and height [m].
        seed: Which paper.
    """
    rng = np.random.default_rng(seed)
    width, height = (round(side / _DOT) for side in size)
    picture = np.full((height, width, 3), 128, np.uint8)
    count = round(_SPOTS * size[0] * size[1])
    radii = np.sort(0.005 * 30.0 ** rng.uniform(size=count) / _DOT)[::-1]
    places = rng.uniform(size=(count, 2)) * [width, height]
    shapes = np.rint(radii[:, None] * [[1.0, 0.6]]).astype(int)
    turns, colors = rng.uniform(0.0, 180.0, count), rng.uniform(30.0, 230.0, (count, 3))
    for place, shape, turn, color in zip(places, shapes, turns, colors, strict=True):
        middle = np.rint(place).astype(int).tolist()
        cv2.ellipse(picture, middle, shape, turn, 0.0, 360.0, color.tolist(), cv2.FILLED)
    return cv2.imencode(".png", picture)[1].tobytes()


def chessboard_png(board: Board) -> bytes:
    """Print a board; the first inner square is black, and a white rim surrounds all squares.

    Args:
        board: The board; it has one more square each way than inner corners.

    Returns:
        A PNG, `printed_size(board)` large.
    """
    squares = _enlarged(checkers(board.columns, board.rows), _SQUARE)
    return _png(np.pad(squares, round(RIM * _SQUARE), constant_values=255))


def printed_size(board: Board) -> tuple[float, float]:
    """Return width and height of a printed board [m]; its centre is that of the corners."""
    return (
        (board.columns + 1 + 2.0 * RIM) * board.square,
        (board.rows + 1 + 2.0 * RIM) * board.square,
    )


def _enlarged(pattern: NDArray, side: int) -> NDArray:
    return np.kron(np.where(pattern, 255, INK).astype(np.uint8), np.ones((side, side), np.uint8))


def _png(gray: NDArray) -> bytes:
    _, content = cv2.imencode(".png", cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR))
    return content.tobytes()
