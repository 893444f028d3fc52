"""How smooth a surface is expected to be, as equations of what its vertices move by.

Along the normals of a mesh, u = n . (x - mean of the neighbours) is half of the mean curvature
times the square of an edge; it is expected to be what it is nearby,

    (u + M d - S u) / tau = 0 +- 1

with M d what a displacement d changes of u (a thin plate's operator) and S a mean over a patch.
Spheres and cylinders are thus not flattened.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.triangle_mesh import TriangleMesh

PATCH = 20
"""How often neighbours are averaged where a patch tells how it errs: over some 25 mm."""
_NEARBY = 12
"""How often they are for how a surface bends nearby."""
_CONVERGED = 1e-4
_FEW, _BENDS = 0.01, (0.2, 2.0)
"""Share of a patch that is too little to tell tau, and within what part of tau before it is looked
for."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """The neighbours of all vertices of a mesh."""

    table: NDArray
    """Their numbers, filled up with V. Shape (V, most)."""
    count: NDArray
    """How many. Shape (V,)."""

    @classmethod
    def of(cls, mesh: TriangleMesh) -> "Neighbours":
        """Collect them."""
        pairs = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
        pairs = pairs[np.argsort(pairs[:, 0], kind="stable")]
        size = len(mesh.vertices)
        count = np.bincount(pairs[:, 0], minlength=size)
        start = np.concatenate([[0], np.cumsum(count)[:-1]])
        table = np.full((size, max(1, int(count.max(initial=1)))), size)
        column = np.arange(len(pairs)) - start[pairs[:, 0]]
        table[pairs[:, 0], column] = pairs[:, 1]
        return cls(table, np.maximum(count, 1))

    def sums(self, values: NDArray) -> NDArray:
        """Return the sums over the neighbours. Shape (V, ...) -> (V, ...)."""
        padded = np.concatenate([values, np.zeros((1, *values.shape[1:]), values.dtype)])
        found = padded[self.table[:, 0]]
        for column in self.table.T[1:]:
            found = found + padded[column]
        return found

    def means(self, values: NDArray) -> NDArray:
        """Return the means over the neighbours. Shape (V, ...) -> (V, ...)."""
        return self.sums(values) / self.count.reshape(-1, *[1] * (values.ndim - 1))

    def smoothed(self, values: NDArray, times: int, weights: NDArray | None = None) -> NDArray:
        """Return values averaged with those of the neighbours, as often. Shape (V, ...)."""
        weights = np.ones(len(values)) if weights is None else weights
        top = values * weights.reshape(-1, *[1] * (values.ndim - 1))
        for _ in range(times):
            top, weights = 0.5 * (top + self.means(top)), 0.5 * (weights + self.means(weights))
        return top / np.maximum(weights, 1e-12).reshape(-1, *[1] * (values.ndim - 1))


@dataclass(frozen=True, eq=False)
class FairSurface:
    """Equations that a smooth surface fulfils."""

    neighbours: Neighbours
    """Of its mesh."""
    bend: NDArray
    """u - S u of the vertices [m]. Shape (V,)."""
    tau: NDArray
    """By how much it may be off [m]. Shape (V,)."""

    @classmethod
    def of(cls, mesh: TriangleMesh, neighbours: Neighbours, tau: NDArray) -> "FairSurface":
        """Take a surface as it is."""
        off = mesh.vertices - neighbours.means(mesh.vertices)
        u = np.sum(mesh.normals * off, axis=1)
        return cls(neighbours, u - neighbours.smoothed(u, _NEARBY), tau)

    def bent(self, x: NDArray) -> NDArray:
        """Return M x. Shape (V, k)."""
        return x - self.neighbours.means(x)

    def unbent(self, x: NDArray) -> NDArray:
        """Return M' x. Shape (V, k)."""
        return x - self.neighbours.sums(x / self.neighbours.count[:, None])

    @property
    def pull(self) -> NDArray:
        """What the equations ask displacements for. Shape (V,)."""
        return -self.unbent((self.bend / self.tau**2)[:, None])[:, 0]

    def solved(self, diagonal: NDArray, right: NDArray, steps: int = 300) -> NDArray:
        """Return the x of (diag + M' tau^-2 M) x = right, by conjugate gradients.

        Args:
            diagonal: Information of each vertex; where there is none at all, x stays near zero
                [1/m^2]. Shape (V,).
            right: Shape (V, k).
            steps: At most.
        """
        diagonal, weight = diagonal[:, None], 1.0 / self.tau[:, None] ** 2

        def apply(x: NDArray) -> NDArray:
            return diagonal * x + self.unbent(weight * self.bent(x))

        return _conjugate_gradients(apply, right, 1.0 / (diagonal + 1.2 * weight), steps)

    def drawn(
        self,
        diagonal: NDArray,
        rng: np.random.Generator,
        count: int,
        steps: int,
        worse: float | NDArray = 1.0,
    ) -> NDArray:
        """Return what a surface may be displaced by, as `solved` finds it.

        With A = D + M' tau^-2 M, and pictures chi^2 times as uncertain as D says, which smoothness
        is not, A^-1 (D^(1/2) chi e + M' tau^-1 f) has the covariance

            A^-1 (chi^2 D + M' tau^-2 M) A^-1

        Args:
            diagonal: D, as in `solved`. Shape (V,).
            steps: Of the conjugate gradients.
            worse: chi^2. Shape (V,).

        Returns:
            Shape (V, count).
        """
        e, f = rng.standard_normal((2, len(diagonal), count))
        right = np.sqrt(worse * diagonal)[:, None] * e + self.unbent(f / self.tau[:, None])
        return self.solved(diagonal, right, steps)

    def told(self, drawn: NDArray, shown: NDArray, before: float) -> NDArray:
        """Return the tau that a surface tells which fits best, another in each patch.

        With b what bends otherwise than nearby where a surface fits best, x what it may still be
        off by, and sums over what is shown of the patch about a vertex, the likeliest fulfils

            tau^2 = sum b^2 / sum (1 - E (M x)^2 / tau^2)

        (MacKay 1992, Bayesian Interpolation): where pictures tell little, a surface is smooth
        because it was expected to be, which the sum below leaves out.

        Args:
            drawn: x, as often as `drawn` drew them with the tau before. Shape (V, k).
            shown: Which vertices tell it. Shape (V,).
            before: tau where hardly any is near that tells [m].

        Returns:
            Shape (V,).
        """
        told = np.maximum(1.0 - np.mean(self.bent(drawn) ** 2, axis=1) / self.tau**2, 0.0)
        bends, known = self.neighbours.smoothed(
            np.column_stack([self.bend**2, told]) * shown[:, None], PATCH
        ).T
        tau = np.sqrt((bends + _FEW * before**2) / (known + _FEW))
        return np.clip(tau, _BENDS[0] * before, _BENDS[1] * before)


def _conjugate_gradients(
    apply: Callable[[NDArray], NDArray], right: NDArray, scale: NDArray, steps: int
) -> NDArray:
    """Solve A x = b for several b at once, each by its own conjugate gradients. (V, k) -> (V, k).

    `apply` is a symmetric, positive definite A, `scale` the inverse of its diagonal, or what is
    like it. Shape (V, 1).
    """
    x = np.zeros_like(right)
    rest = right.copy()
    z = scale * rest
    way, now = z, np.sum(rest * z, axis=0)
    start = np.maximum(now, 1e-300)
    for _ in range(steps):
        if (now <= _CONVERGED**2 * start).all():
            break
        image = apply(way)
        step = now / np.maximum(np.sum(way * image, axis=0), 1e-300)
        x += step * way
        rest -= step * image
        z = scale * rest
        then = np.sum(rest * z, axis=0)
        way, now = z + then / np.maximum(now, 1e-300) * way, then
    return x
