"""The corners of a chessboard as far as they are plain to see.

Where a detector has a few of them, the plane behind a lens that these lie on says where their
neighbours must be; one that is there, with dark and light around it as on a chessboard, belongs to
it, and so on.
"""

from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.board_pattern import brightness, smoothed
from nico_selfmodel.vision.boards.exact_corners import (
    FEWEST,
    WINDOW,
    clear_of_lines,
    exact_corners,
    located,
)
from nico_selfmodel.vision.boards.lattice_search import crosses
from nico_selfmodel.vision.boards.stray_corners import BoardBehindLens
from nico_selfmodel.vision.images.image_array import reduced

_SEARCHED = 2_500_000
"""Pixels of the copy in which a part of a board is looked for."""
_NEAR = 0.25
"""Share of what is clear about a neighbour by which it may lie off where the others have it."""
_LONGEST = 60
"""Rings that a part may grow by."""
_FEWEST = 12
"""Corners below which a part is none: tiles, shelves and noise have some."""
_SEEDS, _LARGE = 12, 20
"""Crosses of corners that are tried, and corners of a part with which no other is looked for."""
_SAME = 1.0
"""Distance below which a cross is one of corners that were tried [px of the copy]."""
_SIDES = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]])
"""Ways into the squares about a node, two of each colour."""
_BLURRED, _LEAST, _MOST = 2.5, 0.1, 0.3
"""How far from edges squares are plain [px], and shares of their sides that it is between."""
_PLAIN = 0.8
"""Least contrast at a place in squares over the largest: tags lie in middles, dots leave corners
out."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """Corners by their place among each other; see `dataset.lattice_places`."""

    nodes: NDArray
    """Whole numbers, columns and rows. Shape (n, 2)."""
    corners: NDArray
    """Where they are; nan where not seen [px]. Shape (n, 2)."""

    @classmethod
    def of_grid(cls, grid: NDArray, gray: NDArray) -> "Lattice":
        """Return a grid of corners so that colours are those of a board and nothing is mirrored.

        Args:
            grid: Corners, nan where not seen [px]. Shape (rows, columns, 2).
        """
        along = np.nanmean(np.diff(grid, axis=1), axis=(0, 1))
        down = np.nanmean(np.diff(grid, axis=0), axis=(0, 1))
        if along[0] * down[1] - along[1] * down[0] < 0.0:
            grid = grid[::-1]
        rows, columns = grid.shape[:2]
        nodes = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
        corners = grid.reshape(-1, 2).astype(float)
        lattice = cls(nodes, corners)
        dark = float(np.mean(lattice._darker(gray, lattice._board(gray), nodes)))
        return cls(nodes + np.array([1, 0]), corners) if dark < 0.0 else lattice

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows, seen or not."""
        columns, rows = np.ptp(self.nodes, axis=0) + 1
        return int(columns), int(rows)

    def grown(self, gray: NDArray, window: int) -> "Lattice":
        """Return the lattice with all neighbours, and theirs, that are plain to see.

        Raises:
            ValueError: If corners lie on one line.
        """
        lattice = self._plain(gray, window)
        for _ in range(_LONGEST):
            before = len(lattice.nodes)
            if before < FEWEST:
                return lattice
            lattice = lattice._with_neighbours(gray, window)
            if len(lattice.nodes) == before:
                break
        return lattice._plain(gray, window)

    def _plain(self, gray: NDArray, window: int) -> "Lattice":
        """Return the corners that are plain to see, to a fraction of a pixel."""
        nodes = self.nodes.astype(float)
        found = exact_corners(nodes, gray, self.corners, clear_of_lines, window)
        seen = np.isfinite(found[:, 0])
        return Lattice(self.nodes[seen], found[seen])

    def has_squares(self, gray: NDArray) -> bool:
        """Tell whether squares about the middle are dark and light all over.

        Steps to corners further off than the next make a lattice, too, but no squares.
        """
        middle = self.nodes[len(self.nodes) // 2][None]
        return bool((self._darker(gray, self._board(gray), middle) > 0.0).all())

    def is_plain(self, gray: NDArray) -> bool:
        """Tell whether its squares are dark or light all over, unlike those with tags, and dots."""
        dark = np.median(self._darker(gray, self._board(gray), self.nodes), axis=0)
        return bool(dark.min() > _PLAIN * dark.max())

    def _with_neighbours(self, gray: NDArray, window: int) -> "Lattice":
        """Return the lattice with those next to it that are plain to see."""
        steps = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        beside = np.unique((self.nodes[:, None] + steps).reshape(-1, 2), axis=0)
        beside = beside[~_in(beside, self.nodes)]
        board = self._board(gray)
        reach = clear_of_lines(board.steps_at(beside.astype(float)))
        rough = board.pixels_of(beside.astype(float))
        found = located(gray, rough, np.minimum(reach, window))
        dark = (self._darker(gray, board, beside) > 0.0).all(axis=1)
        near = np.linalg.norm(found - rough, axis=1) < np.maximum(_NEAR * reach, 1.0)
        taken = np.linalg.norm(found[:, None] - self.corners, axis=2).min(axis=1) < 0.5 * reach
        new = np.isfinite(found[:, 0]) & near & dark & ~taken
        return Lattice(
            np.concatenate([self.nodes, beside[new]]), np.concatenate([self.corners, found[new]])
        )

    def _board(self, gray: NDArray) -> BoardBehindLens:
        return BoardBehindLens.of_seen(self.nodes.astype(float), self.corners, gray.shape[::-1])

    @staticmethod
    def _darker(gray: NDArray, board: BoardBehindLens, nodes: NDArray) -> NDArray:
        """Return how much darker squares are that should be than those beside them. (n, 9)."""
        area = np.abs(np.linalg.det(board.steps_at(nodes.astype(float))))
        low = np.clip(_BLURRED / np.sqrt(float(np.median(area))), _LEAST, _MOST)
        inside = np.stack(np.meshgrid(*[(low, 0.5, 1.0 - low)] * 2), axis=-1).reshape(-1, 2)
        sides = (_SIDES[:, None] * inside).reshape(-1, 2)
        places = board.pixels_of((nodes[:, None] + sides).reshape(-1, 2))
        light = brightness(smoothed(gray), np.nan_to_num(places)).reshape(len(nodes), 4, -1)
        even = 1.0 - 2.0 * (nodes.sum(axis=1) % 2)
        return np.asarray(even[:, None] * np.einsum("nsk,s->nk", light, [-1.0, -1.0, 1.0, 1.0]))


def _in(nodes: NDArray, others: NDArray) -> NDArray:
    """Return which nodes are among others. Shapes (n, 2), (m, 2) -> (n,)."""
    return (nodes[:, None] == others).all(axis=2).any(axis=1)


def any_lattice(gray: NDArray, window: int = WINDOW) -> Lattice | None:
    """Return the largest part of some chessboard that is plain to see; None where there is none.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        window: Radius of the largest window in which a corner is looked at [px].
    """
    copy, scale = reduced(gray, _SEARCHED)
    largest: Lattice | None = None
    tried = np.full((1, 2), np.inf)
    for grid in islice(crosses(copy), _SEEDS):
        grid = (grid + 0.5) * scale - 0.5
        if np.linalg.norm(tried - grid[1, 1], axis=1).min() < _SAME * scale:
            continue
        try:
            seed = Lattice.of_grid(grid, gray)
            if not (seed.has_squares(gray) and seed.is_plain(gray)):
                continue
            found = seed.grown(gray, window)
            tried = np.concatenate([tried, found.corners])
            plain = len(found.nodes) >= _FEWEST and found.is_plain(gray)
        except ValueError:  # on one line
            continue
        if plain and (largest is None or len(found.nodes) > len(largest.nodes)):
            largest = found
        if largest is not None and len(largest.nodes) > _LARGE:
            break
    return largest
