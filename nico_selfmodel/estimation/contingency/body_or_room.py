"""Body against room: what stands still in the picture while the cameras turn, turns with them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only

ODDS = 100.0
"""Odds at which a cell is told."""
CHANGES = 0.05, 0.9
"""How often what shows something looks otherwise after a turn: of the body, which stands still but
for what is half hidden, and of the room, which seldom looks alike elsewhere."""


@dataclass(frozen=True, eq=False)
class BodyOrRoom:
    """What each cell of a picture shows."""

    log_odds: NDArray
    """Of body against room; 0 where nothing tells. Shape (rows, columns)."""

    def __post_init__(self) -> None:
        """Make the array read-only."""
        object.__setattr__(self, "log_odds", read_only(self.log_odds, float))

    @property
    def body(self) -> NDArray:
        """Cells that are told to show the body. Boolean, shape (rows, columns)."""
        return np.asarray(self.log_odds >= np.log(ODDS))

    @property
    def room(self) -> NDArray:
        """Cells that are told to show something else. Boolean, shape (rows, columns)."""
        return np.asarray(self.log_odds <= -np.log(ODDS))


def tell_body(shows: NDArray, changed: NDArray) -> BodyOrRoom:
    """Tell body from room by which cells look otherwise after a joint has turned the cameras.

    What a joint carries along with the cameras stands still in their pictures while it turns, and
    nothing else does (chapter 10 of the thesis asks for a model of what one's motion does). With c
    changes in n turns of a cell that shows something the log odds are those of two coins,

        c log(p_b / p_r) + (n - c) log((1 - p_b) / (1 - p_r)),    p = `CHANGES`,

    and it is told at `ODDS` to 1.

    Args:
        shows: Whether a cell shows something, turn by turn. Boolean, shape (K, rows, columns).
        changed: Whether it looks otherwise then. Boolean, shape (K, rows, columns).

    Raises:
        ValueError: If they differ in shape.
    """
    shows, changed = np.asarray(shows, dtype=bool), np.asarray(changed, dtype=bool)
    if shows.shape != changed.shape or shows.ndim != 3:
        raise ValueError(
            "shows and changed must have one shape (K, rows, columns), got "
            f"{shows.shape} and {changed.shape}"
        )
    (body, room), turns = CHANGES, shows.sum(axis=0)
    often = (shows & changed).sum(axis=0)
    still = (turns - often) * np.log((1.0 - body) / (1.0 - room))
    return BodyOrRoom(often * np.log(body / room) + still)
