"""Detectors of many markers of one family that share one search of each picture."""

from collections.abc import Mapping

from numpy.typing import NDArray

from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.tracking.hand_tracker import Detector, Detectors
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial import Fiducial, FiducialSearch
from nico_selfmodel.vision.markers.fiducial_behind_lens import (
    center_behind_lens,
    corners_behind_lens,
)
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily


def fiducial_detectors(
    centers: Mapping[str, int],
    corners: Mapping[str, int] | None = None,
    *,
    family: str = DEFAULT_FAMILY,
    rig: StereoRig | None = None,
) -> Detectors:
    """Return detectors of square markers, which search a picture once for all.

    Args:
        centers: Name -> id of markers whose centres are wanted.
        corners: The same of those whose corners are: `corner_names` of each name.
        family: Their family.
        rig: The calibrated cameras, whose lenses are then taken out before points are located.

    Raises:
        ValueError: If there is no such family or id.
    """
    known, wanted = FiducialFamily(family), dict[str, tuple[int, int | None]]()
    wanted |= {name: (marker, None) for name, marker in centers.items()}
    for name, marker in (corners or {}).items():
        wanted |= {own: (marker, k) for k, own in enumerate(corner_names(name))}
    for marker, _ in wanted.values():
        known.pattern(marker)
    cameras = (None, None) if rig is None else rig.cameras
    left, right = (_SharedSearch(family, camera) for camera in cameras)
    return {name: (left.of(*which), right.of(*which)) for name, which in wanted.items()}


def corner_names(marker: str) -> tuple[str, ...]:
    """Return names of a marker's corners, clockwise from the printed top left."""
    return tuple(f"{marker}_{k}" for k in range(4))


class _SharedSearch:
    """Remembers what it found in the picture that it was shown last."""

    def __init__(self, family: str, camera: Camera | None) -> None:
        self._family, self._camera = family, camera
        self._image: NDArray | None = None
        self._found = FiducialSearch(family, (), "")
        self._located: dict[int, NDArray | NotSeen] = {}

    def of(self, marker: int, corner: int | None) -> Detector:
        """Return what finds the centre of one marker, or one of its corners."""

        def detect(image: NDArray) -> NDArray | NotSeen:
            if image is not self._image:
                self._found = FiducialSearch.of(image, self._family, mirrors=False)
                self._image, self._located = image, {}
            found = self._found.one(marker, mirrored=False)
            if isinstance(found, NotSeen):
                return found
            if corner is None:
                return self._center(image, found)
            if marker not in self._located:
                self._located[marker] = self._corners(image, found)
            corners = self._located[marker]
            return corners if isinstance(corners, NotSeen) else corners[corner]

        return detect

    def _center(self, image: NDArray, found: Fiducial) -> NDArray | NotSeen:
        if self._camera is None:
            return found.center
        return center_behind_lens(image, found, self._camera)

    def _corners(self, image: NDArray, found: Fiducial) -> NDArray | NotSeen:
        if self._camera is None:
            return found.corners
        return corners_behind_lens(image, found, self._camera)
