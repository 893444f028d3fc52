"""A first surface of a link, from outlines and depths of many looks.

Where at least two pictures show the room, nothing stands. Elsewhere depths are fused into a signed
distance (Curless and Levoy 1996)

    T = t sum w clip(s / t, -1, 1) / sum w,    w = 1 / s_Z^2

with s how far a place is before what a camera saw there, no farther behind it than t, and s_Z the
standard deviation of that depth, which grows with its square. Places of which nothing tells stay
unknown: the surface ends there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.shape.shape_views import ShapeViews, nearest_of
from nico_selfmodel.geometry.surface_nets import surface_nets
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.geometry.voxel_grid import VoxelGrid
from nico_selfmodel.model.cameras.camera import Camera

_BEYOND = 1.5
"""What a picture shows so far outside of the outline is empty [px]."""
_LOOSE = 2.0
"""Standard deviations of a body's place that count with it."""
_EMPTY = 2
"""Looks that must show a place to be empty."""
_CUT = 4.0
"""t: how far about a surface distances count, in pitches of the voxels."""
_FEWEST = 1.5
"""Least weight of a fused distance, in depths seen from `_TYPICAL`."""
_TYPICAL = 0.6
"""How far away a body in a mirror seems to be [m]."""
_PART = 300
"""Vertices of a part that is no speck."""


@dataclass(frozen=True, eq=False)
class DepthView:
    """How far away what a camera saw in a look seems to be."""

    look: int
    """Which look."""
    camera: Camera
    """A real one, without a lens."""
    depth: NDArray
    """Along its axis, nan where not known [m]. Shape (h, w)."""


def first_surface(
    grid: VoxelGrid, wanted: NDArray, views: ShapeViews, depths: Sequence[DepthView]
) -> TriangleMesh:
    """Return the surface that outlines and depths tell.

    Args:
        grid: Where to look.
        wanted: Which of its points. Shape (points,).
        depths: In some or all of the looks.

    Raises:
        EstimationError: If no surface is found.
    """
    index = np.flatnonzero(wanted)
    points = grid.points[index]
    cut = _CUT * grid.pitch
    distance = _fused(points, views, depths, cut)
    empty = _emptied(points, views)
    # What outlines carve away is outside whatever the depths say, and its wall is a surface.
    floor = np.where(np.isfinite(distance), 0.5 * grid.pitch, cut)
    distance = np.where(empty, np.fmax(distance, floor), distance)
    field = np.full(grid.shape, np.nan)
    field.ravel()[index] = distance
    mesh = surface_nets(grid, field)
    sizes = np.bincount(mesh.parts, minlength=1) if len(mesh.vertices) else np.zeros(1)
    if sizes.max() < _PART:
        raise EstimationError(
            f"the pictures of {len(views.standpoints)} looks show no surface: is the body in view "
            "in them, and does the room look otherwise than the body?"
        )
    return mesh.of_vertices(sizes[mesh.parts] >= _PART)


def _emptied(points: NDArray, views: ShapeViews) -> NDArray:
    """Return which places some looks show to be empty. Shape (N,)."""
    shown = np.zeros((len(views.standpoints), len(points)), dtype=bool)
    for view, pixels in zip(views.views, views.pixels(points), strict=True):
        with np.errstate(invalid="ignore"):
            outside = nearest_of(view.beyond, pixels) > _BEYOND + _LOOSE * view.loose
        shown[view.look] |= outside
    return shown.sum(axis=0) >= _EMPTY


def _fused(points: NDArray, views: ShapeViews, depths: Sequence[DepthView], cut: float) -> NDArray:
    """Return the fused signed distance, nan where nothing tells it [m]. Shape (N,)."""
    top, total = np.zeros(len(points)), np.zeros(len(points))
    for one in depths:
        places = views.standpoints[one.look].seen_at(points)
        far = apply(one.camera.X_CW, places)[:, 2]
        with np.errstate(invalid="ignore"):
            before = nearest_of(one.depth, one.camera.project(places)) - far
            told = before > -cut
        weight = far[told] ** -4.0
        top[told] += weight * np.minimum(before[told] / cut, 1.0)
        total[told] += weight
    known = total > _FEWEST * _TYPICAL**-4.0
    return np.where(known, cut * top / np.where(known, total, 1.0), np.nan)
