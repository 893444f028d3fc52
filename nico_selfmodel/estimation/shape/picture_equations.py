"""What pictures tell of how a surface must move along its normals, and of what is before it.

Light and body stand still, so that a place has one colour c in all mirrors (Lambert), and one in
both cameras where the body moves (`ShapeViews.lit_alike`); with what its normal moves it by d, and
what mirror or pose and the cameras are wrong by, m, a grey level is

    I_k(x) + g_k d + h_k . m = c + noise,    g = grad I . du/dx . n,    h = grad I . du/dm

c is eliminated by subtracting the weighted mean of all pictures that show it. I is blurred
as little as noise allows: a blurred picture mixes what is about a place, and mixes more of it the
more the surface is turned away, so that a body that is darker beside its middle seems to lie deeper
(chests by 0.4 mm at 1 px). grad I may be blurred more: it says how fast, not where to. Where the
surface is seen edge on, the outline passes through it: with s the distance from the outline,
s + grad s . (du/dx . n d + du/dm m) = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.shape.shape_views import ShapeViews, sampled, slope_of
from nico_selfmodel.geometry.triangle_mesh import TriangleMesh

_LEVEL, _SHARE, _SHIFT = 1.2, 0.01, 0.15
"""What a grey level, smoothed by half a pixel, is off by: by itself, as a share of it, and by
places [px]."""
_ALIKE, _ALIKE_BESIDE = 15.0, 10.0
"""Grey levels and places of an outline that err alike: channels, neighbours and cameras do; and
grey levels where both cameras are held against each other, pose by pose: they do not err alike
(set on forearm and hand of 1934 and 1936)."""
_HUBER = 2.0
"""Standard deviations from which on an error counts less."""
_OUTLINE_SIGMA, _OUTLINE_NEAR, _EDGE_ON = 0.4, 4.0, 0.06
"""Of an outline [px]; how near to it a vertex must be seen to be on it [px], and how it is turned:
cosine c between normal and line of sight. A place of a body of radius r turned by c lies r c^2 / 2
inside of its outline (measured on heads and chests of 1853 and 1857: 0.25 px at 0.1), and is drawn
too large."""
_ROUNDS = 3
"""In which colours and what disagrees with them are told apart."""


@dataclass(frozen=True, eq=False)
class PictureEquations:
    """Normal equations of displacements d and values m of standpoints and cameras, K + c."""

    own: NDArray
    """Information of each displacement [1/m^2]. Shape (V,)."""
    pull: NDArray
    """What the pictures ask displacements for. Shape (V,)."""
    coupling: NDArray
    """Of displacements with standpoints and cameras. Shape (V, K + c)."""
    values: NDArray
    """Information of standpoints and cameras. Shape (K + c, K + c)."""
    values_pull: NDArray
    """What the pictures ask standpoints and cameras for. Shape (K + c,)."""
    colors: NDArray
    """Mean colour of each vertex, BGR, nan where no picture shows it. Shape (V, 3)."""
    chi_square: NDArray
    """Of these colours, a degree of freedom; 1 where none is left. Shape (V,)."""
    looks: NDArray
    """Pictures that show each vertex, or its outline. Shape (V,)."""

    @classmethod
    def of(
        cls, mesh: TriangleMesh, views: ShapeViews, smoother: ShapeViews | None = None
    ) -> "PictureEquations":
        """Work them out where surface and standpoints are now.

        Args:
            smoother: The same pictures, blurred so that their slopes can be told from noise.
        """
        sums = _Sums.empty(len(mesh.vertices), len(views.covariance))
        pixels, slopes = views.pixels(mesh.vertices), views.slopes(mesh.vertices)
        shown = views.shown(mesh)
        both = zip(views.views, (smoother or views).views, strict=True)
        looks = [
            _look((view.picture, smooth.picture), pixels[k], slopes[k], mesh.normals, shown[k])
            for k, (view, smooth) in enumerate(both)
        ]
        parts = [views.part(view) for view in views.views]
        colors, chi_square = _photometric(looks, parts, views.lit_alike, sums)
        edge_on = _outlines(mesh, views, pixels, slopes, sums)
        return cls(
            sums.own, sums.pull, sums.coupling, sums.values, sums.values_pull, colors,
            chi_square, shown.sum(axis=0) + edge_on,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Sums:
    """Normal equations that are being summed up; the arrays are changed in place."""

    own: NDArray
    pull: NDArray
    coupling: NDArray
    values: NDArray
    values_pull: NDArray

    @classmethod
    def empty(cls, size: int, count: int) -> "_Sums":
        return cls(
            np.zeros(size), np.zeros(size), np.zeros((size, count)),
            np.zeros((count, count)), np.zeros(count),
        )  # fmt: skip

    def add(self, which: NDArray, part: NDArray, g: NDArray, h: NDArray, rest: "_Rest") -> None:
        """Add rows g d + h . m = -off of vertices. Shapes (n, c), (n, c, 3), (n, c)."""
        weight, off = rest.weight, rest.off
        self.own[which] += np.sum(weight * g**2, axis=1)
        self.pull[which] -= np.sum(weight * g * off, axis=1)
        self.coupling[np.ix_(which, part)] += np.einsum("vc,vcj->vj", weight * g, h)
        flat = (np.sqrt(weight)[:, :, None] * h).reshape(-1, len(part))
        self.values[np.ix_(part, part)] += flat.T @ flat
        self.values_pull[part] -= np.einsum("vc,vcj->j", weight * off, h)


@dataclass(frozen=True, eq=False)
class _Rest:
    """What rows are off by, and their weights. Shapes (n, c)."""

    off: NDArray
    weight: NDArray


@dataclass(frozen=True, eq=False)
class _Look:
    """Grey levels of one picture at the n vertices that it shows, and their derivatives."""

    which: NDArray
    levels: NDArray
    by_normal: NDArray
    by_value: NDArray
    weight: NDArray


def _look(
    pictures: tuple[NDArray, NDArray],
    pixels: NDArray,
    slopes: tuple[NDArray, NDArray],
    normals: NDArray,
    shown: NDArray,
) -> _Look:
    """Look up grey levels in one picture and their derivatives in another."""
    which = np.flatnonzero(shown)
    slope = slope_of(pictures[1], pixels[which])
    inside = np.isfinite(slope).all(axis=(1, 2))
    which, slope = which[inside], slope[inside]
    levels = sampled(pictures[0], pixels[which])
    by_normal = np.einsum("vij,vj->vi", slopes[0][which], normals[which])
    variance = _LEVEL**2 + (_SHARE * levels) ** 2 + _SHIFT**2 * np.sum(slope**2, axis=2)
    return _Look(
        which,
        levels,
        np.einsum("vci,vi->vc", slope, by_normal),
        slope @ slopes[1][which],
        1.0 / variance,
    )


def _photometric(
    looks: Sequence[_Look], parts: Sequence[NDArray], groups: Sequence[Sequence[int]], sums: _Sums
) -> tuple[NDArray, NDArray]:
    """Add what the colours tell; return them and how well they agree.

    Args:
        groups: Numbers of the looks in which a place has one colour.
    """
    size = len(sums.own)
    alike = _ALIKE if len(groups) == 1 else _ALIKE_BESIDE
    seen = np.zeros((size, 3)), np.zeros((size, 3))
    square, count = np.zeros(size), np.zeros(size)
    for group in groups:
        own = [looks[k] for k in group]
        agreed = _agreed(own, size)
        _add_agreed(own, [parts[k] for k in group], agreed, sums, alike)
        seen[0][:] += agreed.total * np.nan_to_num(agreed.colors)
        seen[1][:] += agreed.total
        square += agreed.square
        count += agreed.count
    chi_square = np.where(count > 0.0, square / np.maximum(count, 1.0), 1.0)
    return seen[0] / np.where(seen[1] > 0.0, seen[1], np.nan), chi_square


@dataclass(frozen=True, eq=False)
class _Agreed:
    """The colours on which looks agree, outliers weighing less."""

    weights: list[NDArray]
    """Of each look's grey levels."""
    colors: NDArray
    """Mean of each vertex. Shape (V, 3)."""
    total: NDArray
    """Weight of these. Shape (V, 3)."""
    square: NDArray
    """Sum of the squared errors of each vertex, in standard deviations. Shape (V,)."""
    count: NDArray
    """Degrees of freedom of that. Shape (V,)."""


def _add_agreed(
    looks: Sequence[_Look],
    parts: Sequence[NDArray],
    agreed: _Agreed,
    sums: _Sums,
    alike: float,
) -> None:
    """Add what looks of one light tell beside their mean, so many of which err alike."""
    size, used = len(sums.own), np.unique(np.concatenate(parts))
    slope, by_value = np.zeros((size, 3)), np.zeros((size, 3, len(used)))
    for look, weight, part in zip(looks, agreed.weights, parts, strict=True):
        slope[look.which] += weight * look.by_normal
        own = weight[:, :, None] * look.by_value
        by_value[look.which[:, None], :, np.searchsorted(used, part)] += own.transpose(0, 2, 1)
    slope /= np.maximum(agreed.total, 1e-12)
    for look, weight, part in zip(looks, agreed.weights, parts, strict=True):
        off = look.levels - agreed.colors[look.which]
        rest = _Rest(off, weight / alike)
        sums.add(look.which, part, look.by_normal - slope[look.which], look.by_value, rest)
    flat = by_value / np.sqrt(alike * np.maximum(agreed.total, 1e-12))[:, :, None]
    flat = flat.reshape(-1, len(used))
    sums.values[np.ix_(used, used)] -= flat.T @ flat


def _agreed(looks: Sequence[_Look], size: int) -> _Agreed:
    """Return what looks of one light agree on."""
    shares = [np.ones((len(look.which), 1)) for look in looks]
    for _ in range(_ROUNDS):
        colors, _ = _means(looks, shares, size)
        shares = _shares(looks, _off(looks, colors), size)
    colors, total = _means(looks, shares, size)
    square, count = np.zeros(size), np.zeros(size)
    for look, error in zip(looks, _off(looks, colors), strict=True):
        square[look.which] += np.mean(error**2, axis=1)
        count[look.which] += 1.0
    weights = [share * look.weight for look, share in zip(looks, shares, strict=True)]
    return _Agreed(
        weights, colors, total, np.where(count > 1.0, square, 0.0), np.maximum(count - 1.0, 0.0)
    )


def _means(looks: Sequence[_Look], shares: Sequence[NDArray], size: int) -> tuple[NDArray, NDArray]:
    """Return mean colours, nan where none is seen, and their total weights. Shapes (V, 3)."""
    colors, total = np.zeros((size, 3)), np.zeros((size, 3))
    for look, share in zip(looks, shares, strict=True):
        total[look.which] += share * look.weight
        colors[look.which] += share * look.weight * look.levels
    return colors / np.where(total > 0.0, total, np.nan), total


def _off(looks: Sequence[_Look], colors: NDArray) -> list[NDArray]:
    """Return how far grey levels are from these, in standard deviations. Shapes (n, 3)."""
    return [np.abs(one.levels - colors[one.which]) * np.sqrt(one.weight) for one in looks]


def _shares(looks: Sequence[_Look], errors: Sequence[NDArray], size: int) -> list[NDArray]:
    """Return what each look's levels count: less where they are far off. Shapes (n, 1).

    Which of two is wrong nothing tells: both count what the worse one does.
    """
    worst = [error.max(axis=1, initial=1e-9) for error in errors]
    if len(looks) == 2:
        both = np.full(size, 1e-9)
        for look, one in zip(looks, worst, strict=True):
            both[look.which] = np.maximum(both[look.which], one)
        worst = [both[look.which] for look in looks]
    return [np.minimum(1.0, _HUBER / np.maximum(one, 1e-9))[:, None] ** 2 for one in worst]


def _outlines(
    mesh: TriangleMesh,
    views: ShapeViews,
    pixels: Sequence[NDArray],
    slopes: Sequence[tuple[NDArray, NDArray]],
    sums: _Sums,
) -> NDArray:
    """Add what outlines tell; return how many pass through each vertex. Shape (V,)."""
    count = np.zeros(len(sums.own), dtype=int)
    facing = views.facing(mesh)
    for k, view in enumerate(views.views):
        beyond = sampled(view.beyond, pixels[k])
        with np.errstate(invalid="ignore"):
            on = (np.abs(beyond) < _OUTLINE_NEAR) & (np.abs(facing[k]) < _EDGE_ON)
            on |= (beyond > 0.0) & (beyond < 2.0 * _OUTLINE_NEAR)
        which = np.flatnonzero(on)
        slope = slope_of(view.beyond, pixels[k][which])
        kept = np.isfinite(slope).all(axis=1)
        which, slope = which[kept], slope[kept]
        off = beyond[which]
        by_normal = np.einsum("vij,vj->vi", slopes[k][0][which], mesh.normals[which])
        share = np.minimum(1.0, _HUBER * _OUTLINE_SIGMA / np.maximum(np.abs(off), 1e-9))
        rest = _Rest(off[:, None], (share / (_ALIKE * _OUTLINE_SIGMA**2))[:, None])
        g = np.sum(slope * by_normal, axis=1)[:, None]
        h = np.einsum("vi,vij->vj", slope, slopes[k][1][which])[:, None]
        sums.add(which, views.part(view), g, h, rest)
        count[which] += 1
    return count
