"""The boards that a text names: `9x6`, `charuco:7x5`, `aprilgrid:6x6`, `circles:7x5`, ..."""

from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.vision.boards.april_grid import AprilGrid
from nico_selfmodel.vision.boards.board_detection import AnyBoard, size_in
from nico_selfmodel.vision.boards.charuco import CharucoBoard
from nico_selfmodel.vision.boards.chessboard import Board
from nico_selfmodel.vision.boards.circle_grid import CircleGrid

CHESSBOARD, CHARUCO, APRILGRID = "chessboard", "charuco", "aprilgrid"
CIRCLES, ASYMMETRIC = "circles", "asymmetric-circles"
KINDS = (CHESSBOARD, CHARUCO, APRILGRID, CIRCLES, ASYMMETRIC)
"""Kinds of boards; a size without one is a chessboard's."""
_SHARE = {CHARUCO: 0.75, APRILGRID: 1.0 / 1.3, CIRCLES: 0.5, ASYMMETRIC: 1.0}
"""Side of a tag, or diameter of a circle, for each unit of the distance, where it is not given."""


def board_of(
    text: str, square_mm: float, tag_mm: float | None = None, family: str | None = None
) -> AnyBoard:
    """Return the board that a text names.

    Args:
        text: Kind, `:` and size, as `charuco:7x5`. Sizes of chessboards and ChArUco boards count
            inner corners, those of AprilGrids tags, those of circle grids circles in a row and
            rows.
        square_mm: Side of a square; of AprilGrids and circles the distance of neighbours [mm].
        tag_mm: Side of a tag, diameter of a circle [mm].

    Raises:
        ValueError: If the text is something else, or the board cannot be.
    """
    kind, _, size = text.strip().lower().rpartition(":")
    kind = kind or CHESSBOARD
    refuse_unknown("board", kind, KINDS)
    if kind == CHESSBOARD:
        if tag_mm is not None or family is not None:
            raise ValueError("--tag-mm and --family are for boards with tags or circles")
        return Board.parse(size, square_mm)
    columns, rows = size_in(size, f"{kind}:7x5")
    tag = 1e-3 * (_SHARE[kind] * square_mm if tag_mm is None else tag_mm)
    lengths = (columns, rows, 1e-3 * square_mm, tag)
    if kind in (CIRCLES, ASYMMETRIC):
        if family is not None:
            raise ValueError("--family is for boards with tags")
        return CircleGrid(*lengths, asymmetric=kind == ASYMMETRIC)
    board = CharucoBoard if kind == CHARUCO else AprilGrid
    return board(*lengths) if family is None else board(*lengths, family)
