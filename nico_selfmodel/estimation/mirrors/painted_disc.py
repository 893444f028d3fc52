"""A disc of paint on a known surface: where its middle is, by all pictures together.

The surface says which place q of a link each pixel shows, and how it is lit: l, the expected
colour over that of the surface. A pixel of a disc of radius r about x shows p l, p the colour of
the paint, so that it is covered to the share

    a = s' C^-1 (I - M) / (s' C^-1 s),    s = p l - M,    1 / (s' C^-1 s) = var a

and with E the two directions along the surface at x, and g how many metres a pixel is there,

    T = (1 - tanh((|E' (q - x) - h t| - r) / (g w))) / 2

Least squares of a - T by x and r. Paint lies h above the surface, so that who looks at a slant sees
it h t beside its place, t the tangent of the slant along the way in which one looks. All look from
about one side, which does not tell h: it is somewhere between nothing and the most that paint may
be thick, taken as half of that, and not known by as much. What an edge hides, what lies beyond an
outline or falls away from the disc tells nothing: a disc that is seen in part is known as well as
that part tells. In one picture alone the middle of what is seen would be taken for that of the
disc. Where the surface turns away within the disc, as about a bead, x is not known by r mean
(1 - cos) besides, of the angle between the normals at x and around the disc. Beyond an edge there
is nothing that could bend: who paints past it paints a part of a disc.

Where nothing tells of a disc, as beside a seam or where a few pixels show, something of it is seen
at the given place. That is half of it as a rule: of a part as large as a disc of radius s, r =
sqrt(2) s, whose middle is off by r / 2 one way, nobody knows which, so that x is not known by s / 2
each way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.solids.solid import (
    Solid,
    distance_to_solids,
    normals_of_solids,
    onto_solids,
)

_SOFT = 0.6
"""w, how soft the edge of a spot looks [px]."""
_SHAPE = 0.1
"""What a spot is no disc by, as a share of a pixel."""
_SAME = 1e-3
"""What a disc would lie on farther off than this from what a pixel shows is not that place [m]."""
_NEAR = 2e-3
"""From so far above a middle is put on the surface [m]."""
_WIDER = 2.5
"""Pixels are looked at within so many radii."""
_SLANTED = 0.25
"""Width over length of the narrowest spot whose area tells a radius."""
_LEAST = 1e-3
"""Radius of the smallest disc [m]."""
_HELD = 1e-6
"""Holds a place that nothing tells of."""
_ROUGHLY = 0.5
"""What the logarithm of the radius is not known by beforehand."""
_STEPS, _CHOOSING = 25, 6
"""Of the fit: how many, and after how many its pixels stay the same."""
_LONGEST, _ARRIVED = 1.0, 0.01
"""The longest step, and that at which it ends [px]."""
_NEIGHBOURS, _ALL_NEIGHBOURS = 1.5, 9
"""Pixels nearer than this [px] are a pixel's neighbours, and how many they are with it."""
_SMOOTH, _TOO_FAR = 1.5, 0.05
"""Over how far light is taken to change evenly [px], and the least weight of what tells it."""
_EVEN = 0.005
"""What holds its slope where hardly anything tells it [px^2]."""
_ALIKE = 4.0
"""So far apart what is left of pixels hangs together no more [px]."""
_AROUND, _RING = 1.0, 16
"""What a middle is not known by where paint bends about a surface, in radii, once that turns away
by a right angle all around; set on nine places of robots 1980 to 1983 and the nose of 1913. And
places that are asked around it."""
_FEWEST = 9.0
"""Pixels of paint that tell of a disc."""
_HALF = 0.5
"""What the middle of a disc is not known by each way of which half is seen, as large as a disc of
radius 1; set on 16 places of robots 1934 to 1955, 1971 and 1980 to 1983."""


@dataclass(frozen=True, eq=False)
class SurfacePixels:
    """Pixels of one picture that show a link about a spot."""

    at: NDArray
    """Columns and rows [px]. Shape (n, 2)."""
    p_FQ: NDArray
    """Where on the link each is, nan if it is not [m]. Shape (n, 3)."""
    seen: NDArray
    """I. Shape (n, 3)."""
    under: NDArray
    """M. Shape (n, 3)."""
    light: NDArray
    """l, of all colours alike. Shape (n, 1)."""
    inverse: NDArray
    """C^-1. Shape (n, 3, 3)."""
    by_place: NDArray
    """How the pixel of the spot moves with its place [px/m]. Shape (2, 3)."""
    surprising: NDArray
    """Whether the place about each surprises beyond chance. Shape (n,)."""


def painted_disc(
    pictures: Sequence[SurfacePixels],
    solids: Sequence[Solid],
    p_FM: NDArray,
    pixel_sigma: float,
    thickest: float,
) -> tuple[NDArray, NDArray]:
    """Return where the middle of a disc of paint is, and its covariance.

    Args:
        solids: What the link is made of, in its frame.
        p_FM: About where the middle is [m]. Shape (3,).
        pixel_sigma: What each picture is shifted by by itself [px].
        thickest: How thick paint may be [m].

    Returns:
        Place [m], shape (3,), and covariance by what the pictures leave open, shape (3, 3). Where
        they do not tell of a disc, the given place, known to half the radius of what
        surprises there.
    """
    x = np.asarray(p_FM, dtype=float)
    E = _along(solids, x)
    first = max(_LEAST, *(_radius(one, E) for one in pictures), 0.0)
    height = 0.5 * thickest
    fit = _fitted(pictures, solids, x, first, height)
    if fit is None:
        return x, (_HALF * first) ** 2 * np.eye(3)
    x, E, radius, charts = fit
    each, _, spread = _equations(charts, radius)
    P = np.linalg.inv(sum(each) + _before(charts))[:2]
    flat = P @ (sum(each) + spread) @ P.T
    by_height = np.zeros(2)
    for H, chart in zip(each, charts, strict=True):
        by_pixels = P @ H[:, :2] @ chart.G
        flat += pixel_sigma**2 * by_pixels @ by_pixels.T
        by_height += P @ H[:, :2] @ chart.t
    flat += height**2 * np.outer(by_height, by_height)
    flat += (_AROUND * radius * _turned_away(solids, x, E, radius)) ** 2 * np.eye(2)
    return x, _bent(solids, x, E, flat)


@dataclass(frozen=True, eq=False)
class _Chart:
    """Pixels of a picture by where they are along the surface about a place."""

    pixels: SurfacePixels
    """Those that a disc there may cover."""
    y: NDArray
    """E' (q - x) - h t [m]. Shape (n, 2)."""
    G: NDArray
    """How these change with the pixel [m/px]. Shape (2, 2)."""
    t: NDArray
    """How far beside its place paint is seen that lies so far above it. Shape (2,)."""

    @classmethod
    def of(cls, pixels: SurfacePixels, x: NDArray, E: NDArray, height: float) -> "_Chart":
        """Measure along E from what is so far above x."""
        G = np.linalg.inv(pixels.by_place @ E)
        t = G @ pixels.by_place @ np.cross(*E.T)
        return cls(pixels, (pixels.p_FQ - x) @ E - height * t, G, t)


def _fitted(
    pictures: Sequence[SurfacePixels],
    solids: Sequence[Solid],
    x: NDArray,
    first: float,
    height: float,
) -> tuple[NDArray, NDArray, float, list[_Chart]] | None:
    """Return x, E, r and the pixels of the best disc; None where too few tell of it."""
    radius, chosen = first, list(pictures)
    for step in range(_STEPS):
        E = _along(solids, x)
        if step < _CHOOSING:  # then no more: a pixel at an edge would come and go for ever
            chosen = [_laid(one, solids, x, E, radius) for one in pictures]
        charts = [_Chart.of(one, x, E, height) for one in chosen]
        if sum(float(_covered(one, radius)[0].sum()) for one in charts) < _FEWEST:
            return None
        each, off, _ = _equations(charts, radius)
        H = _before(charts)
        off[2] += H[2, 2] * np.log(first / radius)
        pixel = _pixel(charts)
        change = np.linalg.solve(sum(each) + H, off)
        size = float(np.abs(change * [1.0, 1.0, radius]).max()) / pixel
        change *= min(1.0, _LONGEST / max(size, 1e-12))
        moved = _onto(solids, x, E, change[None, :2], _NEAR)[0]
        if not np.isfinite(moved).all():
            return None
        x, radius = moved, float(radius * np.exp(change[2]))
        if size < _ARRIVED and step >= _CHOOSING:
            return x, E, radius, charts
    return None


def _along(solids: Sequence[Solid], x: NDArray) -> NDArray:
    """Return E, two directions along a surface at a place. Shape (3, 2)."""
    return tangent_basis(normals_of_solids(solids, x[None])[0])


def _before(charts: Sequence[_Chart]) -> NDArray:
    """Return what is known beforehand of x, next to nothing, and of log r. Shape (3, 3)."""
    return np.diag([_HELD / _pixel(charts) ** 2] * 2 + [_ROUGHLY**-2])


def _pixel(charts: Sequence[_Chart]) -> float:
    """Return how large a pixel is on the surface [m]."""
    return float(np.mean([np.sqrt(abs(np.linalg.det(one.G))) for one in charts]))


def _radius(pixels: SurfacePixels, E: NDArray) -> float:
    """Return the radius of a disc as large as what surprises of a picture [m]."""
    count = (pixels.surprising & np.isfinite(pixels.p_FQ).all(axis=1)).sum()
    long, short = np.linalg.svd(pixels.by_place @ E)[1]
    return float(np.sqrt(count / np.pi / (long * max(short, _SLANTED * long))))


def _laid(
    pixels: SurfacePixels, solids: Sequence[Solid], x: NDArray, E: NDArray, radius: float
) -> SurfacePixels:
    """Return the pixels of which, and of whose neighbours, a disc that is laid on meets the place.

    It meets what is first in its way, along the normal from a radius above.
    """
    y = (pixels.p_FQ - x) @ E
    near = np.flatnonzero(~(np.linalg.norm(y, axis=1) > _WIDER * radius))
    off = np.linalg.norm(_onto(solids, x, E, y[near], radius) - pixels.p_FQ[near], axis=1)
    other = (_apart(pixels.at[near]) < _NEIGHBOURS) & ~(off < _SAME)
    kept = near[~other.any(axis=1)]
    parts = ("at", "p_FQ", "seen", "under", "light", "inverse", "surprising")
    return replace(pixels, **{name: getattr(pixels, name)[kept] for name in parts})


def light_of(at: NDArray, under: NDArray, colors: NDArray) -> NDArray:
    """Return how surfaces of several colours are lit, from what is well inside of each.

    At an edge colours mix, and say nothing of the light. A mean of what is beside it would be the
    light of one side: it is followed to the edge by its slope (local linear regression, Fan and
    Gijbels 1996).

    Args:
        at: Columns and rows of pixels [px]. Shape (n, 2).
        under: What they show without paint. Shape (n, 3).
        colors: Of the surface, in its own light; nan where that is not known. Shape (n, 3).

    Returns:
        Grey levels over those of the surface; nan where nothing near tells. Shape (n, 1).
    """
    apart = _apart(at)
    same = (colors[:, None] == colors).all(axis=2)
    inside = (same & (apart < _NEIGHBOURS)).sum(axis=1) == _ALL_NEIGHBOURS
    inside &= colors.sum(axis=1) > 0.0
    weight = np.exp(-0.5 * (apart / _SMOOTH) ** 2) * (same & inside)
    light = np.zeros(len(at))
    light[inside] = under[inside].sum(axis=1) / colors[inside].sum(axis=1)
    told = weight.sum(axis=1) > _TOO_FAR
    line = np.insert(at - at[told, None], 0, 1.0, axis=2)
    A = np.einsum("nm,nmi,nmj->nij", weight[told], line, line) + np.diag([0.0, _EVEN, _EVEN])
    b = np.einsum("nm,nmi,m->ni", weight[told], line, light)
    light = np.full((len(at), 1), np.nan)
    light[told] = np.maximum(np.linalg.solve(A, b[:, :, None])[:, 0], 0.0)
    return light


def _apart(at: NDArray) -> NDArray:
    return np.linalg.norm(at[:, None] - at, axis=2)


def _equations(charts: Sequence[_Chart], radius: float) -> tuple[list[NDArray], NDArray, NDArray]:
    """Return J' W J of each picture by x and log r, J' W (a - T) of all, and that one's covariance.

    What is left of neighbours hangs together: they count to their distance's share of `_ALIKE`.
    """
    covered, slopes = zip(*(_covered(one, radius) for one in charts), strict=True)
    paint = _paint(charts, covered)
    each, off, spread = [], np.zeros(3), np.zeros((3, 3))
    for one, T, J in zip(charts, covered, slopes, strict=True):
        step = paint * one.pixels.light - one.pixels.under
        by = np.einsum("nij,nj->ni", one.pixels.inverse, step)
        told = np.maximum(np.sum(by * step, axis=1), 1e-9)
        left = np.sum(by * (one.pixels.seen - one.pixels.under), axis=1) / told - T
        J_W = (J / (1.0 / told + _SHAPE**2)[:, None]).T
        each.append(J_W @ J)
        off += J_W @ left
        own = (J_W * left).T
        spread += own.T @ np.maximum(1.0 - _apart(one.pixels.at) / _ALIKE, 0.0) @ own
    return each, off, spread


def _paint(charts: Sequence[_Chart], covered: Sequence[NDArray]) -> NDArray:
    """Return p by least squares of what pixels show where they are covered. Shape (3,)."""
    A, b = 1e-9 * np.eye(3), np.zeros(3)
    for one, T in zip(charts, covered, strict=True):
        share = T[:, None] * one.pixels.light
        A += np.einsum("n,nij->ij", share[:, 0] ** 2, one.pixels.inverse)
        shown = one.pixels.seen - (1.0 - T[:, None]) * one.pixels.under
        b += np.einsum("nij,nj->i", one.pixels.inverse, share * shown)
    return np.linalg.solve(A, b)


def _covered(chart: _Chart, radius: float) -> tuple[NDArray, NDArray]:
    """Return T of each pixel, shape (n,), and its slopes by x and log r, shape (n, 3)."""
    apart = np.linalg.norm(chart.y, axis=1) + 1e-9
    way = chart.y / apart[:, None]
    soft = np.linalg.norm(way @ chart.G, axis=1) * _SOFT + 1e-9
    edge = np.tanh((apart - radius) / soft)
    slope = 0.5 * (1.0 - edge**2) / soft
    return 0.5 * (1.0 - edge), slope[:, None] * np.column_stack([way, np.full(len(way), radius)])


def _onto(solids: Sequence[Solid], x: NDArray, E: NDArray, d: NDArray, height: float) -> NDArray:
    """Return where places beside one meet the surface from above, nan where not. (k, 2), (k, 3)."""
    normal = np.cross(*E.T)
    above = x + d @ E.T + height * normal
    inside = distance_to_solids(solids, above)[0] < 0.0
    return np.where(inside[:, None], np.nan, onto_solids(solids, above, -normal))


def _turned_away(solids: Sequence[Solid], x: NDArray, E: NDArray, radius: float) -> float:
    """Return how far a surface turns from its normal at a place where a disc ends, mean 1 - cos."""
    turns = 2.0 * np.pi * np.arange(_RING) / _RING
    ring = _onto(solids, x, E, radius * np.stack([np.cos(turns), np.sin(turns)], axis=1), radius)
    met = ring[np.isfinite(ring).all(axis=1)]
    cosines = normals_of_solids(solids, met) @ np.cross(*E.T)
    return float(np.mean(1.0 - cosines)) if len(met) else 0.0


def _bent(solids: Sequence[Solid], x: NDArray, E: NDArray, flat: NDArray) -> NDArray:
    """Return a covariance along the surface as that bends, from its axes' ends. Shape (3, 3)."""
    values, axes = np.linalg.eigh(flat)
    ends = np.concatenate([axes.T, -axes.T]) * np.sqrt(np.tile(values, 2))[:, None]
    places = _onto(solids, x, E, ends, _NEAR)
    off = np.where(np.isfinite(places), places - x, ends @ E.T)
    return 0.5 * off.T @ off
