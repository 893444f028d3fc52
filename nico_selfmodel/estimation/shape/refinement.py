"""A surface and what shows it, refined until every picture shows the same colours.

Vertices move along their normals, and mirrors, or a link's poses, by their values, by what the
pictures tell (`picture_equations`), what the hand told of mirrors or poses before, and how smooth a
surface is expected to be (`fair_surface`); first by blurred pictures, which lead from farther away.
There mirrors are held, then each moves by what the surface leaves of its own pictures' error; in
the end surface and mirrors move at once, and what the hand told of one mirror counts for all. What
is said of mirrors here holds for the poses of a link that moves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.shape.fair_surface import PATCH, FairSurface, Neighbours
from nico_selfmodel.estimation.shape.picture_equations import PictureEquations
from nico_selfmodel.estimation.shape.shape_views import ShapeViews
from nico_selfmodel.estimation.shape.standpoints import Standpoint
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.optimization.uncertainty import inverse_of

HELD, APART, TOGETHER = "held", "apart", "together"
"""How mirrors move in a step: not, each by itself, or all at once with the surface."""


@dataclass(frozen=True)
class Step:
    """How pictures are blurred in a step, and how mirrors move."""

    levels: float
    """Blur of what is compared [px]."""
    slopes: float
    """Blur of what slopes are taken of [px]."""
    mirrors: str
    """`HELD`, `APART` or `TOGETHER`."""


STEPS = (
    Step(4.0, 4.0, HELD),
    Step(4.0, 4.0, HELD),
    Step(3.0, 3.0, HELD),
    Step(3.0, 3.0, APART),
    Step(2.0, 2.0, APART),
    Step(1.0, 1.5, APART),
    Step(0.5, 1.5, APART),
    *(Step(0.5, 1.5, TOGETHER),) * 6,
)
"""What is done in turn, of mirrors."""
MOVING_STEPS = (
    Step(2.0, 2.0, HELD),
    Step(2.0, 2.0, HELD),
    *(Step(1.0, 1.5, APART),) * 4,
    *(Step(0.5, 1.5, APART),) * 3,
    *(Step(0.5, 1.5, TOGETHER),) * 2,
)
"""The same of a link that moves: each of many poses counts for little in what the others tell, so
that they converge by themselves, and all at once is solved for tau and sigma alone."""
_BEND = 40.0
"""By how much surfaces bend otherwise than nearby, until they tell, over the square of an edge of a
mesh: by 1 mm where edges are of 5 mm [1/m]."""
FEWEST = 10
"""Pictures that must show a place, and those next to it, for it to be claimed or tell of others."""
_ODD = 100.0
"""A chi-square beyond which a place is odd by itself, and tells no more of those about it."""
_HARDLY = 0.01
"""What a place counts that too few pictures show to tell how far colours disagree there: as 1."""
_FARTHEST = 6e-3
"""That a vertex moves in one step [m]."""
_SAMPLES, _STEPS = 16, 80
"""From which standard deviations are estimated, and steps of conjugate gradients for them."""
_COUPLED = 200
"""Steps of conjugate gradients that tell how a surface follows mirrors."""
_ALIKE = 30.0
"""By how much less pictures tell of mirrors than their equations say: before true mirrors these ask
for changes whose chi-square, a degree of freedom, is 7 in the mean and up to 90 (robots 1834 and
1836), for what shading and cameras are wrong by is alike all over a body."""
_ALIKE_POSES = 10.0
"""The same of poses of a link that moves: each is seen in two pictures alone, which are lit alike
(set on forearm and hand of 1934 and 1936)."""


@dataclass(frozen=True, eq=False)
class RefinedSurface:
    """What a refinement ends with."""

    mesh: TriangleMesh
    """The surface."""
    sigma: NDArray
    """Of each vertex along its normal, inf where nothing is known [m]. Shape (V,)."""
    colors: NDArray
    """BGR, nan where no picture shows a vertex. Shape (V, 3)."""
    looks: NDArray
    """Pictures that show each vertex, or its outline. Shape (V,)."""
    standpoints: tuple[Standpoint, ...]
    """As the pictures tell them."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("sigma", "colors", "looks"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def well_shown(found: PictureEquations | RefinedSurface, neighbours: Neighbours) -> NDArray:
    """Return which vertices enough pictures show, as all about them. Shape (V,)."""
    shown = (found.looks >= FEWEST) & np.isfinite(found.colors).all(axis=1)
    return shown & (neighbours.means(shown.astype(float)) == 1.0)


def refine_surface(
    mesh: TriangleMesh,
    blurred: Callable[[float], ShapeViews],
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
    steps: Sequence[Step] = STEPS,
    gate: float = np.inf,
    jumps: Callable[[NDArray], NDArray] | None = None,
) -> RefinedSurface:
    """Move vertices along their normals, and the standpoints, until all pictures agree.

    Args:
        mesh: Where the surface is about: to 5 mm or so, where it has no edges to follow.
        blurred: The pictures, blurred by a Gaussian [px] of what shows the body; mirrors as the
            hand told them.
        rng: Source of samples of what is not known.
        steps: What is done in turn; the last is `TOGETHER`.
        gate: Chi-square beyond which a standpoint that moves by itself is left out, with its
            pictures: what they show there is something else.
        jumps: Which places lie where a surface is known to jump, shape (N, 3) -> (N,): no mesh
            follows it there, so that nothing is known there, nor told of what is about.
    """
    neighbours = Neighbours.of(mesh)
    before = replace(blurred(steps[0].levels), views=())  # whose pictures are not kept
    values, covariance = before.values, before.covariance
    edges = np.diff(mesh.vertices[mesh.edges], axis=1)
    bend = _BEND * float(np.median(np.sum(edges**2, axis=2)))
    tau = np.full(len(mesh.vertices), bend)
    sound = np.ones(len(before.standpoints), dtype=bool)
    for k, step in enumerate(steps):
        found, fair = _equations(mesh, neighbours, blurred, step, values, tau, sound)
        if step.mirrors == TOGETHER:
            drawn = fair.drawn(found.own, rng, _SAMPLES, _STEPS)
            tau = fair.told(drawn, well_shown(found, neighbours), bend)
            fair = replace(fair, tau=tau)
            by, change, covariance = _together(before, values, found, fair)
        else:
            by = fair.solved(found.own, (found.pull + fair.pull)[:, None])[:, 0]
            free = step.mirrors == APART
            change = _apart(before, values, found, by) if free else np.zeros_like(values)
            sound &= moved(before, values + change) < gate
            change = np.where(_of_each(before, sound), change, before.values - values)
        by, values = np.clip(by, -_FARTHEST, _FARTHEST), values + change
        mesh = mesh.moved(mesh.vertices + by[:, None] * mesh.normals)
        if progress:
            progress(k + 1, len(steps))
    found, fair = _equations(mesh, neighbours, blurred, steps[-1], values, tau, sound)
    apart = np.zeros(len(tau), dtype=bool) if jumps is None else jumps(mesh.vertices)
    placed = before.placed(values)
    beside = placed.beside_the_frame
    covariance = beside @ covariance @ beside.T
    sigma = np.where(apart, np.inf, _sigma(found, fair, covariance, rng, apart))
    return RefinedSurface(mesh, sigma, found.colors, found.looks, placed.standpoints)


def _equations(
    mesh: TriangleMesh,
    neighbours: Neighbours,
    blurred: Callable[[float], ShapeViews],
    step: Step,
    values: NDArray,
    tau: NDArray,
    sound: NDArray,
) -> tuple[PictureEquations, FairSurface]:
    """Return what pictures and smoothness tell where surface and mirrors are now.

    Args:
        sound: Which mirrors count. Shape (M,).
    """
    views, smoother = (
        replace(own, views=tuple(view for view in own.views if sound[view.look]))
        for own in (blurred(step.levels), blurred(step.slopes))
    )
    found = PictureEquations.of(mesh, views.placed(values), smoother)
    return found, FairSurface.of(mesh, neighbours, tau)


def moved(before: ShapeViews, values: NDArray) -> NDArray:
    """Return how far each standpoint is from where it was told before: chi-squares. Shape (M,).

    Pictures lead no farther than they are blurred: of a mirror that the hand told much worse than
    it says they find another place, and all that they show in it is wrong.
    """
    off, known = values - before.values, before.covariance
    return np.array([off[k] @ np.linalg.solve(known[k, k], off[k]) for k in before.parts])


def _of_each(before: ShapeViews, standpoints: NDArray) -> NDArray:
    """Return what holds of each standpoint for each of its values. Shape (M,) -> (K,)."""
    return np.repeat(standpoints, [len(one.values) for one in before.standpoints])


def _together(
    before: ShapeViews, values: NDArray, found: PictureEquations, fair: FairSurface
) -> tuple[NDArray, NDArray, NDArray]:
    """Return what surface and mirrors move by at once; cameras are held.

    With A the information of the surface, C what couples it to the mirrors, V theirs, b and c what
    the pictures ask both for, P the covariance of mirrors and cameras as the hand told them, m what
    mirrors are off from that, and a = `_ALIKE`,

        N = (V - C' A^-1 C) / a,    (N + P^-1) y = (c - C' A^-1 b) / a + P^-1 m,
        d = A^-1 (b - C y)

    N is of the mirrors alone: cameras err with them by P, and nothing is learned of cameras.

    Returns:
        Of the surface, shape (V,), of the mirrors, shape (3 M,), and the covariance (N + P^-1)^-1
        of mirrors and cameras, shape (3 M + c, 3 M + c).
    """
    count = len(values)
    moves = any(one.R_WF is not None for one in before.standpoints)
    alike = _ALIKE_POSES if moves else _ALIKE
    right = np.column_stack([found.pull + fair.pull, found.coupling[:, :count]])
    solved = fair.solved(found.own, right, _COUPLED)
    alone, coupled = solved[:, 0], solved[:, 1:]
    coupling = found.coupling[:, :count].T
    known = inverse_of(before.covariance)
    off = np.zeros(len(known))
    off[:count] = before.values - values
    pull = known @ off
    known[:count, :count] += (found.values[:count, :count] - coupling @ coupled) / alike
    pull[:count] += (found.values_pull[:count] - coupling @ alone) / alike
    covariance = inverse_of(known)
    change = (covariance @ pull)[:count]
    return alone - coupled @ change, change, covariance


def _apart(before: ShapeViews, values: NDArray, found: PictureEquations, step: NDArray) -> NDArray:
    """Return what each mirror moves by after a step of the surface, by itself. Shape (3 M,).

    Blurred pictures are wrong in all mirrors alike, by more than the hand is.
    """
    pull = found.values_pull - found.coupling.T @ step
    off, change = before.values - values, []
    for own in before.parts:
        known = np.linalg.inv(before.covariance[own, own])
        information = found.values[own, own] + known
        change.append(np.linalg.solve(information, pull[own] + known @ off[own]))
    return np.concatenate(change)


def _sigma(
    found: PictureEquations,
    fair: FairSurface,
    covariance: NDArray,
    rng: np.random.Generator,
    apart: NDArray | None = None,
) -> NDArray:
    """Return the standard deviations of vertices along their normals [m]. Shape (V,).

    What pictures tell, D, is as much more uncertain as the colours about a vertex disagree, chi^2,
    and as much less where they agree better than is expected of them: what has other colours in
    other pictures, as where light is mirrored, is wrong beyond the vertices that show it, and a
    smooth sleeve hardly anywhere. Smoothness, M' tau^-2 M, is as uncertain as before.
    Where mirrors and cameras are wrong by y, the pictures ask the surface for - A^-1 C y more, with
    C the coupling: with P the covariance of y, and A = D + M' tau^-2 M

        sigma^2 = diag(A^-1 (chi^2 D + M' tau^-2 M) A^-1) + diag(A^-1 C P C' A^-1)

    P is what hand and pictures tell together; of a link that moves, less what moves its frame in
    all poses alike (`ShapeViews.beside_the_frame`): no error of what is told in that frame.

    Args:
        found: What the pictures tell of the surface.
        fair: How smooth it is.
        covariance: P. Shape (3 M + c, 3 M + c).
        apart: Which vertices tell nothing of how far colours disagree about them. Shape (V,).
    """
    smooth = fair.neighbours.smoothed
    shown = well_shown(found, fair.neighbours)
    if apart is not None:
        shown &= ~apart
    each = np.where(shown, np.minimum(found.chi_square, _ODD), 1.0)
    disagreeing = smooth(each, PATCH, np.where(shown, 1.0, _HARDLY))
    drawn = fair.drawn(found.own, rng, _SAMPLES, _STEPS, disagreeing)
    by_value = fair.solved(found.own, found.coupling, _STEPS)
    common = np.einsum("vi,ij,vj->v", by_value, covariance, by_value)
    return np.sqrt(smooth(np.mean(drawn**2, axis=1), 3) + common)
