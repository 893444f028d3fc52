"""Tags in a picture, roughly: which, and where."""

from collections.abc import Container
from dataclasses import dataclass, replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.names import listed
from nico_selfmodel.vision.images.image_array import reduced
from nico_selfmodel.vision.markers.fiducial_family import ERROR_CORRECTION, FiducialFamily

MOST_READ = 8_000_000
"""Pixels of the copy of a large image in which tags are read. The smallest one that OpenCV looks
for is a share of the image: in a large one its cells are large enough in a smaller copy."""


@dataclass(frozen=True, eq=False)
class TagsSeen:
    """Tags of one family."""

    family: str
    """Its name."""
    ids: tuple[int, ...]
    """Which were read, each once."""
    corners: NDArray
    """Corners of their black squares, clockwise from the printed top left [px]. (n, 4, 2)."""
    border: int = 1
    """Width of their black border [cells]."""

    @property
    def for_opencv(self) -> list[NDArray]:
        """The corners as OpenCV hands them on."""
        return [corners[None].astype(np.float32) for corners in self.corners]

    def problem_with(self, ids: Container[int]) -> str | None:
        """Say why these tags cannot be those of a board with some ids; None where they can."""
        if not self.ids:
            return f"no {self.family} tag"
        foreign = [str(tag) for tag in sorted(self.ids) if tag not in ids]
        if 2 * len(foreign) > len(self.ids):
            return (
                f"tags {listed(foreign, most=6)} of {self.family} are seen, which the stated board "
                "does not have"
            )
        return None

    def among(self, ids: Container[int]) -> "TagsSeen":
        """Return those of some ids."""
        kept = [k for k, tag in enumerate(self.ids) if tag in ids]
        ids = tuple(self.ids[k] for k in kept)
        return replace(self, ids=ids, corners=self.corners[kept])


def seen_tags(gray: NDArray, family: str, border: int = 1, *, apart: bool = True) -> TagsSeen:
    """Read the tags in an image.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        border: Width of the black border [cells].
        apart: Whether white surrounds each tag; tags whose corners touch black squares are first
            cut off from them, by a dilation of what is light.
    """
    copy, scale = reduced(gray, MOST_READ)
    best: dict[int, NDArray] = {}
    for cut in (0,) if apart else (1, 2, 0):
        image = copy
        if cut:
            image = cv2.dilate(copy, np.ones((2 * cut + 1,) * 2, np.uint8))
        for tag, four in read_tags(image, family, border):
            middle = four.mean(axis=0)
            # What dilation took from each side.
            grown = middle + (four - middle) * (1.0 + 2.0 * cut / _side(four))
            best.setdefault(tag, (grown + 0.5) * scale - 0.5)
    ids = tuple(sorted(best))
    stacked = np.array([best[tag] for tag in ids]).reshape(-1, 4, 2)
    return TagsSeen(family, ids, stacked, border)


def read_tags(image: NDArray, family: str, border: int = 1) -> list[tuple[int, NDArray]]:
    """Return ids and rough corners as OpenCV sees them.

    Args:
        image: 8 bits. Shape (h, w).
        border: Width of their black border [cells].
    """
    corners, ids, _ = _detector(family, border).detectMarkers(image)
    if ids is None:
        return []
    pixels = (four.reshape(4, 2).astype(float) for four in corners)
    return list(zip((int(tag) for tag in np.ravel(ids)), pixels, strict=True))


def _side(corners: NDArray) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())


@cache
def _detector(family: str, border: int) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    parameters.errorCorrectionRate = ERROR_CORRECTION
    parameters.markerBorderBits = border
    # By default the outline of the white paper is taken for the tag's own, which is then lost.
    parameters.minMarkerDistanceRate = 0.05
    return cv2.aruco.ArucoDetector(FiducialFamily(family).dictionary, parameters)
