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
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

_At = tuple[NDArray, NDArray]
"""Rows and columns of pixels."""
_BLUR = 0.8
"""Standard deviation of the filter under which edges are smooth enough to be sampled [px]."""
_STEPS = 10
"""The half-integer place next to the corner is found in two or three."""
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
        places, twice = corners - low, np.zeros((len(corners), 2), dtype=int)
        found = _Turned(places, *np.ones((3, len(corners))))
        for _ in range(_STEPS):
            before, twice = twice, np.rint(2.0 * places).astype(int)
            if np.array_equal(before, twice):
                break
            found = window.turned(twice, radius)
            places = 0.5 * twice + np.clip(found.step, -_FARTHEST, _FARTHEST)
        return cls(places + low, found.sameness, found.contrast, found.along)


@dataclass(frozen=True, eq=False)
class _Turned:
    """What half a turn about half-integer places tells; as in `Crossings`."""

    step: NDArray
    """From these to the places of symmetry. Shape (n, 2) [px]."""
    sameness: NDArray
    contrast: NDArray
    along: NDArray


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
        steps = np.arange(-half, half + 1)
        self.around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        self.image, self.slopes = _smooth(gray)
        self.size = np.array(gray.shape[::-1])

    def halves(self, twice: NDArray, radius: NDArray) -> tuple[NDArray, _At, _At]:
        """Return weights of pixels around places and opposite, (n, k), and indices of both.

        Args:
            twice: Twice the places, whole numbers. Shape (n, 2).
            radius: Beyond which weights are zero. Shape (n,).
        """
        one = twice[:, None] // 2 + self.around
        other = twice[:, None] - one
        inside = ((np.minimum(one, other) >= 0) & (np.maximum(one, other) < self.size)).all(axis=2)
        share = np.sum((one - 0.5 * twice[:, None]) ** 2, axis=2) / radius[:, None] ** 2
        weight = np.where(inside, np.maximum(1.0 - share, 0.0) ** 2, 0.0)
        first, second = (np.clip(part, 0, self.size - 1) for part in (one, other))
        return weight, (first[..., 1], first[..., 0]), (second[..., 1], second[..., 0])

    def turned(self, twice: NDArray, radius: NDArray) -> _Turned:
        """Compare what is around places with itself after half a turn; as `halves`."""
        weight, one, other = self.halves(twice, radius)
        weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
        here, off = self.image[one], self.image[other] - self.image[one]
        slope = self.slopes[one] - self.slopes[other]
        b = np.einsum("nk,nka,nk->na", weight, slope, off)
        told, vectors = np.linalg.eigh(np.einsum("nk,nka,nkb->nab", weight, slope, slope))
        step = _along(vectors, b, 1.0 / np.maximum(told, 1e-9 * told[:, 1:] + 1e-12))
        middle = np.sum(weight * here, axis=1, keepdims=True)
        power = np.sum(weight * (here - middle) ** 2, axis=1)
        unlike = np.sum(weight * (off - np.einsum("nka,na->nk", slope, step)) ** 2, axis=1)
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
    for rows in (np.flatnonzero(level == one) for one in np.unique(level)):
        rows = rows[np.isfinite(corners[rows, 0])]
        if len(rows) < 3:
            continue
        p = corners[rows] - corners[rows].mean(axis=0)
        chord = np.linalg.svd(p, full_matrices=False)[2][0]
        aside = np.array([-chord[1], chord[0]])
        curve = Chebyshev.fit(p @ chord, p @ aside, min(len(rows) - 1, _DEGREE))
        slope, bend = (curve.deriv(m)(p @ chord) for m in (1, 2))
        length = np.hypot(1.0, slope)
        normals[rows] = (aside - slope[:, None] * chord) / length[:, None]
        curvatures[rows] = bend / length**3
    return normals, curvatures


def _smooth(gray: NDArray) -> tuple[NDArray, NDArray]:
    """Return a picture under a Gaussian filter, and its derivatives, (h, w) and (h, w, 2)."""
    reach = int(np.ceil(4.0 * _BLUR))
    steps = np.arange(-reach, reach + 1.0)
    bell = np.exp(-0.5 * (steps / _BLUR) ** 2)
    slope = steps * bell
    bell, slope = bell / bell.sum(), slope / (slope @ steps)
    light = gray.astype(np.float32)
    parts = [cv2.sepFilter2D(light, -1, *kernels) for kernels in ((slope, bell), (bell, slope))]
    return cv2.sepFilter2D(light, -1, bell, bell), np.stack(parts, axis=-1)
