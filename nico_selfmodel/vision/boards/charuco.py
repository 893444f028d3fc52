"""ChArUco boards: a chessboard whose light squares carry tags, so that a part of it will do."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.boards.board_detection import Ink, cells_of, checkers, grid_points
from nico_selfmodel.vision.boards.tagged_board import TaggedBoard
from nico_selfmodel.vision.markers.fiducial_family import FiducialFamily
from nico_selfmodel.vision.markers.tags_seen import TagsSeen, seen_tags

METHOD = "CharucoDetector"


@dataclass(frozen=True)
class CharucoBoard(TaggedBoard):
    """A ChArUco board, by its *inner* corners: 8 x 6 squares have 7x5 corners.

    Its tags run row by row.
    """

    family: str = "aruco_4x4_50"
    """Of its tags."""

    def __str__(self) -> str:
        return f"charuco:{self.columns}x{self.rows}"

    @property
    def count(self) -> int:
        """How many tags it carries."""
        return (self.columns + 1) * (self.rows + 1) // 2

    @property
    def points(self) -> NDArray:
        """The inner corners, row by row, z = 0 [m]. Shape (P, 3)."""
        return grid_points(self.columns, self.rows, self.square)

    @property
    def ink(self) -> Ink:
        """What is printed, as OpenCV has drawn it since 4.6: the first square is black."""
        white = checkers(self.columns, self.rows)
        side = (self.columns + 1) * self.square
        blocks = [cells_of(white, np.full(2, -self.square), side)]
        family = FiducialFamily(self.family)
        for tag, corners in enumerate(self.tag_corners):
            blocks.append(cells_of(family.pattern(tag), corners[0], self.tag))
        return Ink.of_blocks(*blocks)

    @property
    def tag_corners(self) -> NDArray:
        """Corners of every tag [m]. Shape (T, 4, 2)."""
        row, column = np.nonzero(checkers(self.columns, self.rows))
        low = (np.stack([column, row], axis=1) - 1.0) * self.square + self._margin
        return low[:, None] + np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) * self.tag

    @property
    def _margin(self) -> float:
        """From a square's edge to its tag [m]."""
        return 0.5 * (self.square - self.tag)

    @property
    def _method(self) -> str:
        return METHOD

    def _clear(self, maps: NDArray) -> NDArray:
        """Tags lie beyond a corner and two edges of their own, in two of four quadrants."""
        found = []
        for y in (1.0, -1.0):
            to_corner = maps @ [1.0, y]
            for side in np.moveaxis(maps * [1.0, y], 2, 0):
                size = np.maximum(np.sum(side**2, axis=1), 1e-12)
                along = np.maximum(-np.sum(to_corner * side, axis=1) / size, 0.0)
                found.append(np.linalg.norm(to_corner + along[:, None] * side, axis=1))
        return self._margin * np.min(found, axis=0)

    def _tags(self, gray: NDArray) -> TagsSeen:
        return seen_tags(gray, self.family)

    def _rough(self, gray: NDArray, tags: TagsSeen) -> list[NDArray]:
        """Return corners that tags tell, for each way to print the board. Shapes (P, 2).

        Boards of OpenCV before 4.6 begin with a tag where later ones begin with a dark square; what
        is seen tells which one it is.
        """
        parameters = cv2.aruco.CharucoParameters()
        parameters.minMarkers = 1  # what one tag has wrong the other corners tell
        found = []
        for board in self._boards:
            rough = np.full((self.columns * self.rows, 2), np.nan)
            corners, ids, _, _ = cv2.aruco.CharucoDetector(board, parameters).detectBoard(
                gray, markerCorners=tags.for_opencv, markerIds=np.array(tags.ids, np.int32)
            )
            if ids is not None and len(ids):
                rough[np.ravel(ids).astype(int)] = np.reshape(corners, (-1, 2))
            found.append(rough)
        return found

    @cached_property
    def _boards(self) -> tuple[cv2.aruco.CharucoBoard, ...]:
        boards = []
        for legacy in (False, True) if self.rows % 2 else (False,):
            board = cv2.aruco.CharucoBoard(
                (self.columns + 1, self.rows + 1),
                self.square,
                self.tag,
                FiducialFamily(self.family).dictionary,
            )
            board.setLegacyPattern(legacy)
            boards.append(board)
        return tuple(boards)
