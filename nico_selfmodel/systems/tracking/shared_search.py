"""Detectors of many markers of one family that share one search of each picture."""

from collections.abc import Iterable, Mapping

from numpy.typing import NDArray

from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.tracking.hand_tracker import Detector, Found, MirrorDetector
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial import Fiducial, FiducialSearch
from nico_selfmodel.vision.markers.fiducial_behind_lens import behind_lens
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily


def fiducial_detectors(
    centers: Mapping[str, int],
    corners: Mapping[str, int] | None = None,
    *,
    family: str = DEFAULT_FAMILY,
    rig: StereoRig | None = None,
) -> dict[str, tuple[Detector, Detector]]:
    """Return detectors of square markers, which search a picture once for all.

    Args:
        centers: Name -> id of markers whose centres are wanted.
        corners: The same of those whose corners are: `corner_names` of each name.
        rig: The calibrated cameras, whose lenses are then taken out before points are located.

    Raises:
        ValueError: If there is no such family or id.
    """
    wanted = _wanted(centers, corners or {}, family)
    left, right = _searches(family, rig, mirrors=False)
    return {name: (left.of(*which), right.of(*which)) for name, which in wanted.items()}


def fiducials_in_mirror(
    centers: Mapping[str, int],
    corners: Mapping[str, int],
    *,
    family: str = DEFAULT_FAMILY,
    rig: StereoRig | None = None,
) -> dict[str, tuple[MirrorDetector, MirrorDetector]]:
    """Return detectors of the same, and of their reflections.

    Args:
        centers: As in `fiducial_detectors`.
        rig: The calibrated cameras, whose lenses are then taken out before points are located.

    Raises:
        ValueError: If there is no such family or id, or one looks in a mirror like another.
    """
    wanted = _wanted(centers, corners, family)
    _refuse_twins((marker for marker, _ in wanted.values()), family)
    left, right = _searches(family, rig, mirrors=True)
    return {
        name: (left.in_mirror(*which), right.in_mirror(*which)) for name, which in wanted.items()
    }


def _wanted(
    centers: Mapping[str, int], corners: Mapping[str, int], family: str
) -> dict[str, tuple[int, int | None]]:
    """Return the id of each point's marker, and which corner it is; None of its centre."""
    known, wanted = FiducialFamily(family), dict[str, tuple[int, int | None]]()
    wanted |= {name: (marker, None) for name, marker in centers.items()}
    for name, marker in corners.items():
        wanted |= {own: (marker, k) for k, own in enumerate(corner_names(name))}
    for marker, _ in wanted.values():
        known.pattern(marker)
    return wanted


def _refuse_twins(markers: Iterable[int], family: str) -> None:
    """Refuse markers that look in a mirror like one of their own family."""
    twins = FiducialFamily(family).mirror_twins
    for marker in markers:
        if marker in twins:
            raise ValueError(
                f"the reflection of marker {marker} of {family} can be read as a marker: take "
                "another"
            )


def _searches(
    family: str, rig: StereoRig | None, *, mirrors: bool
) -> "tuple[_SharedSearch, _SharedSearch]":
    cameras = (None, None) if rig is None else rig.cameras
    left, right = (_SharedSearch(family, camera, mirrors) for camera in cameras)
    return left, right


def corner_names(marker: str) -> tuple[str, ...]:
    """Return names of a marker's corners, clockwise from the printed top left."""
    return tuple(f"{marker}_{k}" for k in range(4))


class _SharedSearch:
    """Remembers what it found in the picture that it was shown last."""

    def __init__(self, family: str, camera: Camera | None, mirrors: bool) -> None:
        self._family, self._camera, self._mirrors = family, camera, mirrors
        self._image: NDArray | None = None
        self._found = FiducialSearch(family, (), "")
        self._located: dict[tuple[int, bool], Fiducial | NotSeen] = {}

    def of(self, marker: int, corner: int | None) -> Detector:
        """Return what finds the centre of one marker, or one of its corners."""
        return lambda image: self._one(image, marker, corner, mirrored=False)

    def in_mirror(self, marker: int, corner: int | None) -> MirrorDetector:
        """Return what finds the same of one marker, and of its reflection."""

        def detect(image: NDArray, expected: NDArray) -> tuple[Found, Found]:
            direct, reflected = (
                self._one(image, marker, corner, mirrored=mirrored) for mirrored in (False, True)
            )
            return direct, reflected

        return detect

    def _one(self, image: NDArray, marker: int, corner: int | None, *, mirrored: bool) -> Found:
        if image is not self._image:
            self._found = FiducialSearch.of(image, self._family, mirrors=self._mirrors)
            self._image, self._located = image, {}
        if (marker, mirrored) not in self._located:
            found = self._found.one(marker, mirrored=mirrored)
            if self._camera is not None and not isinstance(found, NotSeen):
                found = behind_lens(image, found, self._camera)
            self._located[marker, mirrored] = found
        found = self._located[marker, mirrored]
        if isinstance(found, NotSeen):
            return found
        return found.center if corner is None else found.corners[corner]
