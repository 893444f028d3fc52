"""Where two edges cross, to a hundredth of a pixel: the place about which a picture is symmetric.

`cornerSubPix` takes pixels between pixels as the mean of their neighbours. Of sharp edges that is
off by up to 0.04 px, by where in its pixel a corner lies: corners of one picture err alike, and
focal lengths learned from them with too small a sigma. A crossing looks the same after half a turn
about itself. With S(d) the picture about the corner c, and p a half-integer place near it, where
each pixel p + d has a pixel p - d of its own and nothing is interpolated,

    I(p + d) - I(p - d) = -2 (c - p) . grad S(d) + O(|c - p|^3)

which tells c - p by least squares, weighted by (1 - d^2 / R^2)^2. Light that rises from side to
side by 2 a . d is told with it in windows that are not small: without, what is 80 % lighter at one
end of a picture moved all corners alike by 0.03 px, and vignetting by 0.06.

Behind a lens edges are curved: both arms of an edge leave its tangent on the same side, by
k s^2 / 2 at a distance s, and blur moves them to the inside of the curve. So the place is off along
the normal of each edge by k <s^2> / 2, the mean over what is seen of it; corners on the same line
of the board tell k.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.polynomial.chebyshev import chebder, chebvander
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only

_BLUR = 0.8
"""Standard deviation of the filter under which edges are smooth enough to be sampled [px]."""
_REACH = 3
"""Of that filter, to either side [px]."""
_STEPS = 10
"""A half-integer place next to the corner is found in two or three."""
_NEAR = 0.26
"""How far the corner lies from such a place, along either axis: more than a quarter, for one in the
middle between two would go to and fro [px]."""
_ALONG, _ALONG_LIT = (1.0 / 7.0, 0.32, 2.4), (0.136, 0.15, 0.46)
"""Mean square of how far along an edge it is seen, by the radius [px]: the first is that of a sharp
edge, the others of one as blurred as photographs are (0.7 px), found from drawn ones; and the same
where light that rises is told with a place, which looks a little like a curve."""
_ROOM = 8.0
"""Around all windows in the part of a picture that is looked at: what the filter reaches [px]."""
_LIT, _AT = 6.0, 0.5
"""Radius from which on, and distance within which, a place that lies elsewhere is told from light
that rises from side to side [px]."""
_FARTHEST = 2.0
"""Largest step: a first guess is off by a pixel or two [px]."""
_DEGREE = 4
"""Of the polynomial that an edge is."""
_SLOPE = np.vstack([chebder(np.eye(_DEGREE + 1)), np.zeros(_DEGREE + 1)])
"""From coefficients of such a polynomial, Chebyshev's, to those of its derivative."""
_NO_CURVE = 1e-9
"""What keeps a curve that points do not tell at nothing, over what one of them tells."""
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
        if not len(corners):
            return cls(corners, *np.zeros((3, 0)))
        window = _Window.around(gray, corners, float(radius.max()))
        start = corners - window.corner
        places, twice = start.copy(), np.full((len(corners), 2), -9)
        found = _Turned(np.zeros_like(places), *np.ones((3, len(corners))))
        for _ in range(_STEPS):
            new = np.flatnonzero((np.abs(places - 0.5 * twice) > _NEAR).any(axis=1))
            if not len(new):
                break
            twice[new] = np.rint(2.0 * places[new]).astype(int)
            found.take(new, window.turned(twice[new], radius[new]))
            moved = 0.5 * twice[new] + np.clip(found.step[new], -_FARTHEST, _FARTHEST)
            places[new] = np.clip(moved, start[new] - window.widest, start[new] + window.widest)
        return cls(places + window.corner, found.sameness, found.contrast, found.along)


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


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of opposite pixels around places that lie on pixels or half way between."""

    half: int
    """Pixels from the middle to the farthest, either way."""
    right: NDArray
    """Pixels from a place to one of each pair, or to the one after where it lies between two: those
    farther down, or to the right, of which each tells all. Shape (k,)."""
    down: NDArray
    ways: NDArray
    """The same from the places themselves, a share of the radius, for places on pixels, between two
    from left to right, up and down, and both. Shape (4, 2, k)."""
    squares: NDArray
    """Of how far each is [px^2]. Shape (4, k)."""
    once: NDArray
    """How often it counts. Shape (4, k)."""

    @classmethod
    @lru_cache(maxsize=8)
    def within(cls, widest: float) -> "_Pairs":
        """Return those of a disc of a radius [px]."""
        half = int(np.ceil(widest)) + 1
        steps = np.arange(-half, half + 1)
        down, right = (one.ravel() for one in np.meshgrid(steps[half:], steps))
        nearest = np.maximum(np.abs(right) - 0.5, 0.0) ** 2 + np.maximum(down - 0.5, 0.0) ** 2
        kept = ((down > 0) | (right >= 0)) & (nearest < widest**2)
        down, right = down[kept], right[kept]
        x, y = np.array([0.0, 0.5, 0.0, 0.5])[:, None], np.array([0.0, 0.0, 0.5, 0.5])[:, None]
        ways = np.stack([right - x, down - y], axis=1)
        level, middle = down == 0, (down == 0) & (right == 0)
        # About the middle of pixels a row or column has its opposite among the others: not twice.
        once = np.where(middle, 0.5, 1.0) * ~(level & (y > 0.0)) * ~(middle & (x > 0.0))
        each = (ways / widest, np.sum(ways**2, axis=1), once)
        each = (read_only(one.astype(np.float32)) for one in each)
        return cls(half, read_only(right), read_only(down), *each)


class _Window:
    """A smooth part of a picture, and what of it lies around places."""

    def __init__(self, part: NDArray, corner: NDArray, size: NDArray, widest: float) -> None:
        """Smooth a part of a picture.

        Args:
            part: What is around all windows, of the picture's edge where it ends. Shape (h, w).
            corner: Its upper left pixel in the picture.
            size: Width and height of the picture.
            widest: Radius of the largest window, and how far places move at most [px].
        """
        self.corner, self.widest, self.width = corner, widest, part.shape[1]
        self.first, self.last = -corner, size - 1 - corner
        """Pixels of the picture in the part."""
        self.images = _smooth(part).reshape(3, -1)
        self.pairs = _Pairs.within(widest)
        self.steps = self.pairs.down * self.width + self.pairs.right

    @classmethod
    def around(cls, gray: NDArray, corners: NDArray, widest: float) -> "_Window":
        """Return the part of a picture that holds windows of a radius near corners."""
        room, size = 2.0 * widest + _ROOM, np.array(gray.shape[::-1])
        low = np.floor(corners.min(axis=0) - room).astype(int)
        high = np.ceil(corners.max(axis=0) + room).astype(int) + 1
        (left, top), (right, bottom) = np.maximum(-low, 0), np.maximum(high - size, 0)
        part = gray[max(low[1], 0) : high[1], max(low[0], 0) : high[0]]
        if left or top or right or bottom:
            part = cv2.copyMakeBorder(part, top, bottom, left, right, cv2.BORDER_REPLICATE)
        return cls(part, low, size, widest)

    def halves(self, twice: NDArray, radius: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return weights of pairs of opposite pixels around places, and both, line by line.

        Args:
            twice: Twice the places, whole numbers. Shape (n, 2).
            radius: Beyond which weights are zero. Shape (n,).

        Returns:
            Shape (n, k) each.
        """
        odd, low = twice % 2, twice // 2
        first, more = (x + self.width * y for x, y in (low.T, odd.T))
        one, other = first[:, None] + self.steps, (first + more)[:, None] - self.steps
        phase, size = odd[:, 0] + 2 * odd[:, 1], (radius[:, None] ** -2.0).astype(np.float32)
        weight = np.maximum(np.float32(1.0) - self.pairs.squares[phase] * size, np.float32(0.0))
        weight *= weight
        weight *= self.pairs.once[phase]
        half = self.pairs.half
        cut = ((low - half < self.first) | (low + half >= self.last)).any(axis=1)
        if cut.any():
            weight[cut] *= self._in_picture(one[cut]) & self._in_picture(other[cut])
        return weight, one, other

    def _in_picture(self, index: NDArray) -> NDArray:
        """Tell which pixels of the part are the picture's own. Boolean, shape as given."""
        places = np.stack(np.divmod(index, self.width)[::-1], axis=-1)
        return np.asarray(((places >= self.first) & (places <= self.last)).all(axis=-1))

    def turned(self, twice: NDArray, radius: NDArray) -> _Turned:
        """Compare what is around places with itself after half a turn; as `halves`."""
        weight, one, other = self.halves(twice, radius)
        weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
        each = np.empty((6, *weight.shape), dtype=np.float32)
        # By how much slopes to the right and down and light differ, and light's sum.
        here, there = self.images.take(one, axis=1), self.images.take(other, axis=1)
        np.subtract(here, there, out=each[:3])
        np.add(here[2], there[2], out=each[3])
        each[4:] = self.pairs.ways[(twice % 2) @ np.array([1, 2])].swapaxes(0, 1)
        weighted, each = (rows.swapaxes(0, 1) for rows in (each * weight, each))
        sums = np.asarray(weighted @ each.swapaxes(1, 2), dtype=float)
        middle = 0.5 * weighted[:, 3].sum(axis=1, dtype=float)
        power = np.maximum(0.25 * (sums[:, 3, 3] + sums[:, 2, 2]) - middle**2, 0.0)
        b, H = -sums[:, :2, 2], sums[:, :2, :2]
        told, step = _solved(H, b)
        bent = np.einsum("na,nab,nb->n", step, H, step)
        unlike = sums[:, 2, 2] - 2.0 * np.sum(b * step, axis=1) + bent
        same = 1.0 - 0.5 * unlike / np.maximum(power, 1e-12)
        lit = np.flatnonzero((radius >= _LIT) & (np.abs(step).max(axis=1) < _AT))
        if len(lit):
            dark = _without_light(sums[lit])
            step[lit] = _solved(dark[:, :2, :2], -dark[:, :2, 2])[1]
        return _Turned(step, same, np.sqrt(power), told[:, 0] / np.maximum(told[:, 1], 1e-12))


def _without_light(sums: NDArray) -> NDArray:
    """Return sums of products of the first three rows, the last two eliminated.

    Shape (n, 6, 6) -> (n, 3, 3).
    """
    by_light = np.linalg.solve(sums[:, 4:, 4:], sums[:, 4:, :3])
    return np.asarray(sums[:, :3, :3] - sums[:, :3, 4:] @ by_light)


def _solved(H: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
    """Return eigenvalues of H, the lesser first, and H^-1 b, where nothing tells next to nothing.

    Shapes (n, 2, 2) and (n, 2) -> (n, 2) and (n, 2).
    """
    x, y, both = H[:, 0, 0], H[:, 1, 1], H[:, 0, 1]
    apart, mean = np.hypot(0.5 * (x - y), both), 0.5 * (x + y)
    told = np.stack([mean - apart, mean + apart], axis=1)
    least = 1e-9 * told[:, 1] + 1e-12
    x, y = x + least, y + least
    turned = np.stack([y * b[:, 0] - both * b[:, 1], x * b[:, 1] - both * b[:, 0]], axis=1)
    return told, turned / np.maximum(x * y - both * both, least * least)[:, None]


def straightened(points: NDArray, corners: NDArray, radius: NDArray) -> NDArray:
    """Take off what curved edges move places of symmetry by.

    Args:
        points: The board's points, in any unit. Shape (P, 2).
        corners: Places of symmetry, nan where not seen [px]. Shape (P, 2).
        radius: Of which. Shape (P,).

    Returns:
        Shape (P, 2); unchanged where the other corners tell the curvature of no edge.
    """
    normals, curvatures = np.full((len(points), 2, 2), np.nan), np.zeros((len(points), 2))
    seen = np.flatnonzero(np.isfinite(corners[:, 0]))
    rows, on, ways = _lines(points[seen])
    if len(rows):
        each, way = seen[rows], np.broadcast_to(ways[:, None], on.shape)[on]
        normal, curvature = _bends(corners[each], on)
        normals[each[on], way], curvatures[each[on], way] = normal[on], curvature[on]
    (a, b), (c, d) = np.moveaxis(normals, 0, 2)
    crossed = a * d - b * c
    told = np.abs(crossed) > _EDGE_ON
    seen_by = np.where(radius < _LIT, np.polyval(_ALONG, radius), np.polyval(_ALONG_LIT, radius))
    off = 0.5 * seen_by[:, None] * curvatures
    shift = np.stack([d * off[:, 0] - b * off[:, 1], a * off[:, 1] - c * off[:, 0]], axis=1)
    return np.where(told[:, None], corners - shift / np.where(told, crossed, 1.0)[:, None], corners)


def _lines(points: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return which corners lie on a line of the board, three of them at least.

    Args:
        points: The board's points, in any unit. Shape (n, 2).

    Returns:
        Indices and where there are any, lines by their corners, shape (L, m) each; and of each line
        0 where it runs along x, 1 along y, shape (L,).
    """
    if not len(points):
        return np.zeros((0, 0), dtype=int), np.zeros((0, 0), dtype=bool), np.zeros(0, dtype=int)
    across = points[:, ::-1].T  # equal on a line
    order, level = np.argsort(across, axis=1, kind="stable"), np.sort(across, axis=1)
    apart = np.maximum(level[:, -1:] - level[:, :1], 1e-12) / _LEVELS
    starts = np.ones(across.shape, dtype=bool)
    np.greater(level[:, 1:] - level[:, :-1], apart, out=starts[:, 1:])
    counts = np.bincount(np.cumsum(starts) - 1)
    on = np.arange(counts.max()) < counts[:, None]
    rows = np.zeros(on.shape, dtype=int)
    rows[on] = order.ravel()
    ways = (np.arange(len(counts)) >= starts[0].sum()).astype(int)
    told = counts >= 3
    return rows[told], on[told], ways[told]


def _bends(lines: NDArray, on: NDArray) -> tuple[NDArray, NDArray]:
    """Return normals and curvatures of the edge through each corner of lines.

    In the image each line of the board is a polynomial over its chord, however it is foreshortened.

    Args:
        lines: Corners [px]. Shape (L, m, 2).
        on: Where there are any. Shape (L, m).

    Returns:
        Shapes (L, m, 2) and (L, m) [1/px].
    """
    count, on = on.sum(axis=1), on[:, :, None]
    p = lines - np.sum(lines, axis=1, keepdims=True, where=on) / count[:, None, None]
    scatter = np.swapaxes(p, 1, 2) @ (p * on)
    turn = 0.5 * np.arctan2(2.0 * scatter[:, 0, 1], scatter[:, 0, 0] - scatter[:, 1, 1])
    chord = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    aside = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    x, y = p @ chord[:, :, None], p @ aside[:, :, None]
    low = x.min(axis=1, keepdims=True, where=on, initial=np.inf)
    high = x.max(axis=1, keepdims=True, where=on, initial=-np.inf)
    stretch = 2.0 / np.maximum(high - low, 1e-12)
    powers = chebvander(np.where(on, (x - low) * stretch - 1.0, 0.0)[:, :, 0], _DEGREE)
    # Of few points no more is told than a polynomial through all of them.
    told = powers * (on & (np.arange(_DEGREE + 1) < count[:, None, None]))
    # Of points in one place no curve is told: the smallest one is taken.
    curve = np.linalg.solve(
        np.swapaxes(told, 1, 2) @ told + _NO_CURVE * np.eye(_DEGREE + 1),
        np.swapaxes(told, 1, 2) @ y,
    )
    slope = stretch * (powers @ (_SLOPE @ curve))
    bend = stretch**2 * (powers @ (_SLOPE @ _SLOPE @ curve))
    length = np.hypot(1.0, slope)
    normals = (aside[:, None] - slope * chord[:, None]) / length
    return normals, (bend / length**3)[:, :, 0]


def _smooth(gray: NDArray) -> NDArray:
    """Return a picture's slopes to the right and down, and itself, under a Gaussian filter.

    Shape (h, w) -> (3, h, w).
    """
    steps = np.arange(-_REACH, _REACH + 1.0)
    bell = np.exp(-0.5 * (steps / _BLUR) ** 2)
    slope = steps * bell
    bell, slope = bell / bell.sum(), slope / (slope @ steps)
    found = np.empty((3, *gray.shape), dtype=np.float32)
    for k, pair in enumerate(((slope, bell), (bell, slope), (bell, bell))):
        cv2.sepFilter2D(gray, cv2.CV_32F, *pair, dst=found[k])
    return found
