"""Where a simulated robot's cameras really see its surface: for who paints marks and judges."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.solids.solid import (
    Solid,
    distance_to_solids,
    normals_of_solids,
    onto_solids,
)
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.plant.link_surfaces import LinkSurface

UNSEEN = "?"
"""What is said of pixels to which a lens sends no light."""
_TRIED = 3000
"""Pixels that are followed at first."""
_SAME = 1e-3
"""Two lines of sight that end as near to each other end at one place [m]."""
_NARROWEST = 1.0
"""What looks narrower than a pixel is not seen [px]."""
_OFF = 0.03
"""What is this near to a camera belongs to it [m]."""


@dataclass(frozen=True, eq=False)
class SeenPlaces:
    """Places of the surface that cameras see."""

    links: tuple[str, ...]
    """Of each place."""
    p_FQ: NDArray
    """Places in the frames of these links [m]. Shape (N, 3)."""


class SeenSurface:
    """All that is to be seen before two cameras and a mirror, in the left camera's frame."""

    def __init__(
        self,
        surfaces: Mapping[str, tuple[LinkSurface, NDArray]],
        rig: StereoRig,
        mirror: Plane | None,
        cases: Sequence[str] = ("left_eye", "right_eye", "eyes"),
    ) -> None:
        """Pose everything.

        Args:
            surfaces: Link -> its surface and its pose in the left camera's frame.
            rig: The cameras, in that frame.
            mirror: The glass, in that frame, if there is one.
            cases: Links around the cameras, which hide nothing from them directly.
        """
        self._poses = {link: X_LF for link, (_, X_LF) in surfaces.items()}
        self._links: list[str] = []
        self._solids: list[Solid] = []
        for link, (surface, X_LF) in surfaces.items():
            self._solids += [Solid(s.kind, s.size, X_LF @ s.X_FS) for s in surface.solids]
            self._links += [link] * len(surface.solids)
        self._rig, self._mirror, self._cases = rig, mirror, set(cases)

    def in_mirror(
        self,
        links: Sequence[str],
        count: int,
        rng: np.random.Generator,
        across: float = 0.0,
        *,
        directly: bool = False,
    ) -> SeenPlaces:
        """Return places that both cameras see in the mirror and neither sees directly, or both do.

        They are drawn evenly over the left camera's picture.

        Args:
            count: How many at most.
            across: Diameter of what is put there: a disc that lies so flat to a line of sight that
                it looks narrower than a pixel in the mirror is not seen [m].
            directly: Whether both cameras see them directly, too; else neither does.
        """
        p_LQ, on = self._followed(links, rng, True)
        for camera in self._rig.cameras:
            kept = self._sees(camera, p_LQ, True) & (self._sees(camera, p_LQ, False) == directly)
            if across:
                kept[kept] = self._width(camera, p_LQ[kept], across) >= _NARROWEST
            p_LQ, on = p_LQ[kept], on[kept]
        return self._placed(p_LQ[:count], on[:count])

    def directly(self, links: Sequence[str], count: int, rng: np.random.Generator) -> SeenPlaces:
        """Return places that both cameras see directly, drawn as in a mirror.

        Args:
            count: How many at most.
        """
        p_LQ, on = self._followed(links, rng, False)
        for camera in self._rig.cameras:
            kept = self._sees(camera, p_LQ, False)
            p_LQ, on = p_LQ[kept], on[kept]
        return self._placed(p_LQ[:count], on[:count])

    def shown(self, camera: Camera, pixels: NDArray) -> NDArray:
        """Return which link each pixel of a camera shows directly.

        Args:
            pixels: Shape (N, 2).

        Returns:
            Names, empty where it shows something else, `UNSEEN` where no line of sight belongs to
            it. Shape (N,).
        """
        ways = camera.directions(pixels) @ camera.X_WC[:3, :3].T
        there = np.flatnonzero(np.isfinite(ways).all(axis=1))
        start, ways = camera.X_WC[:3, 3], ways[there]
        p_LQ = onto_solids(self._solids, self._before_glass(start, ways, False), ways)
        met = np.isfinite(p_LQ).all(axis=1)
        on = distance_to_solids(self._solids, p_LQ[met])[1]
        found = np.full(len(pixels), UNSEEN, dtype=object)
        found[there] = ""
        found[there[met]] = [self._links[k] for k in on]
        return found

    @property
    def _glass(self) -> Plane:
        assert self._mirror is not None, "what is seen in a mirror takes one"
        return self._mirror

    def _placed(self, p_LQ: NDArray, on: NDArray) -> SeenPlaces:
        names = tuple(self._links[k] for k in on)
        own = [
            apply(inverse(self._poses[link]), p[None])[0]
            for link, p in zip(names, p_LQ, strict=True)
        ]
        return SeenPlaces(names, np.reshape(own, (-1, 3)))

    def _followed(
        self, links: Sequence[str], rng: np.random.Generator, mirrored: bool
    ) -> tuple[NDArray, NDArray]:
        """Follow random pixels of the left camera to what they show. Shapes (N, 3) and (N,)."""
        camera = self._rig.left
        pixels = rng.uniform(0.0, np.array(camera.image_size) - 1.0, (_TRIED, 2))
        ways = camera.directions(pixels) @ camera.X_WC[:3, :3].T
        ways = ways[np.isfinite(ways).all(axis=1)]
        start = camera.X_WC[:3, 3]
        if mirrored:
            ways = ways - 2.0 * (ways @ self._glass.normal)[:, None] * self._glass.normal
            start = reflect(self._glass, start)
        p_LQ = onto_solids(self._solids, self._before_glass(start, ways, mirrored), ways)
        met = np.flatnonzero(np.isfinite(p_LQ).all(axis=1))
        on = distance_to_solids(self._solids, p_LQ[met])[1]
        wanted = np.isin([self._links[k] for k in on], list(links))
        return p_LQ[met[wanted]], on[wanted]

    def _before_glass(self, start: NDArray, ways: NDArray, mirrored: bool) -> NDArray:
        """Return where lines from a twin leave the glass; of a camera, a little before it."""
        if not mirrored:
            return start + _OFF * ways
        speed = ways @ self._glass.normal
        with np.errstate(divide="ignore"):
            far = np.where(speed > 1e-6, -self._glass.distance_to(start) / speed, np.nan)
        return np.nan_to_num(start + far[:, None] * ways, nan=1e3)

    def _sees(self, camera: Camera, p_LQ: NDArray, mirrored: bool) -> NDArray:
        """Return which places a camera sees, directly or in the mirror. Shape (N,)."""
        if not len(p_LQ):
            return np.zeros(0, dtype=bool)
        shown = reflect(self._glass, p_LQ) if mirrored else p_LQ
        with np.errstate(invalid="ignore"):
            pixels = camera.project(shown)
            inside = ((pixels > 0.0) & (pixels < np.array(camera.image_size) - 1.0)).all(axis=1)
        start = camera.X_WC[:3, 3]
        # What turns its back is not seen, and the search would start inside it.
        center = reflect(self._glass, start) if mirrored else start
        normals = normals_of_solids(self._solids, p_LQ)
        inside &= np.sum((center - p_LQ) * normals, axis=1) > 0.0
        first = self._open(center, p_LQ, mirrored)
        if mirrored:
            first &= self._open(start, shown, False)
        return inside & first

    def _width(self, camera: Camera, p_LQ: NDArray, across: float) -> NDArray:
        """Return how wide discs look in the mirror, along their narrow side [px]. Shape (N,)."""
        ways = reflect(self._glass, camera.X_WC[:3, 3]) - p_LQ
        slant = np.sum(ways * normals_of_solids(self._solids, p_LQ), axis=1)
        return camera.fx * across * slant / np.sum(ways * ways, axis=1)

    def _open(self, start: NDArray, ends: NDArray, mirrored: bool) -> NDArray:
        """Return between which points nothing stands. Shape (N,)."""
        ways = ends - start
        length = np.linalg.norm(ways, axis=1)
        ways = ways / length[:, None]
        met = onto_solids(self._solids, self._before_glass(start, ways, mirrored), ways)
        apart = np.linalg.norm(met - start, axis=1)
        return ~(apart < length - _SAME)
