"""Cards of markers that hang in a room, each at a known place."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily


@dataclass(frozen=True, eq=False)
class TagCard:
    """Rows of square markers on one flat card, numbered from one id on, column by column.

    In the card's frame K the markers lie in z = 0, z points out of the print and y to its top; the
    origin is the middle of the lowest row.
    """

    first: int
    """Id of its first marker."""
    X_WK: NDArray = field(default_factory=lambda: np.eye(4))
    """Where it hangs [m]. Shape (4, 4)."""
    columns: int = 3
    """Markers beside each other."""
    rows: int = 2
    """Markers above each other."""
    side: float = 0.08
    """Of a marker's black square [m]."""
    pitch: float = 0.12
    """From marker to marker [m]."""
    family: str = DEFAULT_FAMILY
    """Of the markers."""

    def __post_init__(self) -> None:
        """Check that the markers fit, and make the pose read-only."""
        object.__setattr__(self, "X_WK", frozen_array(self.X_WK, (4, 4), "pose of a card"))
        quiet = self.side * (1.0 + 2.0 / FiducialFamily(self.family).cells)
        if not (self.columns >= 1 and self.rows >= 1 and 0.0 < quiet <= self.pitch):
            raise ValueError(
                f"a card needs markers with a white cell around each, got {self.columns}x"
                f"{self.rows} of {self.side:g} m every {self.pitch:g} m"
            )

    @property
    def ids(self) -> range:
        """Ids of its markers."""
        return range(self.first, self.first + self.columns * self.rows)

    @property
    def p_KT(self) -> NDArray:
        """Middles of its markers on the card [m]. Shape (n, 3)."""
        across = self.pitch * (np.arange(self.columns) - 0.5 * (self.columns - 1))
        up = self.pitch * np.arange(self.rows)
        return np.array([(x, y, 0.0) for x in across for y in up])

    @property
    def p_WT(self) -> NDArray:
        """Middles of its markers where it hangs [m]. Shape (n, 3)."""
        return apply(self.X_WK, self.p_KT)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the card [m]."""
        return self.columns * self.pitch, self.rows * self.pitch

    @property
    def middle(self) -> NDArray:
        """Middle of the card in its frame [m]. Shape (3,)."""
        return np.array([0.0, 0.5 * (self.rows - 1) * self.pitch, 0.0])


def markers_of(cards: Sequence[TagCard]) -> dict[str, tuple[int, NDArray]]:
    """Return id and place [m] of every marker of some cards by name: `card0_0`, `card0_1`, ..."""
    return {
        f"card{c}_{k}": (marker, p)
        for c, card in enumerate(cards)
        for k, (marker, p) in enumerate(zip(card.ids, card.p_WT, strict=True))
    }
