"""Chessboards: the inner corners to a fraction of a pixel, of a part of one too."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.lattice_places import places_of
from nico_selfmodel.vision.boards.board_detection import (
    BoardDetection,
    Ink,
    cells_of,
    checkers,
    grid_points,
    size_in,
)
from nico_selfmodel.vision.boards.board_pattern import FoundSquares, smallest_square
from nico_selfmodel.vision.boards.board_search import SECTOR, rough_boards
from nico_selfmodel.vision.boards.corner_order import rightwards, same_order, standard_order
from nico_selfmodel.vision.boards.exact_corners import (
    WINDOW,
    clear_of_lines,
    located,
    straight,
    without_strays,
)
from nico_selfmodel.vision.boards.lattice import any_lattice
from nico_selfmodel.vision.boards.stray_corners import (
    BoardBehindLens,
    stray_corners,
    stray_points,
)
from nico_selfmodel.vision.images.image_array import detectable
from nico_selfmodel.vision.images.not_seen import NotSeen

# OpenCV's own calibration programs stop here. Stricter ends (0.001) follow the window, which at
# the default size holds the neighbours of small boards: all of `stereo_chessboard` found so was
# fitted to 0.409 px rms in place of 0.393.
_SUBPIXEL_END = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
_GROWN = "corners that follow each other"
_FEW_LOST = 0.25
"""Share of a whole board's corners that may not be located; they count as not seen."""
_SHARE_OF_PART = 0.25
"""Share of a board's corners below which a part is none."""


@dataclass(frozen=True)
class Board:
    """A chessboard, by its *inner* corners: a board of 10 x 7 squares is a 9x6 board."""

    columns: int
    """Inner corners in a row, at least 3."""
    rows: int
    """Inner corners in a column, at least 3."""
    square: float
    """Side of a square [m]."""

    def __post_init__(self) -> None:
        """Refuse boards that no detector finds."""
        if self.columns < 3 or self.rows < 3:
            raise ValueError(f"a board has at least 3x3 inner corners, got {self}")
        if not (np.isfinite(self.square) and self.square > 0.0):
            raise ValueError(f"the side of a square must be positive, got {self.square} m")

    @classmethod
    def parse(cls, text: str, square_mm: float) -> "Board":
        """Return the board that a text like `9x6` names.

        Args:
            text: Inner corners in a row, `x`, inner corners in a column.
            square_mm: Side of a square [mm].

        Raises:
            ValueError: If the text is something else, or a number is out of range.
        """
        return cls(*size_in(text, "9x6 (its inner corners)"), square_mm * 1e-3)

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

    @property
    def points(self) -> NDArray:
        """The corners in the board's frame, row by row, z = 0 [m]. Shape (P, 3)."""
        return grid_points(self.columns, self.rows, self.square)

    @property
    def ink(self) -> Ink:
        """What is printed: one more square each way than corners, the first inner one black."""
        side = (self.columns + 1) * self.square
        white = checkers(self.columns, self.rows)
        return Ink.of_blocks(cells_of(white, np.full(2, -self.square), side))

    @property
    def facts(self) -> dict[str, Any]:
        """What `result.json` tells of the board."""
        return {"board": str(self), "square_mm": 1e3 * self.square}

    def same_order(self, left: NDArray, right: NDArray) -> NDArray:
        """Return the right camera's corners in the order of the left camera's.

        Boards with an odd and an even number of corners are listed alike in every image anyway.
        Others look the same after half a turn (square ones after a quarter), which this undoes; it
        takes the cameras to be rolled against each other by less than 90 degrees (45 for a square).

        Args:
            left: Corners in the left image [px]. Shape (P, 2).
            right: Corners in the right image [px]. Shape (P, 2).

        Returns:
            The corners of `right`. Shape (P, 2).
        """
        if (self.columns + self.rows) % 2:
            return right
        return same_order(left, right, self.columns, self.rows)

    def find(self, image: NDArray, window: int) -> BoardDetection | NotSeen:
        """Find the board, whole or in part, as `find_chessboard`."""
        return find_chessboard(image, self, window)


def find_chessboard(image: NDArray, board: Board, window: int = WINDOW) -> BoardDetection | NotSeen:
    """Find the inner corners of a chessboard.

    OpenCV's `findChessboardCorners` (normalised image; one threshold for all of it, then an
    adaptive one) comes first, or, where it fails, `findChessboardCornersSB`. Corners are moved to
    where the picture is symmetric about each (`crossings`). Up to a quarter of them that are not
    plain to see count as not seen; of more, those are moved by `cornerSubPix`, which is off by up
    to 0.04 px where corners are sharp, or left where the second detector has them, which is off by
    up to 0.7 px. A smaller board inside a larger one is refused, as are corners that form no board,
    and squares with something in them. Where not all of a board is plain to see, as much of it is
    found as is.

    A part may lie in several places on the board: shifted by whole squares, turned by quarters. It
    is listed in one of them, and `loose`, unless it has as many columns and rows as the board.

    Args:
        image: Grey or BGR, 8 bits. Shape (h, w) or (h, w, 3).
        window: Half side of the sub-pixel window [px]; smaller than a square in the image.

    Returns:
        The detection, or what was tried.

    Raises:
        ValueError: If the image has another shape or type, or the window is smaller than 1, or
            larger than the picture where `cornerSubPix` is asked.
    """
    if window < 1:
        raise ValueError(f"window must be at least 1 px, got {window}")
    gray = detectable(image)
    reasons = []
    for method, rough, scale in rough_boards(gray, board.columns, board.rows):
        if rough is None:
            reasons.append(f"{method} found no {board} board")
            continue
        corners, plain, start, used = _refined(gray, rough, board, method, scale, window)
        found = FoundSquares(corners.astype(float).reshape(board.rows, board.columns, 2), gray)
        lost, problem = _judged(found, board, plain, start, used)
        if problem:
            reasons.append(f"{method} found {problem}")
            continue
        ordered = np.array(standard_order(found).reshape(-1, 2))
        if lost.any():
            ordered[(ordered[:, None] == corners[lost]).all(axis=2).any(axis=1)] = np.nan
            ordered = without_strays(board.points[:, :2], ordered, gray.shape[::-1])
        return BoardDetection(board, read_only(ordered), method, used)
    part = _part(gray, board, window)
    return part if isinstance(part, BoardDetection) else NotSeen("; ".join([*reasons, part]))


def _refined(
    gray: NDArray, rough: NDArray, board: Board, method: str, scale: float, window: int
) -> tuple[NDArray, NDArray, NDArray, int | None]:
    """Return corners to a fraction of a pixel.

    Returns:
        Them, shape (P, 2), and which are: where most are plain to see the others are left where
        they were. Where the last search began, shape (P, 2), and the window of `cornerSubPix`, if
        it was asked.
    """
    corners = rough.reshape(-1, 1, 2).copy()
    if scale > 1.0:
        # A corner of a copy is uncertain by a pixel of it, which may be more than the window.
        square = smallest_square(rough.astype(float).reshape(board.rows, board.columns, 2))
        wide = int(max(min(2.0 * scale, 0.4 * square), 2.0))
        corners = cv2.cornerSubPix(gray, corners, (wide, wide), (-1, -1), _SUBPIXEL_END)
    exact = _exact(gray, corners.reshape(board.rows, board.columns, 2).astype(float), window)
    plain = np.asarray(np.isfinite(exact).all(axis=1))
    start = corners.reshape(-1, 2).copy()  # `cornerSubPix` moves what it is given
    left = np.where(plain[:, None], exact, start)
    if plain.mean() >= 1.0 - _FEW_LOST:
        return left, plain, start, None
    every = np.ones(len(plain), dtype=bool)
    if method == SECTOR and scale == 1.0:
        return left, every, start, None
    if 2 * window + 5 > min(gray.shape):
        raise ValueError(
            f"a window of {window} px on each side of a corner does not fit into a picture of "
            f"{gray.shape[1]}x{gray.shape[0]}: make it smaller (--window)"
        )
    moved = cv2.cornerSubPix(gray, corners, (window, window), (-1, -1), _SUBPIXEL_END)
    return np.where(plain[:, None], exact, moved.reshape(-1, 2)), every, start, window


def _exact(gray: NDArray, grid: NDArray, window: int) -> NDArray:
    """Return where a whole board's corners are, nan where they are not plain to see, as in glare.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        grid: Where they are to a pixel or two [px]. Shape (rows, columns, 2).
        window: Radius of the largest window [px].

    Returns:
        [px]. Shape (P, 2).
    """
    rows, columns = grid.shape[:2]
    steps = np.stack([np.gradient(grid, axis=1), np.gradient(grid, axis=0)], axis=-1)
    radius = np.minimum(clear_of_lines(steps.reshape(-1, 2, 2)), window)
    points = grid_points(columns, rows, 1.0)[:, :2]
    found = located(gray, grid.reshape(-1, 2), radius)
    lost = np.isnan(found[:, 0])
    if lost.any() and lost.mean() <= _FEW_LOST:
        # A detector may have left one far from where it is: the others tell where to look.
        board = BoardBehindLens.of_seen(points, found, gray.shape[::-1])
        found[lost] = located(gray, board.pixels_of(points[lost]), radius[lost])
    return straight(points, gray, found, radius)


def _judged(
    found: FoundSquares, board: Board, plain: NDArray, start: NDArray, window: int | None
) -> tuple[NDArray, str | None]:
    """Return which corners were not located, and what speaks against a board that was found.

    Args:
        plain: Which corners count. Shape (P,).
        start: Where the last search for them began. Shape (P, 2).
        window: Of `cornerSubPix`, if it was asked.

    Returns:
        Truth values, shape (P,); None where nothing speaks against it.
    """
    lost = ~plain
    if not found.is_regular:
        return lost, f"no {board} board but scattered corners"
    if not found.is_plain:
        return lost, f"a {board} board whose squares are not plain (is it a ChArUco board?)"
    corners, size = found.grid.reshape(-1, 2), found.gray.shape[::-1]
    try:
        if found.continue_beyond:
            return lost, f"only a part of a board larger than {board}"
        if plain.all():
            lost = stray_corners(found.grid, size, window, found.homography).ravel()
        else:
            lost[plain] = stray_points(board.points[plain, :2], corners[plain], size)
    except ValueError:  # corners on one line have no homography
        return lost, f"no {board} board but scattered corners"
    if window is not None:  # a search that left its window comes back to where it began
        lost |= (corners == start).all(axis=1)
    if lost.mean() <= _FEW_LOST:
        return lost, None
    u, v = corners[int(np.argmax(lost))]
    return lost, (
        f"a {board} board, but {int(lost.sum())} of its corners could not be located (near "
        f"{u:.0f}, {v:.0f}): glare, a shadow, dirt, or a window too large for the squares"
    )


def _part(gray: NDArray, board: Board, window: int) -> BoardDetection | str:
    """Return what is plain to see of a part of a board, or say that it is none."""
    found = any_lattice(gray, window)
    if found is None:
        return "no part of a chessboard is plain to see"
    size, whole = sorted(found.size), sorted((board.columns, board.rows))
    if size[0] > whole[0] or size[1] > whole[1]:
        return f"a part of {size[1]}x{size[0]} corners is more than a {board} board has"
    if len(found.nodes) < _SHARE_OF_PART * board.columns * board.rows:
        return f"{len(found.nodes)} corners of a {board} board are too few"
    places = places_of(found.nodes, board.columns, board.rows)
    nodes = max(places, key=lambda placed: rightwards(placed, found.corners))
    corners = np.full((board.columns * board.rows, 2), np.nan)
    corners[nodes[:, 1] * board.columns + nodes[:, 0]] = found.corners
    return BoardDetection(board, read_only(corners), _GROWN, None, loose=size != whole)


def size_of_board(image: NDArray) -> tuple[int, int] | None:
    """Guess the size of a board of unknown size, for a hint; it may be a part of the board.

    Args:
        image: Grey or BGR, 8 bits.

    Returns:
        Inner corners the long way and the short way, or None if no board is seen.
    """
    found = any_lattice(detectable(image))
    if found is None:
        return None
    rows, columns = sorted(found.size)
    return columns, rows
