"""What a board is to those who look for one, and what is seen of it."""

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.vision.images.not_seen import NotSeen


@dataclass(frozen=True, eq=False)
class Ink:
    """What is black on a printed board, in the frame of its points [m]."""

    blocks: NDArray
    """Rectangles: least x and y, width and height. Shape (n, 4)."""
    discs: NDArray
    """Circles: centre and radius. Shape (m, 3)."""

    @classmethod
    def of_blocks(cls, *blocks: NDArray) -> "Ink":
        """Return ink without circles."""
        return cls(np.concatenate([np.reshape(b, (-1, 4)) for b in blocks]), np.zeros((0, 3)))


def grid_points(columns: int, rows: int, step: float, shift: int = 0) -> NDArray:
    """Return a grid row by row, z = 0.

    Args:
        columns: Points in a row.
        step: Distance of neighbours [m].
        shift: 1 where every other row is moved by `step` and neighbours in a row are two apart.

    Returns:
        [m]. Shape (columns rows, 3).
    """
    return _grid(columns, rows, shift) * step


@lru_cache(maxsize=16)
def _grid(columns: int, rows: int, shift: int) -> NDArray:
    across, down = np.meshgrid(np.arange(columns), np.arange(rows))
    across = (1 + shift) * across + shift * (down % 2)
    return read_only(np.stack([across, down, np.zeros_like(across)], axis=-1).reshape(-1, 3))


_MOST_ALONG_SIDE = 999
"""No picture shows more."""


def checkers(columns: int, rows: int) -> NDArray:
    """Return the squares of a board with some inner corners, True where white; the first black.

    Shape (rows + 1, columns + 1).
    """
    return np.asarray(np.indices((rows + 1, columns + 1)).sum(axis=0) % 2 == 1)


def size_in(text: str, example: str) -> tuple[int, int]:
    """Return columns and rows of a size like `9x6`.

    Raises:
        ValueError: If it is something else, with `example` as what is expected.
    """
    match = re.fullmatch(r"\s*(\d{1,9})\s*[x×]\s*(\d{1,9})\s*", text.lower())
    if match is None:
        raise ValueError(f"a board is written as {example}, got {text!r}")
    columns, rows = int(match[1]), int(match[2])
    if max(columns, rows) > _MOST_ALONG_SIDE:
        raise ValueError(
            f"a board has at most {_MOST_ALONG_SIDE} corners along a side, got {text!r}"
        )
    return columns, rows


def cells_of(pattern: NDArray, corner: NDArray, side: float) -> NDArray:
    """Return rectangles of the black cells of a pattern, runs of a row as one. Shape (n, 4).

    Args:
        pattern: True where white. Shape (rows, columns).
        corner: Least x and y of the pattern. Shape (2,).
        side: Width of the pattern.
    """
    cell = side / pattern.shape[1]
    black = np.pad(~pattern, ((0, 0), (1, 1))).astype(int)
    row, first = np.nonzero(np.diff(black, axis=1) == 1)
    _, end = np.nonzero(np.diff(black, axis=1) == -1)
    runs = np.stack([first, row, end - first, np.ones_like(row)], axis=1) * cell
    runs[:, :2] += corner
    return np.asarray(runs)


class AnyBoard(Protocol):
    """A flat board with points that a camera locates."""

    @property
    def square(self) -> float:
        """Distance of neighbouring squares, tags or circles [m]."""
        ...

    @property
    def points(self) -> NDArray:
        """The points in the board's frame, z = 0 [m]. Shape (P, 3)."""
        ...

    @property
    def ink(self) -> Ink:
        """What is printed."""
        ...

    @property
    def facts(self) -> dict[str, Any]:
        """What `result.json` tells of it."""
        ...

    def find(self, image: NDArray, window: int) -> "BoardDetection | NotSeen":
        """Look for the board in an image, grey or BGR, 8 bits.

        `window` is half the side of the sub-pixel window [px]; boards of tags and circles take a
        smaller one where neighbours would reach into it.
        """
        ...

    def same_order(self, left: NDArray, right: NDArray) -> NDArray:
        """Return the right camera's points in the order of the left camera's. Shapes (P, 2)."""
        ...


@dataclass(frozen=True, eq=False)
class BoardDetection:
    """A board that was seen, whole or in part."""

    board: AnyBoard
    """What was looked for."""
    corners: NDArray
    """Pixels in the order of `board.points`, nan where not seen. Shape (P, 2)."""
    method: str
    """What found it: OpenCV's detector where it was one."""
    window: int | None
    """Half side of the window of `cornerSubPix` [px], which neighbouring corners may draw; None
    where it was not asked."""
    loose: bool = False
    """Whether it is a part that may as well lie elsewhere on the board."""

    @property
    def seen(self) -> NDArray:
        """Which points were seen. Boolean, shape (P,)."""
        return np.asarray(np.isfinite(self.corners).all(axis=1))

    @property
    def smallest_square_px(self) -> float:
        """The shortest distance between neighbours [px]; should be well above the window."""
        p = self.corners[self.seen]
        away = np.linalg.norm(p[:, None] - p[None], axis=2)
        return float(np.min(away[~np.eye(len(p), dtype=bool)]))
