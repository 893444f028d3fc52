"""Families of square fiducial markers: their names and their patterns."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.names import refuse_unknown

_APRILTAG = "apriltag_"
DEFAULT_FAMILY = f"{_APRILTAG}36h11"
_FIRST_36H11 = 0xD5D628584
"""Cells of its tag 0, row by row, 1 where white: from the AprilTag library's `tag36h11.c`."""
ERROR_CORRECTION = 0.6
"""Share of the wrong cells that a family could put right, that is put right: OpenCV's default."""


def _opencv_names() -> dict[str, int]:
    names = {}
    for tag in ("16h5", "25h9", "36h10", "36h11"):
        names[f"{_APRILTAG}{tag}"] = getattr(cv2.aruco, f"DICT_APRILTAG_{tag}")
    for bits in (4, 5, 6, 7):
        for count in (50, 100, 250, 1000):
            size = f"{bits}X{bits}_{count}"
            names[f"aruco_{size.lower()}"] = getattr(cv2.aruco, f"DICT_{size}")
    names["aruco_mip_36h12"] = cv2.aruco.DICT_ARUCO_MIP_36h12
    names["aruco_original"] = cv2.aruco.DICT_ARUCO_ORIGINAL
    return names


_FAMILIES = _opencv_names()


@dataclass(frozen=True)
class FiducialFamily:
    """A set of markers that are told apart by their cells."""

    name: str
    """One of `FiducialFamily.names()`."""

    def __post_init__(self) -> None:
        """Refuse names that do not exist."""
        refuse_unknown("marker family", self.name, _FAMILIES)

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of all families."""
        return tuple(_FAMILIES)

    @property
    def dictionary(self) -> cv2.aruco.Dictionary:
        """OpenCV's object."""
        return _dictionary(self.name)

    @property
    def count(self) -> int:
        """How many markers there are; ids run from 0."""
        return len(self.dictionary.bytesList)

    @property
    def cells(self) -> int:
        """Cells along a side, with the black border, which is one cell wide."""
        return int(self.dictionary.markerSize) + 2

    def pattern(self, marker: int, border: int = 1) -> NDArray:
        """Return a marker's cells, True where white.

        Args:
            border: Width of the black border [cells].

        Returns:
            Shape (cells, cells), the border included; a wider one makes it larger.

        Raises:
            ValueError: If the family has no such id.
        """
        if not 0 <= marker < self.count:
            raise ValueError(f"{self.name} has the ids 0 to {self.count - 1}, got {marker}")
        cells = self.cells + 2 * (border - 1)
        return cv2.aruco.generateImageMarker(self.dictionary, marker, cells, borderBits=border) > 0

    def upright(self, marker: int, border: int = 1) -> NDArray:
        """Return a marker's cells as the AprilTag library prints them, whatever OpenCV does.

        Args and returns as `pattern`; families of others are as OpenCV has them.
        """
        cells = self.pattern(marker, border)
        turned = self.name.startswith(_APRILTAG) and _half_a_turn_on()
        return cells[::-1, ::-1] if turned else cells

    @property
    def mirror_twins(self) -> frozenset[int]:
        """Ids that look in a mirror like a marker of this family, so that nobody can tell."""
        return _mirror_twins(self.name)


@cache
def _half_a_turn_on() -> bool:
    """Tell whether OpenCV's AprilTags are turned round against those of their own library."""
    inner = FiducialFamily(f"{_APRILTAG}36h11").pattern(0)[1:-1, 1:-1]
    first = np.array([int(bit) for bit in f"{_FIRST_36H11:036b}"]).reshape(6, 6) > 0
    return bool((inner[::-1, ::-1] == first).all())


@cache
def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(_FAMILIES[name])


@cache
def _mirror_twins(name: str) -> frozenset[int]:
    family = FiducialFamily(name)
    inner = np.stack([family.pattern(i)[1:-1, 1:-1] for i in range(family.count)])
    signs = 2.0 * inner - 1.0
    turned = np.concatenate([np.rot90(signs, k, (1, 2)) for k in range(4)])
    mirrored = signs[:, :, ::-1].reshape(len(signs), -1)
    agreement = mirrored @ turned.reshape(len(turned), -1).T
    distance = 0.5 * (mirrored.shape[1] - agreement.max(axis=1))
    corrected = int(family.dictionary.maxCorrectionBits * ERROR_CORRECTION)
    return frozenset(int(i) for i in np.flatnonzero(distance <= corrected))
