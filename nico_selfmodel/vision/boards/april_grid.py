"""AprilGrids, as Kalibr prints them: tags with a black square between their corners.

Each corner of a tag touches the corner of a black square, a crossing of two edges like that of a
chessboard. The detector of tags takes what touches for one shape, so that the light is first
widened by a pixel or two. Format: Kalibr's wiki, "Calibration targets": tags from the lower left,
row by row; here the picture's rows run the same way as the board's y. Kalibr prints tags as their
own library does; OpenCV before its fifth version, and 5.0.0, has them half a turn on (its pull
request 28823), and who prints a grid with it, too: boards are found either way.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.homography import apply_homography
from nico_selfmodel.vision.boards.board_detection import Ink, cells_of
from nico_selfmodel.vision.boards.exact_corners import between_lines
from nico_selfmodel.vision.boards.tag_layout import wrong_tag
from nico_selfmodel.vision.boards.tagged_board import TaggedBoard
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily
from nico_selfmodel.vision.markers.tags_seen import TagsSeen, seen_tags

METHOD = "ArucoDetector"
_SURE = 4
"""Tags of one width of border below which others are looked for, too."""
_NEAR = 6
"""Neighbours that tell where a tag must be; the median of them, so that some may be wrong."""
BORDERS = (2, 1)
"""Widths of the tags' black border [cells]: Kalibr's, and what other programs print."""
_OFF = 0.35
"""Share of a tag by which its neighbours' homography may miss a corner: a wrong id misses by
more."""


@dataclass(frozen=True)
class AprilGrid(TaggedBoard):
    """A grid of tags, by how many there are.

    `square` is Kalibr's tagSize (1 + tagSpacing), `tag` its tagSize.
    """

    family: str = DEFAULT_FAMILY
    """Of the tags."""
    border: int = BORDERS[0]
    """Width of their black border [cells]; seen in a picture, whatever is said here."""

    def __str__(self) -> str:
        return f"aprilgrid:{self.columns}x{self.rows}"

    @property
    def count(self) -> int:
        """How many tags it carries."""
        return self.columns * self.rows

    @property
    def points(self) -> NDArray:
        """The tags' corners, z = 0 [m]. Shape (4 columns rows, 3).

        Tag by tag from the board's lower left, x to the right and y down the printed page as
        everywhere here; of each tag clockwise from its upper left.
        """
        flat = self.tag_corners.reshape(-1, 2)
        return np.column_stack([flat, np.zeros(len(flat))])

    @property
    def tag_corners(self) -> NDArray:
        """Corners of every tag [m]. Shape (T, 4, 2)."""
        across, up = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        low = np.stack([across.ravel(), self.rows - 1 - up.ravel()], axis=1) * self.square
        corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) * self.tag
        return np.asarray(low[:, None] + corners)

    @property
    def ink(self) -> Ink:
        """What is printed: the tags, and the squares between their corners."""
        gap = self.square - self.tag
        across, down = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        corners = np.stack([across.ravel(), down.ravel()], axis=1) * self.square - gap
        squares = np.column_stack([corners, np.full((len(corners), 2), gap)])
        family = FiducialFamily(self.family)
        tags = [
            cells_of(family.upright(tag, self.border), self.tag_corners[tag, 0], self.tag)
            for tag in range(self.count)
        ]
        return Ink.of_blocks(squares, *tags)

    @property
    def _method(self) -> str:
        return METHOD

    def _clear(self, maps: NDArray) -> NDArray:
        """Nothing lies between lines on either side, the far edges of what touches."""
        cells = FiducialFamily(self.family).cells + 2 * (self.border - 1)
        clear = min(self.square - self.tag, self.border / cells * self.tag)
        return between_lines(clear * maps)

    def _tags(self, gray: NDArray) -> TagsSeen:
        found = [seen_tags(gray, self.family, BORDERS[0], apart=False)]
        if len(found[0].ids) < _SURE:  # by chance one is read where there is none
            found += [seen_tags(gray, self.family, width, apart=False) for width in BORDERS[1:]]
        return max(found, key=lambda tags: len(tags.ids))

    def _as_printed(self, tags: TagsSeen) -> TaggedBoard:
        return replace(self, border=tags.border)

    def _rough(self, gray: NDArray, tags: TagsSeen) -> list[NDArray]:
        del gray
        own = tags.among(range(self.count))
        turned = replace(own, corners=np.roll(own.corners, 2, axis=1))
        return [self._agreeing(own), self._agreeing(turned)]

    def _problem_with(self, found: NDArray) -> str | None:
        return wrong_tag(self.tag_corners, self.tag, found.reshape(-1, 4, 2))

    def _agreeing(self, tags: TagsSeen) -> NDArray:
        """Return corners of the tags that lie where the others have them. Shape (P, 2).

        Of two tags each must lie where both have it.
        """
        rough = np.full((4 * self.count, 2), np.nan)
        for tag, corners in zip(tags.ids, tags.corners, strict=True):
            rough[4 * tag : 4 * tag + 4] = corners
        points, seen = self.points[:, :2].reshape(-1, 4, 2), rough.reshape(-1, 4, 2).copy()
        ids = np.array(tags.ids)
        if len(ids) < 2:
            return rough
        few = len(ids) == 2
        for tag in tags.ids:
            away = np.linalg.norm(points[ids, 0] - points[tag, 0], axis=1)
            near = ids if few else ids[np.argsort(away)[1 : _NEAR + 1]]
            flat = (points[near].reshape(-1, 2), seen[near].reshape(-1, 2))
            H, _ = cv2.findHomography(*flat, 0 if few else cv2.LMEDS)
            side = np.linalg.norm(seen[tag, 0] - seen[tag, 1])
            off = np.inf
            if H is not None:
                off = np.abs(apply_homography(H, points[tag]) - seen[tag]).max()
            if not off <= max(_OFF * side, 4.0):
                rough[4 * tag : 4 * tag + 4] = np.nan
        return rough
