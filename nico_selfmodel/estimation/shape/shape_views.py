"""What both cameras saw of a body in mirrors, and what of a surface each picture shows."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig, reflected_projection
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_CELL = 6.0
"""Cells in which the nearest of a surface hides what is behind it [px]."""
_BEHIND = 0.012
"""What is farther behind the nearest in a cell is hidden [m]."""
_LEAN = 0.35
"""Least cosine between normal and line of sight at which a place is looked at."""
_INSIDE = 2.0
"""How far inside of the outline [px]."""


@dataclass(frozen=True, eq=False)
class ShapeView:
    """One camera's picture in one mirror."""

    mirror: int
    """Which mirror."""
    side: int
    """Which camera, 0 or 1."""
    picture: NDArray
    """BGR. Shape (h, w, 3)."""
    beyond: NDArray
    """How far a pixel is outside of the body, nan where that is not known [px]. Shape (h, w)."""


@dataclass(frozen=True, eq=False)
class ShapeViews:
    """All pictures, the cameras and the mirrors."""

    views: tuple[ShapeView, ...]
    """The pictures."""
    rig: StereoRig
    """The cameras; the left one is W."""
    mirrors: tuple[Mirror, ...]
    """As they are known; M of them."""
    cameras: tuple[str, ...]
    """What of the rig may be wrong, of its `names`; c of them."""
    covariance: NDArray
    """Of all mirrors' values in turn and of these, before the pictures. (3 M + c, 3 M + c)."""

    @property
    def values(self) -> NDArray:
        """Of all mirrors in turn. Shape (3 M,)."""
        return np.concatenate([mirror.values for mirror in self.mirrors])

    def placed(self, values: NDArray) -> "ShapeViews":
        """Return the same pictures with mirrors elsewhere, by their `values`."""
        mirrors = [Mirror.from_values(own) for own in values.reshape(-1, 3)]
        return replace(self, mirrors=tuple(mirrors))

    def part(self, view: ShapeView) -> NDArray:
        """Return which of what the covariance is of a picture depends on. Shape (3 + c,)."""
        cameras = 3 * len(self.mirrors) + np.arange(len(self.cameras))
        return np.concatenate([3 * view.mirror + np.arange(3), cameras])

    def pixels(self, p_WQ: NDArray) -> list[NDArray]:
        """Return where each picture shows points. Shape (N, 3) -> (N, 2) each."""
        both = [MirrorRig(self.rig, mirror).project(p_WQ) for mirror in self.mirrors]
        return [both[v.mirror][:, 2 * v.side : 2 * v.side + 2] for v in self.views]

    def slopes(self, p_WQ: NDArray) -> list[tuple[NDArray, NDArray]]:
        """Return how their pixels move by points, (N, 2, 3), mirror and cameras, (N, 2, 3 + c)."""
        both = [reflected_projection(self.rig.cameras, m.values, p_WQ) for m in self.mirrors]
        by_rig = [self._by_cameras(mirror, p_WQ) for mirror in self.mirrors]
        found = []
        for v in self.views:
            own = slice(2 * v.side, 2 * v.side + 2)
            by_value = [both[v.mirror].by_mirror[:, own], by_rig[v.mirror][:, own]]
            found.append((both[v.mirror].by_point[:, own], np.concatenate(by_value, axis=2)))
        return found

    def _by_cameras(self, mirror: Mirror, p_WQ: NDArray) -> NDArray:
        """Return how pixels of reflections move by what may be wrong. Shape (N, 4, c)."""
        behind = reflect(mirror.plane_in(self.rig.left.X_WC), p_WQ)
        p_LQ = apply(self.rig.left.X_CW, behind)
        by_rig = project_to_cameras(p_LQ.T, self.rig.values, self.rig.lenses)[2]
        return by_rig[[self.rig.names.index(name) for name in self.cameras]].transpose(2, 1, 0)

    def centers(self) -> NDArray:
        """Return where the reflected cameras are [m]. Shape (views, 3)."""
        twins = [MirrorRig(self.rig, mirror).virtual.cameras for mirror in self.mirrors]
        return np.array([twins[v.mirror][v.side].X_WC[:3, 3] for v in self.views])

    def shown(self, mesh: TriangleMesh) -> NDArray:
        """Return which vertices each picture shows, turned to it, inside of the outline.

        What is before them counts by the vertices alone. Shape (views, V).
        """
        found = np.zeros((len(self.views), len(mesh.vertices)), dtype=bool)
        pixels, facing = self.pixels(mesh.vertices), self.facing(mesh)
        for k, (view, center) in enumerate(zip(self.views, self.centers(), strict=True)):
            far = np.linalg.norm(center - mesh.vertices, axis=1)
            with np.errstate(invalid="ignore"):
                inside = sampled(view.beyond, pixels[k]) < -_INSIDE
            if inside.any():
                found[k] = inside & (facing[k] > _LEAN) & ~_hidden(pixels[k], far, inside)
        return found

    def facing(self, mesh: TriangleMesh) -> NDArray:
        """Return the cosines between normals and lines of sight. Shape (views, V)."""
        ways = self.centers()[:, None] - mesh.vertices
        return np.sum(ways * mesh.normals, axis=2) / np.linalg.norm(ways, axis=2)


def sampled(image: NDArray, pixels: NDArray) -> NDArray:
    """Return values between pixels, linear; nan beyond the picture.

    OpenCV's `remap` rounds places to a thirty-second of a pixel, which steps of the refinement see.

    Args:
        image: Shape (h, w) or (h, w, c).
        pixels: u and v. Shape (N, 2).

    Returns:
        Shape (N,) or (N, c).
    """
    height, width = image.shape[:2]
    inside = _within(pixels, width, height)
    at = np.where(inside[:, None], pixels, 0.0)
    cell = np.minimum(at.astype(int), [width - 2, height - 2])
    part = at - cell
    flat = image.reshape(height * width, -1)
    first = cell[:, 1] * width + cell[:, 0]
    u, v = part[:, :1], part[:, 1:]
    upper = flat[first] * (1.0 - u) + flat[first + 1] * u
    lower = flat[first + width] * (1.0 - u) + flat[first + width + 1] * u
    found = upper * (1.0 - v) + lower * v
    found[~inside] = np.nan
    return found.reshape(len(pixels), *image.shape[2:])


def nearest_of(image: NDArray, pixels: NDArray) -> NDArray:
    """Return the values of the nearest pixels; nan beyond the picture. (N, 2) -> (N,)."""
    height, width = image.shape
    inside = _within(pixels, width, height)
    at = np.rint(np.where(inside[:, None], pixels, 0.0)).astype(int)
    return np.where(inside, image[at[:, 1], at[:, 0]], np.nan)


def _within(pixels: NDArray, width: int, height: int) -> NDArray:
    """Return which places are on a picture; nan are not. Shape (N, 2) -> (N,)."""
    last = np.array([width - 1.0, height - 1.0])
    with np.errstate(invalid="ignore"):
        on = np.logical_and(pixels >= 0.0, pixels <= last)
    return np.logical_and.reduce(on, axis=1)


def _hidden(pixels: NDArray, far: NDArray, inside: NDArray) -> NDArray:
    """Return which points have others well before them in the same cell."""
    cell = np.where(inside[:, None], pixels, 0.0) / _CELL
    cell = cell.astype(int) + 1
    nearest = np.full(cell.max(axis=0) + 2, np.inf)
    np.minimum.at(nearest, tuple(cell[inside].T), far[inside])
    around = nearest[tuple(cell.T)]
    return far > around + _BEHIND
