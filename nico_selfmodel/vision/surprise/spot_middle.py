"""The middle of a spot: an ellipse of one colour is fitted to what a picture differs by.

A pixel x of the picture I, expected to be M, is covered by paint p to the share

    a = s' C^-1 (I - M) / (s' C^-1 s),    s = p - M,    1 / (s' C^-1 s) = var a

and an ellipse about c, the circle |M (x - c)| = 1 with M symmetric, covers

    T(x) = (1 - tanh((|M (x - c)| - 1) r / w)) / 2,    r = det M^-1/2

Least squares of a - T by c and M, weighed by var a + `_SHAPE`^2, knows which pixels tell little:
those where the paint is as what is under it, and edges. A mean of the pixels that surprise is off
by a pixel at an edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.vision.surprise.blobs import Blob, threshold_of
from nico_selfmodel.vision.surprise.surprise import Surprise, held_against

_SOFT = 0.6
"""w, how soft the edge of a spot looks [px]."""
_SHAPE = 0.1
"""What a spot is no ellipse by, as a share of a pixel."""
_ROUND = 0.4
"""How far a spot is from the circle of its area, as a share of M."""
_SMALLEST = 9
"""Area of the smallest spot that is fitted [px]."""
_AROUND, _BEYOND = 6, 8
"""Pixels about a spot that are looked at, and beyond these those that blur into them [px]."""
_STEPS, _LONGEST, _ARRIVED = 15, 0.7, 0.01
"""Of the fit: how many, the longest and that at which it ends [px]."""
_UNSEEN = 0.5
"""What a middle is shifted by, of the radius, where nothing in and about a spot tells of paint."""
_BLURRED = 2.0
"""So far beyond a spot its paint surprises, by the mean of a place and by blur [px]."""
_RING, _TOLD = 1.5, 0.1
"""How far about the spot that is asked [px], and the largest var a at which a pixel tells."""


@dataclass(frozen=True)
class Middle:
    """The middle of a spot in one picture."""

    u: float
    """Column [px]."""
    v: float
    """Row [px]."""
    sigma: float
    """Of each [px]."""


@dataclass(frozen=True, eq=False)
class SpotPixels:
    """Judged pixels about a spot."""

    at: NDArray
    """Columns and rows. Shape (n, 2)."""
    seen: NDArray
    """I. Shape (n, 3)."""
    under: NDArray
    """M. Shape (n, 3)."""
    inverse: NDArray
    """C^-1. Shape (n, 3, 3)."""
    chi_square: NDArray
    """How much the place about each surprises, z^2. Shape (n,)."""


def middle_of(blob: Blob, picture: NDArray, parts: Sequence[Surprise]) -> Middle:
    """Return the middle of a spot, and how well it is known.

    Args:
        blob: Where it surprises.
        picture: What was seen, BGR. Shape (h, w, 3).
        parts: What differs from expectations that judge parts of the picture, the first that
            judges a pixel counts.

    Returns:
        Middle of the fitted ellipse. Its sigma is that of the fit, and grows with the share of the
        spot and what is about it that tells nothing. The blob's middle, known to its radius, where
        there is nothing to fit; where a spot is seen in parts that are not of one such ellipse, as
        where paint crosses colours that it is like, the same, known to half of what
        they are apart; what surprises about an ellipse and is not blurred from it is such a part.
    """
    radius = float(np.sqrt(max(blob.area, _SMALLEST) / np.pi))
    pixels = pixels_about(blob.u, blob.v, radius, picture, parts)
    if pixels is None:
        return Middle(blob.u, blob.v, radius)
    fit = _fitted(pixels, np.array([blob.u, blob.v, 1.0 / radius, 0.0, 1.0 / radius]))
    if np.hypot(fit.x[0] - blob.u, fit.x[1] - blob.v) > radius + _AROUND:
        return Middle(blob.u, blob.v, radius)
    if not _holds(fit.x, blob.parts):
        return _in_parts(blob, blob.parts)
    rest = _unexplained(pixels, fit.x)
    if len(rest):
        return _in_parts(blob, [fit.x[:2], rest.mean(axis=0)])
    sigma = np.hypot(fit.sigma, _UNSEEN * (1.0 - _told(pixels, fit.x)) * fit.radius)
    return Middle(float(fit.x[0]), float(fit.x[1]), float(sigma))


def _holds(x: NDArray, parts: Sequence[tuple[float, float]]) -> bool:
    """Return whether an ellipse holds all parts of a spot."""
    M = np.array([[x[2], x[3]], [x[3], x[4]]])
    return all(float(np.linalg.norm(M @ (np.array(part) - x[:2]))) <= 1.0 for part in parts)


def _unexplained(pixels: SpotPixels, x: NDArray) -> NDArray:
    """Return the pixels that surprise beyond chance, and not by the paint of an ellipse. (k, 2)."""
    M, y = np.array([[x[2], x[3]], [x[3], x[4]]]), pixels.at - x[:2]
    apart = np.linalg.norm(y @ M, axis=1) + 1e-9
    beyond = np.linalg.norm(y, axis=1) * (1.0 - 1.0 / apart)  # along the ray from the middle
    surprising = pixels.chi_square > threshold_of(len(pixels.at))
    return pixels.at[surprising & (beyond > _BLURRED)]


def _in_parts(blob: Blob, parts: Sequence[ArrayLike]) -> Middle:
    """Return the blob's middle, known to half of how far the farthest parts are apart.

    The middle between these would be beside the body where one is an outline's.
    """
    each = np.array(parts, dtype=float)
    apart = np.linalg.norm(each[:, None] - each, axis=2)
    return Middle(blob.u, blob.v, 0.5 * float(apart.max()))


def pixels_about(
    u: float, v: float, radius: float, picture: NDArray, parts: Sequence[Surprise]
) -> SpotPixels | None:
    """Return the judged pixels about a spot; None where there are hardly any.

    Args:
        u: Column of its middle [px].
        v: Row of its middle [px].
        radius: Of it [px].
        picture: What was seen, BGR. Shape (h, w, 3).
        parts: What differs from expectations, as of `middle_of`.
    """
    reach = int(np.ceil(radius)) + _AROUND
    column, row = round(u), round(v)
    first = [max(at - reach - _BEYOND, 0) for at in (row, column)]
    window = tuple(
        slice(start, at + reach + _BEYOND + 1)
        for start, at in zip(first, (row, column), strict=True)
    )
    inside: NDArray = np.indices(picture[window].shape[:2])
    rows, columns = inside[0] + first[0], inside[1] + first[1]
    left = np.hypot(columns - u, rows - v) <= reach
    found: list[tuple[NDArray, ...]] = []
    for part in parts:
        expected = part.expected
        if expected is None:
            continue
        sigma = np.where(left, expected.pixel_sigma[window], np.nan)
        if not np.isfinite(sigma).any():
            continue
        own = replace(
            expected,
            picture=expected.picture[window],
            pixel_sigma=sigma,
            appearance_sigma=np.asarray(expected.appearance_sigma)[window],
            light_sigma=np.asarray(expected.light_sigma)[window],
        )
        judged, off, alike, noise, _ = held_against(picture[window], own, part.gain)
        seen = picture[window][judged].astype(float)
        at = np.stack([columns[judged], rows[judged]], axis=1).astype(float)
        inverse = np.linalg.inv(alike + noise * np.eye(3))
        found.append((at, seen, seen - off, inverse, part.chi_square[window][judged]))
        left &= ~judged
    if sum(len(at) for at, *_ in found) < _SMALLEST:
        return None
    return SpotPixels(*(np.concatenate(each) for each in zip(*found, strict=True)))


@dataclass(frozen=True, eq=False)
class _Fit:
    """An ellipse: c, and M by its upper triangle."""

    x: NDArray
    """c and M. Shape (5,)."""
    sigma: float
    """Of c, each coordinate [px]."""

    @property
    def radius(self) -> float:
        """Of the circle of its area [px]."""
        return _radius(self.x)


def _radius(x: NDArray) -> float:
    return float((x[2] * x[4] - x[3] ** 2) ** -0.5)


def _covered(pixels: SpotPixels, x: NDArray) -> tuple[NDArray, NDArray]:
    """Return how far an ellipse covers pixels, shape (n,), and the slopes of that, shape (n, 5)."""
    M, y = np.array([[x[2], x[3]], [x[3], x[4]]]), pixels.at - x[:2]
    z = y @ M
    apart = np.linalg.norm(z, axis=1) + 1e-9
    scale = _radius(x) / _SOFT
    edge = np.tanh((apart - 1.0) * scale)
    slope = 0.5 * (1.0 - edge**2) * scale / apart
    by_M = [z[:, 0] * y[:, 0], z[:, 0] * y[:, 1] + z[:, 1] * y[:, 0], z[:, 1] * y[:, 1]]
    slopes = slope[:, None] * np.column_stack([z @ M, *(-one for one in by_M)])
    return 0.5 * (1.0 - edge), slopes


def _fitted(pixels: SpotPixels, start: NDArray) -> _Fit:
    """Fit an ellipse from a circle."""
    x, sigma = start, np.inf
    prior = np.array([1e-3, 1e-3, *3 * [(_ROUND * start[2]) ** -2]])
    for _ in range(_STEPS):
        covered, J = _covered(pixels, x)
        share, variance = _shares(pixels, covered)
        off, weight = share - covered, 1.0 / (variance + _SHAPE**2)
        H = (J * weight[:, None]).T @ J + np.diag(prior)
        step = np.linalg.solve(H, (J * weight[:, None]).T @ off + prior * [0, 0, *(start - x)[2:]])
        rest = float(weight @ off**2) / max(len(off) - len(x), 1)
        sigma = float(np.sqrt(0.5 * np.trace(np.linalg.inv(H)[:2, :2]) * max(rest, 1.0)))
        size = float(max(np.abs(step[:2]).max(), np.abs(step[2:]).max() / start[2] * 2.0))
        x = _within(x + step * min(1.0, _LONGEST / max(size, 1e-12)), start)
        if size < _ARRIVED:
            break
    return _Fit(x, sigma)


def _within(x: NDArray, start: NDArray) -> NDArray:
    """Return an ellipse whose half axes are from a third of the start's to three times that."""
    values, axes = np.linalg.eigh(np.array([[x[2], x[3]], [x[3], x[4]]]))
    M = (axes * np.clip(values, start[2] / 3.0, 3.0 * start[2])) @ axes.T
    return np.array([x[0], x[1], M[0, 0], M[0, 1], M[1, 1]])


def _told(pixels: SpotPixels, x: NDArray) -> float:
    """Return the share of an ellipse and what is about it in which a pixel tells of its paint."""
    radius = _radius(x)
    wider = np.array([*x[:2], *(x[2:] * radius / (radius + _RING))])
    _, variance = _shares(pixels, _covered(pixels, x)[0])
    inside = _covered(pixels, wider)[0] > 0.5
    return min(float(np.sum(inside & (variance < _TOLD))) / (np.pi * (radius + _RING) ** 2), 1.0)


def _shares(pixels: SpotPixels, covered: NDArray) -> tuple[NDArray, NDArray]:
    """Return which shares of pixels are covered by the paint of a spot, and their variances."""
    inner = np.maximum(covered - 0.5, 0.0) + 1e-6 * covered + 1e-12
    paint = inner @ pixels.seen / inner.sum()
    step = paint - pixels.under
    by = np.einsum("nij,nj->ni", pixels.inverse, step)
    told = np.maximum(np.sum(by * step, axis=1), 1e-9)
    return np.sum(by * (pixels.seen - pixels.under), axis=1) / told, 1.0 / told
