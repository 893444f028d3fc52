"""The surface where a signed distance on a grid is zero, by surface nets.

Each cell of eight points whose signs differ gets one vertex, the mean of where the distance passes
through zero along its edges (Gibson 1998); four cells about an edge with a change of sign make two
triangles. The vertex then goes to where the distance between the points is zero,
v - T(v) grad T / |grad T|^2, no farther than half a cell. Where a point is not known there is
neither surface nor empty space: the surface ends.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.geometry.voxel_grid import VoxelGrid

_EDGES = tuple(
    (start, axis) for axis in range(3) for start in np.ndindex(2, 2, 2) if start[axis] == 0
)
"""Corner at which an edge of a cell starts, and its axis."""


def surface_nets(grid: VoxelGrid, distance: NDArray) -> TriangleMesh:
    """Return the surface on which a signed distance is zero.

    Args:
        grid: Where the distance is given.
        distance: Positive outside; nan where it is not known [m]. Shape `grid.shape`.

    Returns:
        Triangles, counter-clockwise from outside.

    Raises:
        ValueError: If the distance has another shape than the grid.
    """
    if distance.shape != grid.shape:
        raise ValueError(f"distance must have shape {grid.shape}, got {distance.shape}")
    corners = {corner: _shifted(distance, corner) for corner in np.ndindex(2, 2, 2)}
    stack = np.stack(list(corners.values()))
    with np.errstate(invalid="ignore"):
        active = np.isfinite(stack).all(axis=0) & (stack.min(axis=0) < 0.0)
        active &= stack.max(axis=0) >= 0.0
    number = np.full(active.shape, -1)
    number[active] = np.arange(np.count_nonzero(active))
    cells = np.argwhere(active)
    middle = cells + _crossings({k: v[active] for k, v in corners.items()})
    vertices = _onto_zero(grid, distance, grid.place(middle))
    return TriangleMesh(vertices, _triangles(distance, number))


def _shifted(values: NDArray, corner: tuple[int, ...]) -> NDArray:
    """Return the values at one corner of each cell."""
    return values[tuple(slice(c, n - 1 + c) for c, n in zip(corner, values.shape, strict=True))]


def _crossings(corners: dict[tuple[int, ...], NDArray]) -> NDArray:
    """Return the mean of where the edges of cells pass through zero, in cells. Shape (N, 3)."""
    count = len(next(iter(corners.values())))
    total, number = np.zeros((count, 3)), np.zeros(count)
    for start, axis in _EDGES:
        end = tuple(c + (k == axis) for k, c in enumerate(start))
        a, b = corners[start], corners[end]
        crossed = (a < 0.0) != (b < 0.0)
        share = np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0)
        place = np.tile(np.array(start, dtype=float), (count, 1))
        place[:, axis] += share
        total += crossed[:, None] * place
        number += crossed
    return total / number[:, None]


def _onto_zero(grid: VoxelGrid, distance: NDArray, p_WV: NDArray) -> NDArray:
    """Move vertices to where the distance between the points is zero. Shape (N, 3)."""
    value, slope = grid.interpolated(distance, p_WV)
    step = -value[:, None] * slope / np.maximum(np.sum(slope**2, axis=1), 1e-12)[:, None]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return p_WV + step * np.minimum(1.0, 0.5 * grid.pitch / np.maximum(length, 1e-12))


def _triangles(distance: NDArray, number: NDArray) -> NDArray:
    """Return the triangles about all edges of the grid with a change of sign. Shape (T, 3)."""
    found = [np.zeros((0, 3), dtype=int)]
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        low = np.moveaxis(distance, (axis, first, second), (0, 1, 2))
        cells = np.moveaxis(number, (axis, first, second), (0, 1, 2))
        a, b = low[:-1, 1:-1, 1:-1], low[1:, 1:-1, 1:-1]
        around = (
            cells[:, :-1, :-1], cells[:, 1:, :-1], cells[:, 1:, 1:], cells[:, :-1, 1:],
        )  # fmt: skip
        quads = np.stack(around, axis=-1)
        there = (quads >= 0).all(axis=-1)
        for inside, order in (((a < 0.0) & (b >= 0.0), 1), ((a >= 0.0) & (b < 0.0), -1)):
            quad = quads[there & inside][:, ::order]
            found += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(found)
