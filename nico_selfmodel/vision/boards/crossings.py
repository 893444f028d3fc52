"""Where two edges cross, to a hundredth of a pixel: the place about which a picture is symmetric.

`cornerSubPix` takes pixels between pixels as the mean of their neighbours. Of sharp edges that is
off by up to 0.04 px, by where in its pixel a corner lies: corners of one picture err alike, and
focal lengths learned from them with too small a sigma. A crossing looks the same after half a turn
about itself. With S(d) the picture about the corner c, and p a half-integer place near it, where
each pixel p + d has a pixel p - d of its own and nothing is interpolated,

    I(p + d) - I(p - d) = -2 (c - p) . grad S(d) + O(|c - p|^3)

which tells c - p by least squares, weighted by (1 - d^2 / R^2)^2.

Behind a lens edges are curved: both arms of an edge leave its tangent on the same side, by
k s^2 / 2 at a distance s, and blur moves them to the inside of the curve. So the place is off along
the normal of each edge by k <s^2> / 2, the mean over what is seen of it; corners on the same line
of the board tell k.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.polynomial.chebyshev import chebder, chebval, chebvander
from numpy.typing import NDArray

_BLUR = 0.8
"""Standard deviation of the filter under which edges are smooth enough to be sampled [px]."""
_STEPS = 10
"""A half-integer place next to the corner is found in two or three."""
_NEAR = 0.26
"""How far the corner lies from such a place, along either axis: more than a quarter, for one in the
middle between two would go to and fro [px]."""
_ALONG = (1.0 / 7.0, 0.32, 2.4)
"""Mean square of how far along an edge it is seen, by the radius [px]: the first is that of a sharp
edge, the others of one as blurred as photographs are (0.7 px), found from drawn ones."""
_ROOM = 20.0
"""Around all windows in the part of a picture that is looked at [px]."""
_FARTHEST = 2.0
"""Largest step: a first guess is off by a pixel or two [px]."""
_DEGREE = 4
"""Of the polynomial that an edge is."""
_LEVELS = 1e6
"""Shares of a board's height below which lines are the same."""
_EDGE_ON = 0.1
"""Sine of the angle between two edges below which their crossing is too vague to be mended."""


@dataclass(frozen=True, eq=False)
class Crossings:
    """Places of symmetry, and how plain they are."""

    places: NDArray
    """Shape (n, 2) [px]."""
    sameness: NDArray
    """Correlation of what is around with itself after half a turn about the place. Shape (n,)."""
    contrast: NDArray
    """Standard deviation of what is around [grey levels]. Shape (n,)."""
    along: NDArray
    """How well the worse direction is told, over the better: next to nothing in the middle of a
    stripe, which looks the same after half a turn, too. Shape (n,)."""

    @classmethod
    def near(cls, gray: NDArray, corners: NDArray, radius: NDArray) -> "Crossings":
        """Return the places about which a picture looks the same after half a turn.

        Args:
            gray: The image, 8 bits. Shape (h, w).
            corners: Where they are to a pixel or two. Shape (n, 2).
            radius: Within which nothing but the crossing counts [px]. Shape (n,).
        """
        part, low = _around(gray, corners, float(radius.max(initial=1.0)) + _ROOM)
        window = _Window(part, float(radius.max(initial=1.0)))
        places, twice = corners - low, np.full((len(corners), 2), -9)
        found = _Turned(np.zeros_like(places), *np.ones((3, len(corners))))
        for _ in range(_STEPS):
            new = np.flatnonzero((np.abs(places - 0.5 * twice) > _NEAR).any(axis=1))
            if not len(new):
                break
            twice[new] = np.rint(2.0 * places[new]).astype(int)
            found.take(new, window.turned(twice[new], radius[new]))
            places[new] = 0.5 * twice[new] + np.clip(found.step[new], -_FARTHEST, _FARTHEST)
        return cls(places + low, found.sameness, found.contrast, found.along)


@dataclass(frozen=True, eq=False)
class _Turned:
    """What half a turn about half-integer places tells; as in `Crossings`."""

    step: NDArray
    """From these to the places of symmetry. Shape (n, 2) [px]."""
    sameness: NDArray
    contrast: NDArray
    along: NDArray

    def take(self, rows: NDArray, other: "_Turned") -> None:
        """Put what was found about some of the places where they stand; indices, shape (k,)."""
        for mine, its in zip(vars(self).values(), vars(other).values(), strict=True):
            mine[rows] = its


def _along(vectors: NDArray, b: NDArray, size: NDArray) -> NDArray:
    """Return V diag(size) V' b. Shapes (n, 2, 2), (n, 2), (n, 2) -> (n, 2)."""
    return np.einsum("nij,nj,nkj,nk->ni", vectors, size, vectors, b)


def _around(gray: NDArray, corners: NDArray, room: float) -> tuple[NDArray, NDArray]:
    """Return the part of a picture that holds corners, and its upper left pixel."""
    size = np.array(gray.shape[::-1])
    low = np.clip(np.floor(corners.min(axis=0, initial=np.inf) - room), 0, size - 1).astype(int)
    high = np.clip(np.ceil(corners.max(axis=0, initial=0.0) + room), low + 1, size).astype(int)
    return gray[low[1] : high[1], low[0] : high[0]], low


class _Window:
    """A smooth picture, and what of it lies around places."""

    def __init__(self, gray: NDArray, widest: float) -> None:
        """Smooth a picture for windows of a radius."""
        half = int(np.ceil(widest)) + 1
        steps = np.arange(-half, half + 1, dtype=np.int32)
        self.down, self.right = (part.ravel() for part in np.meshgrid(steps[half:], steps))
        # Of each pair of opposite pixels one tells all: those farther down, or to the right.
        kept = (self.down > 0) | (self.right >= 0)
        self.down, self.right = self.down[kept], self.right[kept]
        self.image, self.slopes = _smooth(gray)
        self.size = gray.shape

    def halves(self, twice: NDArray, radius: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return weights of pairs of opposite pixels around places, and both, line by line.

        Args:
            twice: Twice the places, whole numbers. Shape (n, 2).
            radius: Beyond which weights are zero. Shape (n,).

        Returns:
            Shape (n, k) each.
        """
        ends, share, inside = [], 0.0, True
        twice, size = twice.astype(np.int32), (0.5 / radius[:, None]).astype(np.float32)
        for axis, steps in ((1, self.down), (0, self.right)):
            whole, limit = twice[:, axis, None], self.size[1 - axis]
            one = whole // 2 + steps
            other = whole - one
            share = share + ((one - other) * size) ** 2
            inside = inside & (np.minimum(one, other) >= 0) & (np.maximum(one, other) < limit)
            ends.append((np.clip(one, 0, limit - 1), np.clip(other, 0, limit - 1)))
        weight = np.where(inside, np.maximum(np.float32(1.0) - share, 0.0) ** 2, np.float32(0.0))
        odd = twice[:, ::-1, None] % 2 == 1
        # About the middle of pixels a row or column has its opposite among the others: not twice.
        level = self.down == 0
        weight[(odd[:, 0] & level) | (odd[:, 1] & level & (self.right == 0))] = 0.0
        weight[:, level & (self.right == 0)] *= 0.5
        (row, row_beyond), (column, column_beyond) = ends
        return weight, row * self.size[1] + column, row_beyond * self.size[1] + column_beyond

    def turned(self, twice: NDArray, radius: NDArray) -> _Turned:
        """Compare what is around places with itself after half a turn; as `halves`."""
        weight, one, other = self.halves(twice, radius)
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
        here, there = self.image.take(one), self.image.take(other)
        off, mean = there - here, 0.5 * (here + there)
        right, down = (slope.take(one) - slope.take(other) for slope in self.slopes)
        each = np.stack([right, down, off, mean], axis=1)
        sums = np.asarray((each * weight[:, None]) @ each.swapaxes(1, 2), dtype=float)
        b, H = sums[:, :2, 2], sums[:, :2, :2]
        told, vectors = np.linalg.eigh(H)
        step = _along(vectors, b, 1.0 / np.maximum(told, 1e-9 * told[:, 1:] + 1e-12))
        middle = np.einsum("nk,nk->n", weight, mean, dtype=float)
        power = np.maximum(sums[:, 3, 3] + 0.25 * sums[:, 2, 2] - middle**2, 0.0)
        bent = np.einsum("na,nab,nb->n", step, H, step)
        unlike = sums[:, 2, 2] - 2.0 * np.sum(b * step, axis=1) + bent
        same = 1.0 - 0.5 * unlike / np.maximum(power, 1e-12)
        return _Turned(step, same, np.sqrt(power), told[:, 0] / np.maximum(told[:, 1], 1e-12))


def straightened(points: NDArray, corners: NDArray, radius: NDArray) -> NDArray:
    """Take off what curved edges move places of symmetry by.

    Args:
        points: The board's points, in any unit. Shape (P, 2).
        corners: Places of symmetry, nan where not seen [px]. Shape (P, 2).
        radius: Of which. Shape (P,).

    Returns:
        Shape (P, 2); unchanged where the other corners tell the curvature of no edge.
    """
    along = [_curvatures(points[:, axis], corners) for axis in (1, 0)]
    normals = np.stack([normal for normal, _ in along], axis=1)
    curvatures = np.stack([curvature for _, curvature in along], axis=1)
    known = np.asarray(np.isfinite(normals).all(axis=(1, 2)))
    crossed = np.linalg.det(np.where(known[:, None, None], normals, 0.0))
    told = np.abs(crossed) > _EDGE_ON
    shift = np.zeros_like(corners)
    seen = np.polyval(_ALONG, radius[told])
    off = 0.5 * seen[:, None] * curvatures[told]
    shift[told] = np.linalg.solve(normals[told], off[:, :, None])[:, :, 0]
    return corners - shift


def _curvatures(line: NDArray, corners: NDArray) -> tuple[NDArray, NDArray]:
    """Return normals and curvatures of the edge through each corner along one axis of the board.

    In the image each line of the board is a polynomial over its chord, however it is foreshortened.

    Args:
        line: Coordinates across the axis, equal on a line. Shape (P,).
        corners: Where they were found, nan where not seen [px]. Shape (P, 2).

    Returns:
        Shapes (P, 2), nan where no edge is told, and (P,) [1/px].
    """
    normals, curvatures = np.full_like(corners, np.nan), np.zeros(len(corners))
    level = np.rint((line - line.min()) / max(float(np.ptp(line)), 1e-12) * _LEVELS)
    seen = np.flatnonzero(np.isfinite(corners[:, 0]))
    _, which, counts = np.unique(level[seen], return_inverse=True, return_counts=True)
    in_lines = seen[np.argsort(which, kind="stable")]
    for count in np.unique(counts[counts >= 3]).tolist():
        rows = in_lines[np.repeat(counts == count, counts)].reshape(-1, count)
        normals[rows], curvatures[rows] = _bends(corners[rows])
    return normals, curvatures


def _bends(lines: NDArray) -> tuple[NDArray, NDArray]:
    """Return normals and curvatures of lines. Shape (L, m, 2) -> (L, m, 2) and (L, m)."""
    p = lines - lines.mean(axis=1, keepdims=True)
    chord = np.linalg.svd(p, full_matrices=False)[2][:, 0]
    aside = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    x, y = (np.einsum("lmi,li->lm", p, way) for way in (chord, aside))
    low, high = x.min(axis=1, keepdims=True), x.max(axis=1, keepdims=True)
    stretch = 2.0 / np.maximum(high - low, 1e-12)
    at = (x - low) * stretch - 1.0
    powers = chebvander(at, min(lines.shape[1] - 1, _DEGREE))
    # Of points in one place no curve is told: the smallest one is taken.
    curve = (np.linalg.pinv(powers) @ y[:, :, None]).swapaxes(0, 1)
    slope, bend = (chebval(at, chebder(curve, m), tensor=False) * stretch**m for m in (1, 2))
    length = np.hypot(1.0, slope)
    normals = aside[:, None] - slope[:, :, None] * chord[:, None]
    return normals / length[:, :, None], bend / length**3


def _smooth(gray: NDArray) -> tuple[NDArray, list[NDArray]]:
    """Return a picture under a Gaussian filter, and both its derivatives. Shape (h, w) each."""
    reach = int(np.ceil(4.0 * _BLUR))
    steps = np.arange(-reach, reach + 1.0)
    bell = np.exp(-0.5 * (steps / _BLUR) ** 2)
    slope = steps * bell
    bell, slope = bell / bell.sum(), slope / (slope @ steps)
    light = gray.astype(np.float32)
    parts = [cv2.sepFilter2D(light, -1, *kernels) for kernels in ((slope, bell), (bell, slope))]
    return cv2.sepFilter2D(light, -1, bell, bell), parts
