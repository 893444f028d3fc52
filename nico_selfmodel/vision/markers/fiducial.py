"""Square fiducial markers: which, where, and whether in a mirror."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.geometry.homography import apply_homography, homography, marker_center
from nico_selfmodel.names import TAGS_OF_ONE_ID
from nico_selfmodel.vision.images.image_array import detectable, reduced
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily
from nico_selfmodel.vision.markers.marker_edges import corners_from_edges
from nico_selfmodel.vision.markers.tags_seen import MOST_READ, read_tags


@dataclass(frozen=True, eq=False)
class Fiducial:
    """A marker that was seen."""

    family: str
    """Name of its family."""
    id: int
    """Its number in the family."""
    corners: NDArray
    """Corners of the black square [px], clockwise on the printed marker from its top left. Seen in
    a mirror they run the other way round in the image. Shape (4, 2)."""
    center: NDArray
    """Image of the marker's centre [px]: where the diagonals meet. Shape (2,)."""
    mirrored: bool
    """True if this is a reflection."""


@dataclass(frozen=True, eq=False)
class FiducialSearch:
    """What was found in one image, to be asked for one marker after the other."""

    family: str
    """Name of the family that was looked for."""
    seen: tuple[Fiducial, ...]
    """Its markers, direct ones first, by id."""
    blurred: str
    """In words, what was read but not located; empty if nothing."""

    @classmethod
    def of(
        cls, image: NDArray, family: FiducialFamily | str = DEFAULT_FAMILY, *, mirrors: bool = True
    ) -> "FiducialSearch":
        """Find all markers of a family, those that are seen in a mirror too.

        OpenCV finds and reads the markers; the corners are then located from the edges (OpenCV's
        own refinement of AprilTags is off by 0.45 px). Reflections are read in the flipped image.
        An image of up to 8 megapixels in which nothing is found is searched again at twice its
        size, which small markers need. A marker in `FiducialFamily.mirror_twins` counts as seen
        directly.

        Args:
            image: Grey or BGR, 8 bits. Shape (h, w) or (h, w, 3).
            mirrors: Look for reflections too, which takes about twice the time.

        Raises:
            ValueError: If the image has another shape or type, or there is no such family.
        """
        family = _family(family)
        return cls(family.name, *_search(detectable(image), family, mirrors=mirrors))

    @property
    def found(self) -> tuple[Fiducial, ...] | NotSeen:
        """All markers, or why there is none."""
        return self.seen or self._none(f"{self.family} marker")

    def one(self, marker: int | None = None, *, mirrored: bool | None = None) -> Fiducial | NotSeen:
        """Return one marker, or why there is none or no telling which.

        Args:
            marker: Its id; None if there is only one marker to see.
            mirrored: Whether to look for a reflection; None if either will do.

        Raises:
            ValueError: If the family has no such id.
        """
        if marker is not None:
            FiducialFamily(self.family).pattern(marker)
        seen = self.seen
        wanted = [
            item
            for item in seen
            if marker in (None, item.id) and (mirrored is None or item.mirrored == mirrored)
        ]
        if len(wanted) == 1:
            return wanted[0]
        if marker is not None and of_one_id(wanted):
            return NotSeen(f"marker {marker} is at two places at once: {TAGS_OF_ONE_ID}")
        if wanted:
            return NotSeen(f"{_names(wanted)} were seen: say which one is meant")
        what = f"{self.family} marker" + ("" if marker is None else f" {marker}")
        what += {None: "", True: " in a mirror", False: " outside a mirror"}[mirrored]
        return self._none(what + (f"; {_names(seen)} seen" if seen else ""))

    def _none(self, what: str) -> NotSeen:
        return NotSeen(f"no {what}" + (f"; {self.blurred}" if self.blurred else ""))


def of_one_id(seen: Iterable[Fiducial]) -> tuple[int, ...]:
    """Return ids that are at two places at once; one tag may be in several mirrors."""
    ids = [item.id for item in seen if not item.mirrored]
    return tuple(sorted({one for one in ids if ids.count(one) > 1}))


def _family(family: FiducialFamily | str) -> FiducialFamily:
    return FiducialFamily(family) if isinstance(family, str) else family


def _names(markers: tuple[Fiducial, ...] | list[Fiducial]) -> str:
    return ", ".join(f"{m.id}{' (mirrored)' if m.mirrored else ''}" for m in markers)


def _search(
    gray: NDArray, family: FiducialFamily, *, mirrors: bool
) -> tuple[tuple[Fiducial, ...], str]:
    """Return the markers of an image and its reflection, and what was read but not located."""
    direct, vague = _in_image(gray, family, mirrored=False)
    flipped: list[Fiducial] = []
    if mirrors:
        reflection = np.ascontiguousarray(gray[:, ::-1])
        flipped, vague_in_mirror = _in_image(reflection, family, mirrored=True)
        vague += vague_in_mirror
    kept = [d for d in direct if not any(_wins(gray, r, d) for r in _overlapping(d, flipped))]
    kept += [item for item in flipped if not _overlapping(item, kept)]
    ids = ", ".join(str(marker) for marker in sorted(set(vague)))
    return tuple(kept), f"the edges of {ids} are not plain to see" if vague else ""


def _in_image(
    gray: NDArray, family: FiducialFamily, *, mirrored: bool
) -> tuple[list[Fiducial], list[int]]:
    """Return the markers of one image, and the ids of those whose edges are not plain to see."""
    found: list[Fiducial] = []
    vague = []
    for marker, rough in _read(gray, family):
        corners = corners_from_edges(gray, rough, family.cells)
        if corners is None:
            vague.append(marker)
            continue
        if mirrored:
            corners[:, 0] = (gray.shape[1] - 1) - corners[:, 0]
        center = marker_center(corners)
        fiducial = Fiducial(family.name, marker, read_only(corners), read_only(center), mirrored)
        if not any(other.id == marker for other in _overlapping(fiducial, found)):
            found.append(fiducial)
    return sorted(found, key=lambda item: item.id), vague


def _read(gray: NDArray, family: FiducialFamily) -> list[tuple[int, NDArray]]:
    """Return ids and rough corners, of small ones too."""
    copy, scale = reduced(gray, MOST_READ)
    for enlarged in (1, 2) if scale == 1.0 else (1,):
        fine = cv2.resize(copy, None, fx=enlarged, fy=enlarged) if enlarged > 1 else copy
        size = scale / enlarged  # of a pixel that was read
        tags = read_tags(fine, family.name)
        if tags:
            return [(tag, (corners + 0.5) * size - 0.5) for tag, corners in tags]
    return []


def _overlapping(one: Fiducial, others: list[Fiducial]) -> list[Fiducial]:
    """Return those of many markers that lie where one does."""
    if not others:
        return []
    away = np.linalg.norm(np.array([other.center for other in others]) - one.center, axis=1)
    size = np.linalg.norm(one.corners[0] - one.corners[2])
    return [others[k] for k in np.flatnonzero(away < 0.2 * size)]


def _wins(gray: NDArray, reflection: Fiducial, direct: Fiducial) -> bool:
    """Tell whether a place is rather a reflection, where noise let it be read both ways."""
    return _wrong_cells(gray, reflection) < _wrong_cells(gray, direct)


def _wrong_cells(gray: NDArray, fiducial: Fiducial) -> int:
    family = FiducialFamily(fiducial.family)
    pattern, n = family.pattern(fiducial.id), family.cells
    across, down = np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5)
    square = np.array([[0.0, 0], [n, 0], [n, n], [0, n]])
    H = homography(square, fiducial.corners)
    pixels = apply_homography(H, np.column_stack([across.ravel(), down.ravel()]))
    u, v = np.rint(pixels).astype(int).T
    height, width = gray.shape
    values = gray[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)].astype(float)
    white = pattern.ravel()
    middle = 0.5 * (values[white].mean() + values[~white].mean())
    return int(np.count_nonzero((values > middle) != white))
