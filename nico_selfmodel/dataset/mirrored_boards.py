"""Corners of a flat board as one camera saw them directly and in mirrors."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.board_views import BoardViews


@dataclass(frozen=True, eq=False)
class MirroredBoards:
    """Matched corners of one board in V photographs, each seen up to 1 + M ways."""

    p_GQ: NDArray
    """Corners on the board, z = 0 [m]. Shape (P, 3)."""
    names: tuple[str, ...]
    """What each photograph is called, for people. Length V."""
    mirrors: tuple[str, ...]
    """Names of the mirrors. Length M."""
    pixels: NDArray
    """Corners seen directly, then in each mirror; nan where not seen [px]. Shape (V, 1 + M, P, 2).
    The order of the corners is that on the board, in reflections too."""
    image_size: tuple[int, int]
    """Width and height [px]."""
    camera: str = "left"
    """Which camera saw them."""

    def __post_init__(self) -> None:
        """Check shapes and make the arrays read-only."""
        for name in ("p_GQ", "pixels"):
            object.__setattr__(self, name, read_only(getattr(self, name), float))
        expected = (len(self.names), 1 + len(self.mirrors), len(self.p_GQ), 2)
        if self.pixels.shape != expected or self.p_GQ.shape[1:] != (3,):
            raise ValueError(
                f"pixels must have shape {expected} and p_GQ (P, 3), got {self.pixels.shape} and "
                f"{self.p_GQ.shape}"
            )
        for words in (self.names, self.mirrors):
            if len(set(words)) != len(words):
                raise ValueError(f"names must be unique, got {words}")

    def __len__(self) -> int:
        """Return the number of photographs."""
        return len(self.names)

    @property
    def seen(self) -> NDArray:
        """Which corners were seen which way. Boolean, shape (V, 1 + M, P)."""
        return np.asarray(np.isfinite(self.pixels).all(axis=3))

    @property
    def ways(self) -> NDArray:
        """Which ways each photograph shows at least four corners. Boolean, shape (V, 1 + M)."""
        return np.asarray(self.seen.sum(axis=2) >= 4)

    def select(self, rows: ArrayLike) -> "MirroredBoards":
        """Return some photographs, chosen by index or by a boolean mask."""
        index = np.arange(len(self))[np.asarray(rows)]
        return replace(self, names=tuple(self.names[i] for i in index), pixels=self.pixels[index])

    def directly(self) -> BoardViews:
        """Return what was seen directly, without the photographs in which nothing was."""
        views = BoardViews(
            self.p_GQ, self.names, (self.camera,), self.pixels[:, 0], self.image_size
        )
        return views.select(self.ways[:, 0])
