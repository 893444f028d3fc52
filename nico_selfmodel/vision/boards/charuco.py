"""ChArUco boards: a chessboard whose light squares carry tags, so that a part of it will do."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.vision.boards.board_detection import BoardDetection, Ink, cells_of
from nico_selfmodel.vision.boards.coded_corners import FEWEST, located, without_strays
from nico_selfmodel.vision.boards.tags_seen import TagsSeen, seen_tags
from nico_selfmodel.vision.images.image_array import detectable
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial_family import FiducialFamily

METHOD = "CharucoDetector"


@dataclass(frozen=True)
class CharucoBoard:
    """A ChArUco board, by its *inner* corners: 8 x 6 squares have 7x5 corners."""

    columns: int
    """Inner corners in a row, at least 2."""
    rows: int
    """Inner corners in a column, at least 2."""
    square: float
    """Side of a square [m]."""
    tag: float
    """Side of a tag's black square [m]."""
    family: str = "aruco_4x4_50"
    """Of its tags, which have the ids from 0, row by row."""

    def __post_init__(self) -> None:
        """Refuse boards that cannot be."""
        if self.columns < 2 or self.rows < 2:
            raise ValueError(f"a ChArUco board has at least 2x2 inner corners, got {self}")
        if not 0.0 < self.tag < self.square < np.inf:
            raise ValueError(
                "the tags of a ChArUco board are smaller than its squares, got "
                f"{1e3 * self.tag:g} mm in squares of {1e3 * self.square:g} mm"
            )
        if self.count > FiducialFamily(self.family).count:
            raise ValueError(
                f"{self} needs {self.count} tags, {self.family} has "
                f"{FiducialFamily(self.family).count}"
            )

    def __str__(self) -> str:
        return f"charuco:{self.columns}x{self.rows}"

    @property
    def count(self) -> int:
        """How many tags it carries."""
        return (self.columns + 1) * (self.rows + 1) // 2

    @property
    def points(self) -> NDArray:
        """The inner corners, row by row, z = 0 [m]. Shape (P, 3)."""
        across, down = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        flat = np.stack([across, down, np.zeros_like(across)], axis=-1).reshape(-1, 3)
        return flat * self.square

    @property
    def ink(self) -> Ink:
        """What is printed, as OpenCV has drawn it since 4.6: the first square is black."""
        white = np.indices((self.rows + 1, self.columns + 1)).sum(axis=0) % 2 == 1
        side = (self.columns + 1) * self.square
        blocks = [cells_of(white, np.full(2, -self.square), side)]
        gap = 0.5 * (self.square - self.tag)
        family = FiducialFamily(self.family)
        for tag, (row, column) in enumerate(np.argwhere(white)):
            corner = np.array([column - 1.0, row - 1.0]) * self.square + gap
            blocks.append(cells_of(family.pattern(tag), corner, self.tag))
        return Ink.of_blocks(*blocks)

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

        Boards of OpenCV before 4.6 begin with a tag where later ones begin with a dark square; what
        is seen tells which one it is.

        Raises:
            ValueError: If the image has another shape or type.
        """
        gray = detectable(image)
        tags = seen_tags(gray, self.family)
        problem = tags.problem_with(range(self.count))
        if problem:
            return NotSeen(problem)
        found = max(
            (self._corners(gray, tags, board, window) for board in self._boards),
            key=lambda corners: np.count_nonzero(np.isfinite(corners[:, 0])),
        )
        count = int(np.count_nonzero(np.isfinite(found[:, 0])))
        if count < FEWEST:
            return NotSeen(
                f"{len(tags.ids)} tags but only {count} corners of a {self} board are plain to see"
            )
        return BoardDetection(self, read_only(found), METHOD, None)

    def _corners(
        self, gray: NDArray, tags: TagsSeen, board: cv2.aruco.CharucoBoard, window: int
    ) -> NDArray:
        """Return the corners that tags around them tell. Shape (P, 2)."""
        rough = np.full((self.columns * self.rows, 2), np.nan)
        parameters = cv2.aruco.CharucoParameters()
        parameters.minMarkers = 1  # what one tag has wrong the other corners tell
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board, parameters).detectBoard(
            gray, markerCorners=tags.for_opencv, markerIds=np.array(tags.ids, np.int32)
        )
        if ids is None or not len(ids):
            return rough
        rough[np.ravel(ids).astype(int)] = np.reshape(corners, (-1, 2))
        # Nothing but the corner lies nearer than the nearest tag's.
        gap = 0.5 * (self.square - self.tag)
        scale = tags.pixels_per_side(rough) / self.tag
        exact = located(gray, rough, gap * scale, window)
        return without_strays(self.points, exact, (gray.shape[1], gray.shape[0]))[0]

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
