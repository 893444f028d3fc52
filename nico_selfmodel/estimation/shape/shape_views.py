"""What both cameras saw of a body in many looks, and what of a surface each picture shows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.estimation.shape.standpoints import Standpoint
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.cameras.mirror_rig import projected
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
    """One camera's picture in one look."""

    look: int
    """Which look."""
    side: int
    """Which camera, 0 or 1."""
    picture: NDArray
    """BGR. Shape (h, w, 3)."""
    beyond: NDArray
    """How far a pixel is outside of the body, nan where that is not known [px]. Shape (h, w)."""
    loose: float = 0.0
    """By what the body's place in the picture may be off, beside the outline's own error [px]."""
    corner: tuple[int, int] = (0, 0)
    """Column and row of the camera's picture in which this one begins [px]."""


@dataclass(frozen=True, eq=False)
class ShapeViews:
    """All pictures, the cameras, and what is between these and the shape in each look."""

    views: tuple[ShapeView, ...]
    """The pictures."""
    rig: StereoRig
    """The cameras; the left one is W."""
    standpoints: tuple[Standpoint, ...]
    """Mirrors or poses of a link, as they are known, one a look."""
    cameras: tuple[str, ...]
    """What of the rig may be wrong, of its `names`; c of them."""
    covariance: NDArray
    """Of all standpoints' values in turn, K of them, and of these, before the pictures. Shape
    (K + c, K + c)."""

    @property
    def values(self) -> NDArray:
        """Of all standpoints in turn. Shape (K,)."""
        return np.concatenate([one.values for one in self.standpoints])

    @property
    def parts(self) -> tuple[slice, ...]:
        """Where the values of each standpoint are among all."""
        ends = np.cumsum([0, *(len(one.values) for one in self.standpoints)]).tolist()
        return tuple(slice(start, end) for start, end in pairwise(ends))

    @property
    def beside_the_frame(self) -> NDArray:
        """What takes off errors of values that are one motion of the link's frame in all poses.

        A shape is told in that frame, which is where the poses have it in the mean: of K poses with
        v_k = E_k m for a motion m in the frame, 1 - E E' / K. Shape (K + c, K + c).
        """
        moved = [
            (part, one.R_WF)
            for one, part in zip(self.standpoints, self.parts, strict=True)
            if one.R_WF is not None
        ]
        E = np.zeros((len(self.covariance), 6))
        for part, R_WF in moved:
            E[part] = np.kron(np.eye(2), R_WF)
        return np.eye(len(E)) - E @ E.T / max(len(moved), 1)

    @property
    def lit_alike(self) -> list[list[int]]:
        """Numbers of the pictures in which a place has one colour, for it is lit alike."""
        still, turned = [], {}
        for k, view in enumerate(self.views):
            if self.standpoints[view.look].turns_light:
                turned.setdefault(view.look, []).append(k)
            else:
                still.append(k)
        return [group for group in (still, *turned.values()) if group]

    def placed(self, values: NDArray) -> "ShapeViews":
        """Return the same pictures with standpoints elsewhere, by their `values`."""
        both = zip(self.standpoints, self.parts, strict=True)
        return replace(self, standpoints=tuple(one.at(values[part]) for one, part in both))

    def only(self, looks: Sequence[int]) -> "ShapeViews":
        """Return some of the looks, numbered anew."""
        number = {look: k for k, look in enumerate(looks)}
        kept = np.concatenate(
            [np.arange(self.parts[look].start, self.parts[look].stop) for look in looks]
            + [np.arange(self.parts[-1].stop, len(self.covariance))]
        )
        views = [replace(v, look=number[v.look]) for v in self.views if v.look in number]
        return replace(
            self,
            views=tuple(views),
            standpoints=tuple(self.standpoints[look] for look in looks),
            covariance=self.covariance[np.ix_(kept, kept)],
        )

    def part(self, view: ShapeView) -> NDArray:
        """Return which of what the covariance is of a picture depends on. Shape (k + c,)."""
        count = self.parts[-1].stop
        own = self.parts[view.look]
        return np.r_[own.start : own.stop, count : count + len(self.cameras)]

    def pixels(self, p_FQ: NDArray) -> list[NDArray]:
        """Return where each picture shows points, from its corner. Shape (N, 3) -> (N, 2) each."""
        both = [self.rig.project(one.seen_at(p_FQ)) for one in self.standpoints]
        return [both[v.look][:, 2 * v.side : 2 * v.side + 2] - v.corner for v in self.views]

    def slopes(self, p_FQ: NDArray) -> list[tuple[NDArray, NDArray]]:
        """Return how their pixels move by points, (N, 2, 3), standpoint and cameras, (N, 2, k + c).

        As the chain rule has it: a pixel moves with the place at which a point seems to be.
        """
        each = [self._slopes(one, p_FQ) for one in self.standpoints]
        found = []
        for v in self.views:
            own = slice(2 * v.side, 2 * v.side + 2)
            found.append((each[v.look][0][:, own], each[v.look][1][:, own]))
        return found

    def _slopes(self, standpoint: Standpoint, p_FQ: NDArray) -> tuple[NDArray, NDArray]:
        """Return the slopes of both cameras' pixels in one look. (N, 4, 3) and (N, 4, k + c)."""
        places = standpoint.seen_at(p_FQ)
        # What cannot be seen needs no slopes, and is taken to be somewhere before the cameras.
        places = np.where(np.isfinite(places), places, self.rig.left.X_WC[:3, 2])
        by_place = projected(self.rig.cameras, places)[1]
        by_point, by_value = standpoint.slopes(p_FQ)
        p_LQ = apply(self.rig.left.X_CW, places)
        by_rig = project_to_cameras(p_LQ.T, self.rig.values, self.rig.lenses)[2]
        by_camera = by_rig[[self.rig.names.index(name) for name in self.cameras]].transpose(2, 1, 0)
        return by_place @ by_point, np.concatenate([by_place @ by_value, by_camera], axis=2)

    def centers(self) -> NDArray:
        """Return from where the cameras seem to look [m]. Shape (views, 3)."""
        cameras = self.rig.cameras
        return np.array(
            [self.standpoints[v.look].seen_from(cameras[v.side].X_WC[:3, 3]) for v in self.views]
        )

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


def slope_of(image: NDArray, pixels: NDArray) -> NDArray:
    """Return the slopes of an image by u and v between pixels, from neighbours on both sides.

    Args:
        image: Shape (h, w) or (h, w, c).
        pixels: u and v. Shape (N, 2).

    Returns:
        nan next to the picture's edge. Shape (N, 2) or (N, c, 2).
    """
    sides = [[sampled(image, pixels + s * step) for s in (1.0, -1.0)] for step in np.eye(2)]
    return np.stack([0.5 * (after - before) for after, before in sides], axis=-1)


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
