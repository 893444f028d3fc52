"""A surface and the mirrors that show it, refined until every picture shows the same colours.

Vertices move along their normals and mirrors by their values, by what the pictures tell
(`picture_equations`), what the hand told of the mirrors before, and how smooth a surface is
expected to be (`fair_surface`); first by blurred pictures, which lead from farther away.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.shape.fair_surface import FairSurface, Neighbours
from nico_selfmodel.estimation.shape.picture_equations import PictureEquations
from nico_selfmodel.estimation.shape.shape_views import ShapeViews
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.model.cameras.mirror import Mirror

BLURS = (
    (4.0, False),
    (4.0, False),
    (3.0, False),
    (3.0, True),
    (2.0, True),
    (1.5, True),
    (1.0, True),
)
"""Blur of the pictures in each step [px], and whether mirrors move in it."""
BEND_SIGMA = 1e-3
"""By how much a surface bends otherwise than nearby, over an edge of a mesh [m]."""
_FARTHEST = 6e-3
"""That a vertex moves in one step [m]."""
_SAMPLES, _STEPS = 16, 80
"""From which standard deviations are estimated, and steps of conjugate gradients for them."""


@dataclass(frozen=True, eq=False)
class RefinedSurface:
    """What a refinement ends with."""

    mesh: TriangleMesh
    """The surface."""
    sigma: NDArray
    """Of each vertex along its normal [m]. Shape (V,)."""
    colors: NDArray
    """BGR, nan where no picture shows a vertex. Shape (V, 3)."""
    looks: NDArray
    """Pictures that show each vertex, or its outline. Shape (V,)."""
    mirrors: tuple[Mirror, ...]
    """As the body tells them."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("sigma", "colors", "looks"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def refine_surface(
    mesh: TriangleMesh,
    blurred: Callable[[float], ShapeViews],
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> RefinedSurface:
    """Move vertices along their normals, and the mirrors, until all pictures agree.

    Args:
        mesh: Where the surface is about: to 5 mm or so, where it has no edges to follow.
        blurred: The pictures, blurred by a Gaussian [px]; mirrors as the hand told them.
        rng: Source of samples of what is not known.
        progress: Called after each step.
    """
    neighbours, before = Neighbours.of(mesh), blurred(BLURS[0][0])
    values = before.values
    for k, (blur, free) in enumerate(BLURS):
        found = PictureEquations.of(mesh, blurred(blur).placed(values))
        fair = FairSurface.of(mesh, neighbours, BEND_SIGMA)
        step = fair.solved(found.own, (found.pull + fair.pull)[:, None])[:, 0]
        step = np.clip(step, -_FARTHEST, _FARTHEST)
        mesh = mesh.moved(mesh.vertices + step[:, None] * mesh.normals)
        if free:
            values = values + _moved(before, values, found, step)
        if progress:
            progress(k + 1, len(BLURS))
    placed = before.placed(values)
    found = PictureEquations.of(mesh, blurred(BLURS[-1][0]).placed(values))
    fair = FairSurface.of(mesh, neighbours, BEND_SIGMA)
    sigma = _sigma(found, fair, before.covariance, rng)
    return RefinedSurface(mesh, sigma, found.colors, found.looks, placed.mirrors)


def _moved(before: ShapeViews, values: NDArray, found: PictureEquations, step: NDArray) -> NDArray:
    """Return what mirrors move by after a step of the surface; cameras are held. Shape (3 M,).

    Each moves by itself: what pictures tell of mirrors together they overstate, see `_sigma`.
    """
    pull = found.values_pull - found.coupling.T @ step
    off, change = before.values - values, []
    for k in range(len(before.mirrors)):
        own = slice(3 * k, 3 * k + 3)
        known = np.linalg.inv(before.covariance[own, own])
        information = found.values[own, own] + known
        change.append(np.linalg.solve(information, pull[own] + known @ off[own]))
    return np.concatenate(change)


def _sigma(
    found: PictureEquations, fair: FairSurface, covariance: NDArray, rng: np.random.Generator
) -> NDArray:
    """Return the standard deviations of vertices along their normals [m]. Shape (V,).

    With A = D + M' M / tau^2, A^-1 (D^(1/2) e + M' f / tau) has the covariance A^-1, which grows
    with the chi-square of the colours about a vertex. Where mirrors and cameras are wrong by y, the
    pictures ask the surface for - A^-1 C y more, with C the coupling: with P the covariance of y

        sigma^2 = chi^2 diag(A^-1) + diag(A^-1 C P C' A^-1)

    P is what the hand tells. The pictures move the mirrors, too, but what they are wrong by is
    alike in many places, so that they know less of what all mirrors have alike than they say.

    Args:
        found: What the pictures tell of the surface.
        fair: How smooth it is.
        covariance: P. Shape (3 M + c, 3 M + c).
        rng: Source of e and f.
    """
    size = len(found.own)
    noise = rng.standard_normal((2, size, _SAMPLES))
    right = np.sqrt(found.own)[:, None] * noise[0] + fair.unbent(noise[1]) / fair.tau
    drawn = fair.solved(found.own, right, _STEPS)
    smooth = fair.neighbours.smoothed
    alone = smooth(np.mean(drawn**2, axis=1), 3)
    agreeing = np.maximum(1.0, smooth(np.minimum(found.chi_square, 30.0), 2))
    by_value = fair.solved(found.own, found.coupling, _STEPS)
    common = np.einsum("vi,ij,vj->v", by_value, covariance, by_value)
    return np.sqrt(agreeing * alone + common)
