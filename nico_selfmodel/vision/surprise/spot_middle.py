"""The middle of a spot: a disc of one colour is fitted to what a picture differs by.

A pixel x of the picture I, expected to be M, is covered by paint p to the share

    a = s' C^-1 (I - M) / (s' C^-1 s),    s = p - M,    1 / (s' C^-1 s) = var a

and a disc of radius r about c covers T(x) = (1 - tanh((|x - c| - r) / w)) / 2. Least squares of
a - T by c and r, weighed by var a + `_SHAPE`^2, knows which pixels tell little: those where the
paint is as what is under it, and edges. A mean of the pixels that surprise is off by a pixel at
an edge.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.surprise.blobs import Blob
from nico_selfmodel.vision.surprise.surprise import Surprise, held_against

_SOFT = 0.6
"""w, how soft the edge of a disc looks [px]."""
_SHAPE = 0.1
"""What a spot is no disc by, as a share of a pixel."""
_RADIUS_SIGMA = 1.0
"""How well its area tells a spot's radius [px]."""
_SMALLEST = 9
"""Area of the smallest spot that is fitted [px]."""
_AROUND, _BEYOND = 6, 8
"""Pixels about a spot that are looked at, and beyond these those that blur into them [px]."""
_STEPS, _LONGEST, _ARRIVED = 15, 0.7, 0.01
"""Of the fit: how many, the longest and that at which it ends [px]."""
_UNSEEN = 0.5
"""What a disc's middle is shifted by, of its radius, where nothing of it is judged."""


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
class _Pixels:
    """Judged pixels about a spot."""

    at: NDArray
    """Columns and rows. Shape (n, 2)."""
    seen: NDArray
    """I. Shape (n, 3)."""
    under: NDArray
    """M. Shape (n, 3)."""
    inverse: NDArray
    """C^-1. Shape (n, 3, 3)."""


def middle_of(blob: Blob, picture: NDArray, parts: Sequence[Surprise]) -> Middle:
    """Return the middle of a spot, and how well it is known.

    Args:
        blob: Where it surprises.
        picture: What was seen, BGR. Shape (h, w, 3).
        parts: What differs from expectations that judge parts of the picture, the first that
            judges a pixel counts.

    Returns:
        Middle of the fitted disc. Its sigma is that of the fit, and grows with the share of the
        disc that no part judges. The blob's middle, known to its radius, where there is nothing to
        fit.
    """
    radius = float(np.sqrt(max(blob.area, _SMALLEST) / np.pi))
    pixels = _about(blob, radius, picture, parts)
    if pixels is None:
        return Middle(blob.u, blob.v, radius)
    x, covariance, rest = _disc(pixels, np.array([blob.u, blob.v, radius]))
    if np.hypot(x[0] - blob.u, x[1] - blob.v) > radius + _AROUND:
        return Middle(blob.u, blob.v, radius)
    judged = min(float(_covered(pixels, x)[1].sum()) / (np.pi * x[2] ** 2), 1.0)
    own = 0.5 * np.trace(covariance[:2, :2]) * max(rest, 1.0)
    return Middle(
        float(x[0]), float(x[1]), float(np.hypot(np.sqrt(own), _UNSEEN * (1.0 - judged) * x[2]))
    )


def _about(
    blob: Blob, radius: float, picture: NDArray, parts: Sequence[Surprise]
) -> _Pixels | None:
    """Return the judged pixels about a spot; None where there are hardly any."""
    reach = int(np.ceil(radius)) + _AROUND
    column, row = round(blob.u), round(blob.v)
    first = [max(at - reach - _BEYOND, 0) for at in (row, column)]
    window = tuple(
        slice(start, at + reach + _BEYOND + 1)
        for start, at in zip(first, (row, column), strict=True)
    )
    inside: NDArray = np.indices(picture[window].shape[:2])
    rows, columns = inside[0] + first[0], inside[1] + first[1]
    left = np.hypot(columns - blob.u, rows - blob.v) <= reach
    found: list[tuple[NDArray, ...]] = []
    for part in parts:
        expected = part.expected
        if expected is None:
            continue
        sigma = np.where(left, expected.pixel_sigma[window], np.nan)
        if not np.isfinite(sigma).any():
            continue
        own = replace(expected, picture=expected.picture[window], pixel_sigma=sigma)
        judged, off, alike, noise, _ = held_against(picture[window], own, part.gain)
        seen = picture[window][judged].astype(float)
        at = np.stack([columns[judged], rows[judged]], axis=1).astype(float)
        found.append((at, seen, seen - off, np.linalg.inv(alike + noise * np.eye(3))))
        left &= ~judged
    if sum(len(at) for at, *_ in found) < _SMALLEST:
        return None
    return _Pixels(*(np.concatenate(each) for each in zip(*found, strict=True)))


def _covered(pixels: _Pixels, x: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return distances from a disc's middle, how far it covers pixels, and the slope of that."""
    apart = np.linalg.norm(pixels.at - x[:2], axis=1)
    edge = np.tanh((apart - x[2]) / _SOFT)
    return apart, 0.5 * (1.0 - edge), 0.5 * (1.0 - edge**2) / _SOFT


def _disc(pixels: _Pixels, start: NDArray) -> tuple[NDArray, NDArray, float]:
    """Fit middle and radius; return them, their covariance, and the mean square of what is left."""
    x, H, rest = start, np.eye(3), 1.0
    for _ in range(_STEPS):
        apart, covered, slope = _covered(pixels, x)
        share, weight = _shares(pixels, apart, covered)
        off = share - covered
        J = np.column_stack([slope[:, None] * (pixels.at - x[:2]) / (apart[:, None] + 1e-9), slope])
        H = (J * weight[:, None]).T @ J + np.diag([1e-3, 1e-3, _RADIUS_SIGMA**-2])
        g = (J * weight[:, None]).T @ off
        g[2] += (start[2] - x[2]) / _RADIUS_SIGMA**2
        step = np.linalg.solve(H, g)
        size = float(np.abs(step).max())
        x = x + step * min(1.0, _LONGEST / max(size, 1e-12))
        x[2] = max(x[2], 1.0)
        rest = float(weight @ off**2) / max(len(off) - 3, 1)
        if size < _ARRIVED:
            break
    return x, np.linalg.inv(H), rest


def _shares(pixels: _Pixels, apart: NDArray, covered: NDArray) -> tuple[NDArray, NDArray]:
    """Return which shares of pixels are covered by the paint of a disc, and their weights."""
    inner = np.maximum(covered - 0.5, 0.0) + 1e-6 * np.exp(-apart)
    paint = inner @ pixels.seen / inner.sum()
    step = paint - pixels.under
    by = np.einsum("nij,nj->ni", pixels.inverse, step)
    told = np.maximum(np.sum(by * step, axis=1), 1e-9)
    share = np.sum(by * (pixels.seen - pixels.under), axis=1) / told
    return share, 1.0 / (1.0 / told + _SHAPE**2)
