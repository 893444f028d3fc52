"""Surfaces made of triangles: normals, neighbours, parts, distances."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import read_only

_AT_ONCE = 2_000_000
"""Distances that are worked out at once."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles whose corners turn counter-clockwise for whoever looks at them from outside."""

    vertices: NDArray
    """[m]. Shape (V, 3)."""
    triangles: NDArray
    """Numbers of vertices. Shape (T, 3)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the arrays read-only."""
        vertices = np.asarray(self.vertices, dtype=float)
        triangles = np.asarray(self.triangles, dtype=int)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
            raise ValueError(f"vertices must be finite, of shape (V, 3), got {vertices.shape}")
        if triangles.ndim != 2 or triangles.shape[1] != 3:
            raise ValueError(f"triangles must have shape (T, 3), got {triangles.shape}")
        if triangles.size and not (triangles.min() >= 0 and triangles.max() < len(vertices)):
            raise ValueError(
                f"triangles must name vertices from 0 to {len(vertices) - 1}, got "
                f"{triangles.min()} to {triangles.max()}"
            )
        object.__setattr__(self, "vertices", read_only(vertices))
        object.__setattr__(self, "triangles", read_only(triangles))

    @cached_property
    def normals(self) -> NDArray:
        """Outward normals at the vertices, of unit length; weighted by areas. Shape (V, 3)."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        found = np.zeros_like(self.vertices)
        for k in range(3):
            np.add.at(found, self.triangles[:, k], across)
        return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)

    @cached_property
    def edges(self) -> NDArray:
        """Pairs of neighbouring vertices, each once. Shape (E, 2)."""
        pairs = self.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        return np.unique(np.sort(pairs, axis=1), axis=0)

    @cached_property
    def parts(self) -> NDArray:
        """Number of the connected part of each vertex, from 0. Shape (V,)."""
        own = np.arange(len(self.vertices))
        first, second = self.edges.T
        while True:
            least = np.minimum(own[first], own[second])
            before = own.copy()
            np.minimum.at(own, first, least)
            np.minimum.at(own, second, least)
            own = own[own]
            if np.array_equal(own, before):
                return np.unique(own, return_inverse=True)[1]

    def moved(self, vertices: ArrayLike) -> "TriangleMesh":
        """Return the same triangles with vertices elsewhere. Shape (V, 3)."""
        return TriangleMesh(np.asarray(vertices, dtype=float), self.triangles)

    def of_vertices(self, kept: NDArray) -> "TriangleMesh":
        """Return the triangles of which all corners are kept, and these corners alone.

        Args:
            kept: Truth values; those of no triangle go as well. Shape (V,).
        """
        triangles = self.triangles[kept[self.triangles].all(axis=1)]
        used, inverse = np.unique(triangles, return_inverse=True)
        return TriangleMesh(self.vertices[used], inverse.reshape(-1, 3))

    def used(self, kept: NDArray) -> NDArray:
        """Return the numbers of the vertices that `of_vertices` leaves, in order. (V',)."""
        return np.unique(self.triangles[kept[self.triangles].all(axis=1)])

    def distance(self, p_WQ: ArrayLike) -> NDArray:
        """Return how far points are from the nearest place of the surface [m].

        Shape (N, 3) -> (N,).

        Raises:
            ValueError: If there is no triangle.
        """
        points = np.asarray(p_WQ, dtype=float)
        if not len(self.triangles):
            raise ValueError("a mesh without triangles is nowhere")
        corners = self.vertices[self.triangles]
        step = max(1, _AT_ONCE // len(corners))
        parts = [_to_triangles(points[k : k + step], corners) for k in range(0, len(points), step)]
        return np.concatenate([np.zeros(0), *parts])


def _to_triangles(points: NDArray, corners: NDArray) -> NDArray:
    """Return the distance of each point to the nearest triangle. Shapes (N, 3), (T, 3, 3)."""
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    ap = points[:, None] - a
    # Within: barycentric coordinates of the foot on the plane, all positive.
    bb, bc, cc = (np.sum(x * y, axis=1) for x, y in ((ab, ab), (ab, ac), (ac, ac)))
    pb, pc = np.einsum("ntk,tk->nt", ap, ab), np.einsum("ntk,tk->nt", ap, ac)
    scale = np.maximum(bb * cc - bc**2, 1e-30)
    v, w = (cc * pb - bc * pc) / scale, (bb * pc - bc * pb) / scale
    foot = ap - v[..., None] * ab - w[..., None] * ac
    within = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    square = np.where(within, np.sum(foot**2, axis=2), np.inf)
    for k in range(3):
        start, way = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        p = points[:, None] - start
        length = np.maximum(np.sum(way**2, axis=1), 1e-30)
        t = np.clip(np.einsum("ntk,tk->nt", p, way) / length, 0.0, 1.0)
        square = np.minimum(square, np.sum((p - t[..., None] * way) ** 2, axis=2))
    return np.sqrt(square.min(axis=1))
