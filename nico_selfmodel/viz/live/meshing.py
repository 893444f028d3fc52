"""Triangles of the shapes that no viewer has of its own."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.viz.scene.scene_items import Item, Markers, Needles, Surface, Triad, Tube

_MANY = 150
"""More markers or needles than this are made of fewer triangles each."""
_SIDES = 6
_NEEDLE_SIDES, _FEW_SIDES = 5, 3
TRIAD_COLORS = np.array([[0.84, 0.19, 0.15], [0.10, 0.60, 0.31], [0.17, 0.35, 0.80]])


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in the frame of their item."""

    vertices: NDArray
    """[m]. Shape (v, 3)."""
    faces: NDArray
    """Indices of vertices, anticlockwise from outside. Shape (f, 3)."""
    colors: NDArray | None
    """Red, green, blue of each vertex; None where all have the item's. Shape (v, 3)."""


def mesh_of(item: Item) -> TriangleMesh:
    """Return the triangles of markers, needles, a tube, a triad or a surface.

    Raises:
        TypeError: If the item is of another kind.
    """
    if isinstance(item, Markers):
        return _markers(item)
    if isinstance(item, Needles):
        return _needles(item)
    if isinstance(item, Tube):
        return _tube(item.points, item.radius, item.closed)
    if isinstance(item, Triad):
        return _triad(item)
    if isinstance(item, Surface):
        return TriangleMesh(item.vertices, item.faces, item.colors)
    raise TypeError(f"a {type(item).__name__} is no mesh: viewers have it of their own")


def _markers(item: Markers) -> TriangleMesh:
    vertices, faces = _octahedron()
    if item.shape == "sphere":
        vertices, faces = _icosahedron()
        if len(item.centers) <= _MANY:
            vertices, faces = _subdivided(vertices, faces)
    count = len(item.centers)
    placed = item.centers[:, None] + item.radius * vertices
    indices = np.arange(count)[:, None, None] * len(vertices) + faces
    colors = None if item.colors is None else np.repeat(item.colors, len(vertices), axis=0)
    return TriangleMesh(placed.reshape(-1, 3), indices.reshape(-1, 3), colors)


def _needles(item: Needles) -> TriangleMesh:
    along = item.ends - item.starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    # A vector of no length still gets a direction; its needle is then a flat dot.
    unit = np.where(length > 0.0, along / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
    basis = np.swapaxes(tangent_basis(unit), 1, 2)
    count = _NEEDLE_SIDES if len(along) <= _MANY else _FEW_SIDES
    rim = item.starts[:, None] + item.radius * _ring(count) @ basis
    vertices = np.concatenate([rim, item.ends[:, None]], axis=1)
    k = np.arange(count)
    sides = np.stack([k, (k + 1) % count, np.full_like(k, count)], axis=1)
    cap = np.stack([np.zeros_like(k[2:]), k[2:], k[1:-1]], axis=1)
    faces = np.concatenate([sides, cap])
    indices = np.arange(len(vertices))[:, None, None] * (count + 1) + faces
    colors = None if item.colors is None else np.repeat(item.colors, count + 1, axis=0)
    return TriangleMesh(vertices.reshape(-1, 3), indices.reshape(-1, 3), colors)


def _tube(points: NDArray, radius: float, closed: bool) -> TriangleMesh:
    """Sweep a ring along points, its zero direction carried without twist."""
    ahead, behind = np.roll(points, -1, axis=0), np.roll(points, 1, axis=0)
    if not closed:
        ahead[-1], behind[0] = points[-1], points[0]
    tangent = ahead - behind
    tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    first = tangent_basis(tangent[0])[:, 0]
    rings = []
    for point, direction in zip(points, tangent, strict=True):
        first = first - (first @ direction) * direction
        first = first / np.linalg.norm(first)
        basis = np.stack([first, np.cross(direction, first)])
        rings.append(point + radius * _ring(_SIDES) @ basis)
    count = len(points) if closed else len(points) - 1
    i, k = np.meshgrid(np.arange(count), np.arange(_SIDES), indexing="ij")
    j, m = (i + 1) % len(points), (k + 1) % _SIDES
    near, far = i * _SIDES, j * _SIDES
    a, b, c, d = (x.ravel() for x in (near + k, near + m, far + m, far + k))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return TriangleMesh(np.concatenate(rings), faces, None)


def _triad(item: Triad) -> TriangleMesh:
    ends = item.length * np.eye(3)
    axes = [_tube(np.stack([np.zeros(3), end]), item.radius, False) for end in ends]
    size = len(axes[0].vertices)
    return TriangleMesh(
        np.concatenate([axis.vertices for axis in axes]),
        np.concatenate([axis.faces + k * size for k, axis in enumerate(axes)]),
        np.repeat(TRIAD_COLORS, size, axis=0),
    )


def _ring(sides: int) -> NDArray:
    """Return points on the unit circle. Shape (sides, 2)."""
    angle = np.arange(sides) * (2.0 * np.pi / sides)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _octahedron() -> tuple[NDArray, NDArray]:
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    x, y, z, nx, ny, nz = range(6)
    faces = [(x, y, z), (y, nx, z), (nx, ny, z), (ny, x, z)]
    faces += [(y, x, nz), (nx, y, nz), (ny, nx, nz), (x, ny, nz)]
    return vertices, np.array(faces)


def _icosahedron() -> tuple[NDArray, NDArray]:
    t = 0.5 * (1.0 + np.sqrt(5.0))
    plane = np.array([(-1, t, 0), (1, t, 0), (-1, -t, 0), (1, -t, 0)])
    vertices = np.concatenate([plane, np.roll(plane, 1, axis=1), np.roll(plane, 2, axis=1)])
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4)]
    faces += [(11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8)]
    faces += [(3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    return vertices / np.linalg.norm(vertices[0]), np.array(faces)


def _subdivided(vertices: NDArray, faces: NDArray) -> tuple[NDArray, NDArray]:
    """Split every triangle of a unit sphere into four."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    middle = vertices[unique].sum(axis=1)
    middle = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (index.ravel() + len(vertices)).reshape(3, -1)
    a, b, c = faces.T
    split = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([vertices, middle]), np.concatenate([np.stack(s, axis=1) for s in split])
