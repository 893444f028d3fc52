"""What boards with tags have in common: a part of one will do."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.names import listed
from nico_selfmodel.vision.boards.board_detection import BoardDetection, Ink
from nico_selfmodel.vision.boards.exact_corners import FEWEST, exact_corners, seen_count
from nico_selfmodel.vision.boards.tag_layout import layout_of, lie_on
from nico_selfmodel.vision.images.image_array import detectable
from nico_selfmodel.vision.images.not_seen import NotSeen, OtherBoard
from nico_selfmodel.vision.markers.fiducial_family import FiducialFamily
from nico_selfmodel.vision.markers.tags_seen import TagsSeen

_EDGE = 0.5
"""What of an edge next to a corner reaches beyond it [px]."""
_LARGEST = 16
"""Columns below which those of a board are guessed, for a hint."""


@dataclass(frozen=True)
class TaggedBoard(ABC):
    """A board whose tags have the ids from 0."""

    columns: int
    """In a row, at least 2: of a ChArUco board inner corners, of an AprilGrid tags."""
    rows: int
    """In a column, at least 2."""
    square: float
    """Side of a square; of an AprilGrid from a tag's edge to the same edge of the next [m]."""
    tag: float
    """Side of a tag's black square [m]."""
    family: str
    """Of its tags."""

    def __post_init__(self) -> None:
        """Refuse boards that cannot be."""
        if self.columns < 2 or self.rows < 2:
            raise ValueError(f"a board with tags is at least 2x2 large, got {self}")
        if not 0.0 < self.tag < self.square < np.inf:
            raise ValueError(
                f"the tags of a board are smaller than its squares, got {1e3 * self.tag:g} mm in "
                f"squares of {1e3 * self.square:g} mm"
            )
        there_are = FiducialFamily(self.family).count
        if self.count > there_are:
            raise ValueError(f"{self} needs {self.count} tags, {self.family} has {there_are}")

    @property
    @abstractmethod
    def count(self) -> int:
        """How many tags it carries."""
        ...

    @property
    @abstractmethod
    def points(self) -> NDArray:
        """The points in the board's frame, z = 0 [m]. Shape (P, 3)."""
        ...

    @property
    @abstractmethod
    def tag_corners(self) -> NDArray:
        """Corners of every tag, clockwise from its upper left [m]. Shape (T, 4, 2)."""
        ...

    @property
    @abstractmethod
    def ink(self) -> Ink:
        """What is printed."""
        ...

    @property
    def facts(self) -> dict[str, Any]:
        """What `result.json` tells of the board."""
        return {
            "board": str(self),
            "square_mm": 1e3 * self.square,
            "tag_mm": 1e3 * self.tag,
            "family": self.family,
        }

    def same_order(self, left: NDArray, right: NDArray) -> NDArray:
        """Return `right`: tags tell the order."""
        del left
        return right

    def find(self, image: NDArray, window: int) -> BoardDetection | NotSeen:
        """Find the corners that are plain to see, as `AnyBoard.find`.

        Raises:
            ValueError: If the image has another shape or type.
        """
        gray = detectable(image)
        tags = self._tags(gray)
        further = self._further_rows(tags)
        if further:
            return OtherBoard(further)
        problem = tags.problem_with(range(self.count))
        if problem:
            return NotSeen(problem)
        printed = self._as_printed(tags)
        found = max(
            (printed._located(gray, rough, window) for rough in self._rough(gray, tags)),
            key=seen_count,
        )
        if seen_count(found) < FEWEST:
            return NotSeen(
                f"{len(tags.ids)} tags but only {seen_count(found)} corners of a {self} board are "
                f"plain to see{self._other_layout(tags)}"
            )
        problem = self._problem_with(found)
        if problem:
            return NotSeen(problem)
        return BoardDetection(self, read_only(found), self._method, None)

    def _as_printed(self, tags: TagsSeen) -> "TaggedBoard":
        """Return the board with what its tags tell of their print."""
        del tags
        return self

    def _problem_with(self, found: NDArray) -> str | None:
        """Say why exact corners cannot be the board's; None where they can. Shape (P, 2)."""
        del found
        return None

    def _further_rows(self, tags: TagsSeen) -> str | None:
        """Say that tags lie on the board's grid beyond the rows that were stated."""
        foreign = [tag for tag in tags.ids if tag >= self.count]
        if not foreign:
            return None
        rows = self.rows + int(np.ceil((max(foreign) + 1 - self.count) * self.rows / self.count))
        try:
            corners = replace(self, rows=rows).tag_corners
        except ValueError:  # tags of a robot's own, beyond those of any board
            return None
        if not lie_on(corners, tags, foreign):
            return None
        tags_lie = f"tag {foreign[0]} lies" if len(foreign) == 1 else f"tags {listed(foreign)} lie"
        there = f"{tags_lie} beyond the {self.rows} rows of {self}, on its grid"
        return f"{there}: the board is larger than stated"

    def _other_layout(self, tags: TagsSeen) -> str:
        """Say as on a board of how many columns tags lie, if of another number."""
        # Tags tell nothing of rows that are not seen: as many as the family has tags for.
        columns = [number for number in range(2, _LARGEST) if number != self.columns]
        most = FiducialFamily(self.family).count
        others = [replace(self, columns=n, rows=max(most // (n + 1) - 1, 2)) for n in columns]
        found = layout_of([self, *others], _tag_corners, tags)
        if found is None or found is self:
            return ""
        return f"; the tags lie as on a board of {found.columns} columns"

    def _located(self, gray: NDArray, rough: NDArray, window: int) -> NDArray:
        """Return exact corners. Shape (P, 2)."""
        try:
            return exact_corners(self.points[:, :2], gray, rough, self._room, window)
        except ValueError:  # on one line
            return np.full_like(rough, np.nan)

    def _room(self, maps: NDArray) -> NDArray:
        return self._clear(maps) - _EDGE

    @property
    @abstractmethod
    def _method(self) -> str:
        """OpenCV's detector."""
        ...

    @abstractmethod
    def _clear(self, maps: NDArray) -> NDArray:
        """Return how far from corners there is nothing else [px].

        Args:
            maps: Pixels of a metre along x and y of the board, as columns. Shape (P, 2, 2).
        """
        ...

    @abstractmethod
    def _tags(self, gray: NDArray) -> TagsSeen:
        """Return the tags in an image."""
        ...

    @abstractmethod
    def _rough(self, gray: NDArray, tags: TagsSeen) -> Sequence[NDArray]:
        """Return corners as the tags tell them, nan elsewhere, for each way to print the board.

        Shapes (P, 2).
        """
        ...


def _tag_corners(board: TaggedBoard) -> NDArray:
    return board.tag_corners
