"""Corners of a square marker from the edges of its black border, without bias.

A corner is a bad place to look at: blur rounds it off. Each side is located along its whole length
instead, by the area under the brightness across it, which no symmetric blur moves; a line goes
through that, and the lines meet in the corners.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

_POSITIONS = 40  # along a side
_DEPTHS = 25  # across it
_REACH = 0.75  # of a cell, to both sides of an edge: black within, white without
_WIDEST, _NARROWEST = 4.0, 1.2  # that reach [px]
_PASSES = 6
_SETTLED = 0.005  # [px]; OpenCV looks at places rounded to 1/32 px, which never settles further
_NEARLY_SETTLED = 0.1  # after all passes; what still moves has no end [px]
_LEAST_CONTRAST = 12.0  # grey levels between black and white
_LEAST_VISIBLE = 0.6  # of the positions along a side
_EVENLY, _ACROSS = np.linspace(0.0, 1.0, _POSITIONS), np.linspace(-1.0, 1.0, _DEPTHS)
_ENDS = 3  # of the depths, that tell black and white
# What is needed of a profile: its ends, and the area under it by the trapezoidal rule.
_TAKEN = np.zeros((_DEPTHS, 3))
_TAKEN[:_ENDS, 0] = _TAKEN[-_ENDS:, 1] = 1.0 / _ENDS
_TAKEN[:, 2] = 2.0 / (_DEPTHS - 1)
_TAKEN[[0, -1], 2] *= 0.5
_PIECES = 8  # of a side, that lie on one line ...
_STRAIGHT = 0.22  # ... within this [px]
_BENT_FROM = 60.0  # but for lenses, which bend longer sides, with the length squared [px]


def corners_from_edges(gray: NDArray, corners: NDArray, cells: int) -> NDArray | None:
    """Locate the corners of a marker from its edges.

    Args:
        gray: The image, 8 bits. Shape (h, w).
        corners: Where the corners are to within about a fifth of a cell or a pixel. Shape (4, 2).
        cells: Cells along a side, with the black border, which is one cell wide.

    Returns:
        Shape (4, 2); None where the edges are not plain to see or lead somewhere else.
    """
    before = refined = corners.astype(float)
    straight = False
    for _ in range(_PASSES):
        before = refined
        edges = _edges(gray, refined, _inner_corners(refined, cells))
        if edges is None:
            return None
        points, ways, straight = edges
        refined = _meet(np.roll(points, 1, axis=0), np.roll(ways, 1, axis=0), points, ways)
        if not np.isfinite(refined).all():
            return None
        moved = np.linalg.norm(refined - corners, axis=1).max()
        if moved > max(3.0, np.linalg.norm(corners[0] - corners[2]) / cells):
            return None
        if np.abs(refined - before).max() < _SETTLED:
            break
    settled = np.abs(refined - before).max() < _NEARLY_SETTLED
    return refined if straight and settled else None


def _edges(gray: NDArray, corners: NDArray, inner: NDArray) -> tuple[NDArray, NDArray, bool] | None:
    """Return a point on the edge after each corner, its direction, and if all are straight.

    None where one of them is not plain to see. Shapes (4, 2).
    """
    sides = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(sides[:, 0], sides[:, 1])
    along = sides / length[:, None]
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1)
    inwards = np.sum(outwards * (corners.mean(axis=0) - corners), axis=1) > 0.0
    outwards[inwards] *= -1.0
    far = np.stack([inner, np.roll(inner, -1, axis=0)], axis=1) - corners[:, None]
    border = np.abs(np.sum(far * outwards[:, None], axis=2)).min(axis=1)
    reach = np.clip(_REACH * border, _NARROWEST, _WIDEST)
    margin = np.clip(2.5 / length, 0.06, 0.3)  # of the side, at corners that blur has rounded
    share = margin[:, None] + (1.0 - 2.0 * margin[:, None]) * _EVENLY
    positions = share * length[:, None]
    u, v = (
        (corners[:, k, None] + positions * along[:, k, None])[:, :, None]
        + (reach * outwards[:, k])[:, None, None] * _ACROSS
        for k in (0, 1)
    )
    lines = _located(gray, u, v, positions - 0.5 * length[:, None], reach)
    if lines is None:
        return None
    slope, shift, off = lines
    bent = np.maximum(1.0, (length / _BENT_FROM) ** 2)
    points = corners + 0.5 * sides + shift[:, None] * outwards
    return points, along + slope[:, None] * outwards, bool(np.all(off < _STRAIGHT * bent))


def _located(
    gray: NDArray, u: NDArray, v: NDArray, x: NDArray, reach: NDArray
) -> tuple[NDArray, NDArray, NDArray] | None:
    """Return slope and shift of the line that each edge lies on, and how far pieces are off it.

    Args:
        gray: The image. Shape (h, w).
        u: Columns that are looked at, from within outwards. Shape (4, n, depths).
        v: Rows. The same.
        x: Positions along the edges, from the middle [px]. Shape (4, n).
        reach: How far it is looked to both sides [px]. Shape (4,).

    Returns:
        Shapes (4,); None where an edge is not plain to see.
    """
    height, width = gray.shape
    # A row of profiles is a rectangle: where its corners are in view all of it is.
    tips = np.s_[:, :: u.shape[1] - 1, :: _DEPTHS - 1]
    columns, rows = u[tips], v[tips]
    if min(columns.min(), rows.min()) >= 0.0 and (
        columns.max() <= width - 1.0 and rows.max() <= height - 1.0
    ):
        return _fitted(gray, u, v, x, reach)
    there = (u >= 0.0) & (u <= width - 1.0) & (v >= 0.0) & (v <= height - 1.0)
    visible = there.all(axis=2)
    if visible.mean(axis=1).min() < _LEAST_VISIBLE:
        return None
    # A side that leaves the image has fewer positions than the others.
    found = []
    for k in range(4):
        side, kept = slice(k, k + 1), visible[k]
        one = _fitted(gray, u[side, kept], v[side, kept], x[side, kept], reach[side])
        if one is None:
            return None
        found.append(one)
    slope, shift, off = (np.concatenate(values) for values in zip(*found, strict=True))
    return slope, shift, off


def _fitted(
    gray: NDArray, u: NDArray, v: NDArray, x: NDArray, reach: NDArray
) -> tuple[NDArray, NDArray, NDArray] | None:
    """Do the same for edges that are in view, all of them at once."""
    maps = [places.astype(np.float32).reshape(-1, _DEPTHS) for places in (u, v)]
    profiles = cv2.remap(gray, maps[0], maps[1], cv2.INTER_LINEAR)
    offsets = _offsets(profiles.astype(float) @ _TAKEN, x, reach)
    if offsets is None:
        return None
    slope, shift = _robust_line(x, offsets)
    return slope, shift, _off_line(offsets - slope[:, None] * x - shift[:, None])


def _inner_corners(corners: NDArray, cells: int) -> NDArray:
    """Return where the black border ends inwards, nan where the corners are on a line. (4, 2).

    The square's homography in closed form (Heckbert 1989, Fundamentals of texture mapping).
    """
    p0, p1, p2, p3 = corners
    one, two, excess = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    area = one[0] * two[1] - two[0] * one[1]
    if abs(area) < 1e-12:
        return np.full((4, 2), np.nan)
    g = (excess[0] * two[1] - two[0] * excess[1]) / area
    h = (one[0] * excess[1] - excess[0] * one[1]) / area
    low, high = 1.0 / cells, 1.0 - 1.0 / cells
    u, v = np.array([[low, high, high, low], [low, low, high, high]])[:, :, None]
    return ((p1 - p0 + g * p1) * u + (p3 - p0 + h * p3) * v + p0) / (g * u + h * v + 1.0)


def _offsets(taken: NDArray, x: NDArray, reach: NDArray) -> NDArray | None:
    """Return where along each profile black ends [px], or None if it is not black then white.

    Args:
        taken: Of each profile its black, its white and the area under it. Shape (sides n, 3).
        x: Positions along the sides [px]. Shape (sides, n).
        reach: How far profiles reach to both sides of the edges [px]. Shape (sides,).
    """
    ends = np.moveaxis(taken.reshape(*x.shape, 3), 2, 0)
    # Light may fall off along the edge.
    black, white = (_along(_line(x, one, np.ones_like(x)), x) for one in ends[:2])
    contrast = white - black
    if contrast.min() < _LEAST_CONTRAST:
        return None
    return reach[:, None] * ((2.0 * white - ends[2]) / contrast - 1.0)


def _robust_line(x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Return slopes and values at x = 0 of lines; points far from the others do not count."""
    count, line = x.shape[1], _line(x, y, np.ones_like(x))
    for _ in range(3):
        residuals = np.abs(y - _along(line, x))
        ordered = np.sort(residuals, axis=1)
        median = 0.5 * (ordered[:, (count - 1) // 2] + ordered[:, count // 2])
        scale = 2.4 * np.maximum(1.4826 * median, 0.01)
        line = _line(x, y, 1.0 / (1.0 + (residuals / scale[:, None]) ** 2))
    return line


def _off_line(residuals: NDArray) -> NDArray:
    """Return by how much pieces of a side lie off its line, all but those a finger hides [px].

    Where a corner was taken for that of the paper, the side is black and white only in part.
    """
    count = residuals.shape[1]
    small, longer = divmod(count, _PIECES)
    sizes = np.where(np.arange(_PIECES) < longer, small + 1, small)
    starts = np.cumsum(sizes) - sizes
    pieces = np.sort(np.abs(np.add.reduceat(residuals, starts, axis=1) / sizes), axis=1)
    at = 0.7 * (_PIECES - 1)
    low, share = int(at), at - int(at)
    return (1.0 - share) * pieces[:, low] + share * pieces[:, low + 1]


def _line(x: NDArray, y: NDArray, w: NDArray) -> tuple[NDArray, NDArray]:
    """Return slopes and values at x = 0 of weighted least squares lines along the last axis."""
    wx = w * x
    total, first, second = w.sum(axis=1), wx.sum(axis=1), (wx * x).sum(axis=1)
    level, mixed = (w * y).sum(axis=1), (wx * y).sum(axis=1)
    slope = (total * mixed - first * level) / (total * second - first * first)
    return slope, (level - slope * first) / total


def _along(line: tuple[NDArray, NDArray], x: NDArray) -> NDArray:
    slope, shift = line
    return slope[:, None] * x + shift[:, None]


def _meet(p: NDArray, d: NDArray, q: NDArray, e: NDArray) -> NDArray:
    """Return where lines through p along d meet those through q along e; nan if parallel."""
    area = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    between = q - p
    crossed = between[:, 0] * e[:, 1] - between[:, 1] * e[:, 0]
    area[np.abs(area) < 1e-6] = np.nan
    return p + d * (crossed / area)[:, None]
