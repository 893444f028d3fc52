"""Corners of a flat board as one or more cameras saw them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import DataError
from nico_selfmodel.names import check_name

_FEWEST_CORNERS = 4
_ON_LINE = 1e-12
"""Scatter across a line, over that along it, below which corners lie on it: of rounding alone."""


@dataclass(frozen=True, eq=False)
class BoardViews:
    """Matched corners of one board in V views; frame G is the board's, its z = 0."""

    p_GQ: NDArray
    """Corners on the board [m]. Shape (P, 3)."""
    names: tuple[str, ...]
    """What each view is called, for people. Length V."""
    cameras: tuple[str, ...]
    """What the cameras are called: of a pair `left` and `right`. Length C."""
    pixels: NDArray
    """Corners, u and v of each camera in turn; nan where not seen [px]. Shape (V, P, 2 C)."""
    image_sizes: tuple[tuple[int, int], ...]
    """Width and height of each camera's images [px]. Length C."""
    loose: NDArray = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))
    """Where a camera saw a part of a chessboard that may as well lie elsewhere on it, as
    `lattice_places` says; nowhere by default. Boolean, shape (V, C)."""

    def __post_init__(self) -> None:
        """Check shapes and make the arrays read-only."""
        for name in ("p_GQ", "pixels"):
            object.__setattr__(self, name, read_only(getattr(self, name), float))
        loose = self.loose if self.loose.size else np.zeros((len(self.names), len(self.cameras)))
        object.__setattr__(self, "loose", read_only(loose, bool))
        expected = (len(self.names), len(self.p_GQ), 2 * len(self.cameras))
        if self.pixels.shape != expected or self.p_GQ.shape[1:] != (3,):
            raise ValueError(
                f"pixels must have shape {expected} and p_GQ (P, 3), got {self.pixels.shape} and "
                f"{self.p_GQ.shape}"
            )
        if len(set(self.names)) != len(self.names):
            raise ValueError(f"views must have names of their own, got {self.names}")
        if not self.cameras or len(set(self.cameras)) != len(self.cameras):
            raise ValueError(f"cameras must have names of their own, got {self.cameras}")
        sizes = tuple((int(width), int(height)) for width, height in self.image_sizes)
        if len(sizes) != len(self.cameras):
            raise ValueError(f"{len(self.cameras)} cameras have as many sizes, got {sizes}")
        object.__setattr__(self, "image_sizes", sizes)
        for camera in self.cameras:
            check_name(camera, "names of cameras")
            if "." in camera:
                raise ValueError(f"names of cameras have no dot in them, got {camera!r}")
        if self.loose.shape != (len(self.names), len(self.cameras)):
            raise ValueError(f"loose must have shape (V, C), got {self.loose.shape}")

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.names)

    @property
    def seen(self) -> NDArray:
        """Which corners each camera saw. Boolean, shape (V, C, P)."""
        both = self.pixels.reshape(len(self), len(self.p_GQ), len(self.cameras), 2)
        return np.swapaxes(np.asarray(np.isfinite(both).all(axis=3)), 1, 2)

    def of_camera(self, side: str) -> NDArray:
        """Return the corners that one camera saw. Shape (V, P, 2)."""
        column = 2 * self.cameras.index(side)
        return self.pixels[:, :, column : column + 2]

    def size_of(self, camera: str) -> tuple[int, int]:
        """Return width and height of one camera's images [px]."""
        return self.image_sizes[self.cameras.index(camera)]

    @property
    def placing(self) -> NDArray:
        """Whether a camera saw four corners, no three of them on one line. Shape (V, C)."""
        seen = self.seen
        placing = np.array(seen.all(axis=2))
        for v, c in np.argwhere(seen.any(axis=2) & ~placing):
            placing[v, c] = _have_homography(self.p_GQ[seen[v, c]])
        return placing

    def placeable(self) -> "BoardViews":
        """Return the views without what cannot place a board: `placing`."""
        placing = self.placing
        kept = np.repeat(placing, 2, axis=1)[:, None]
        pixels = np.where(kept, self.pixels, np.nan)
        return replace(self, pixels=pixels).select(placing.any(axis=1))

    def pair(self, first: str, second: str) -> "BoardViews":
        """Return what two cameras saw, in all views."""
        both = np.concatenate([self.of_camera(first), self.of_camera(second)], axis=2)
        sizes = (self.size_of(first), self.size_of(second))
        loose = self.loose[:, [self.cameras.index(first), self.cameras.index(second)]]
        return replace(self, cameras=(first, second), pixels=both, image_sizes=sizes, loose=loose)

    def select(self, rows: ArrayLike | Sequence[int]) -> "BoardViews":
        """Return some views, chosen by index or by a boolean mask."""
        index = np.arange(len(self))[np.asarray(rows)]
        return replace(
            self,
            names=tuple(self.names[i] for i in index),
            pixels=self.pixels[index],
            loose=self.loose[index],
        )

    def only(self, side: str) -> "BoardViews":
        """Return what one camera saw, without the views in which it saw nothing."""
        sizes, loose = (self.size_of(side),), self.loose[:, [self.cameras.index(side)]]
        alone = replace(
            self, cameras=(side,), pixels=self.of_camera(side), image_sizes=sizes, loose=loose
        )
        return alone.select(alone.seen.any(axis=(1, 2)))

    def apart(self) -> "BoardViews":
        """Return parts whose place is not told as views of their own, which any place will do for.

        They are called by their camera besides.
        """
        seen = self.seen.any(axis=2)
        several = self.loose & (seen.sum(axis=1, keepdims=True) > 1)
        rows, columns = np.nonzero(several)
        kept = self.pixels.reshape(*self.pixels.shape[:2], -1, 2).copy()
        alone = np.full((len(rows), *kept.shape[1:]), np.nan)
        alone[np.arange(len(rows)), :, columns] = kept[rows, :, columns]
        kept[rows, :, columns] = np.nan
        pixels = np.concatenate([kept, alone]).reshape(-1, *self.pixels.shape[1:])
        own = (own_name(self.names[v], self.cameras[c]) for v, c in zip(rows, columns, strict=True))
        none = np.zeros((len(pixels), len(self.cameras)), dtype=bool)
        views = replace(self, names=(*self.names, *own), pixels=pixels, loose=none)
        return views.select(views.seen.any(axis=(1, 2)))

    def split(self, fraction: float, seed: int) -> tuple["BoardViews", "BoardViews"]:
        """Hold out a share of the views, at least one.

        Raises:
            DataError: If either part would be empty.
            ValueError: If the fraction is not between 0 and 1.
        """
        if not 0.0 < fraction < 1.0:
            raise ValueError(f"the share to hold out must lie between 0 and 1, got {fraction}")
        count = max(1, round(fraction * len(self)))
        if count >= len(self):
            what = "record more boards" if len(self) < 2 else "hold less out, or record more boards"
            raise DataError(f"{fraction:g} of {len(self)} views leaves none to learn from: {what}")
        order = np.random.default_rng(seed).permutation(len(self))
        return self.select(np.sort(order[count:])), self.select(np.sort(order[:count]))


def own_name(view: str, camera: str) -> str:
    """Return what a view of one camera is called that has become a view of its own."""
    return f"{view} {camera}"


def _have_homography(points: NDArray) -> bool:
    """Tell whether four corners are no three on one line: whichever is left out, a plane stays.

    Of a line of corners and one beside it, images tell no homography.

    Args:
        points: Corners in the board's plane. Shape (n, 3).
    """
    count = len(points)
    if count < _FEWEST_CORNERS:
        return False
    p = points - points.mean(axis=0)
    without = p.T @ p - count / (count - 1.0) * p[:, :, None] * p[:, None]
    spread = np.linalg.eigvalsh(without)
    return bool((spread[:, 1] > _ON_LINE * spread[:, 2]).all())
