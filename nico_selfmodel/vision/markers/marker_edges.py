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
        lines, straight = edges
        meets = [_meet(lines[side - 1], lines[side]) for side in range(4)]
        refined = np.stack(meets)
        if not np.isfinite(refined).all():
            return None
        moved = np.linalg.norm(refined - corners, axis=1).max()
        if moved > max(3.0, np.linalg.norm(corners[0] - corners[2]) / cells):
            return None
        if np.abs(refined - before).max() < _SETTLED:
            break
    settled = np.abs(refined - before).max() < _NEARLY_SETTLED
    return refined if straight and settled else None


def _edges(
    gray: NDArray, corners: NDArray, inner: NDArray
) -> tuple[list[tuple[NDArray, NDArray]], bool] | None:
    """Return a point on the edge after each corner, its direction, and if all are straight.

    None where one of them is not plain to see.
    """
    ends = np.roll(corners, -1, axis=0)
    length = np.linalg.norm(ends - corners, axis=1)
    along = (ends - corners) / length[:, None]
    outwards = np.stack([along[:, 1], -along[:, 0]], axis=1)
    inwards = np.sum(outwards * (corners.mean(axis=0) - corners), axis=1) > 0.0
    outwards[inwards] *= -1.0
    far = np.stack([inner, np.roll(inner, -1, axis=0)], axis=1) - corners[:, None]
    border = np.abs(np.sum(far * outwards[:, None], axis=2)).min(axis=1)
    reach = np.clip(_REACH * border, _NARROWEST, _WIDEST)
    margin = np.clip(2.5 / length, 0.06, 0.3)  # of the side, at corners that blur has rounded
    share = margin[:, None] + (1.0 - 2.0 * margin[:, None]) * _EVENLY
    positions = share * length[:, None]
    depths = reach[:, None] * _ACROSS
    points = corners[:, None, None] + positions[:, :, None, None] * along[:, None, None]
    points = points + depths[:, None, :, None] * outwards[:, None, None]
    height, width = gray.shape
    visible = np.all((points >= 0.0) & (points <= (width - 1.0, height - 1.0)), axis=(2, 3))
    if visible.mean(axis=1).min() < _LEAST_VISIBLE:
        return None
    # All four at once; a side that leaves the image has fewer positions than the others.
    whole = bool(visible.all())
    lines, straight = [], True
    for sides in [np.arange(4)] if whole else np.arange(4)[:, None]:
        there = slice(None) if whole else visible[sides[0]]
        maps = points[sides][:, there].astype(np.float32).reshape(-1, _DEPTHS, 2)
        profiles = cv2.remap(gray, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR).astype(float)
        seen = positions[sides][:, there]
        offsets = _offsets(profiles.reshape(*seen.shape, _DEPTHS), seen, depths[sides])
        if offsets is None:
            return None
        x = seen - 0.5 * length[sides, None]
        slope, shift = _robust_line(x, offsets)
        off = _off_line(offsets - slope[:, None] * x - shift[:, None])
        bent = np.maximum(1.0, (length[sides] / _BENT_FROM) ** 2)
        straight &= bool(np.all(off < _STRAIGHT * bent))
        middles = corners[sides] + 0.5 * length[sides, None] * along[sides]
        middles = middles + shift[:, None] * outwards[sides]
        lines += zip(middles, along[sides] + slope[:, None] * outwards[sides], strict=True)
    return lines, straight


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


def _offsets(profiles: NDArray, positions: NDArray, depths: NDArray) -> NDArray | None:
    """Return where along each profile black ends [px], or None if it is not black then white.

    Shapes (sides, n, depths), (sides, n) and (sides, depths).
    """
    x = (positions - positions.mean(axis=1, keepdims=True))[:, None]
    ends = np.stack([profiles[:, :, :3].mean(axis=2), profiles[:, :, -3:].mean(axis=2)], axis=1)
    slopes, levels = _line(x, ends, np.ones_like(x))
    fitted = slopes[..., None] * x + levels[..., None]  # light may fall off along the edge
    black, white = fitted[:, 0], fitted[:, 1]
    if np.min(white - black) < _LEAST_CONTRAST:
        return None
    dark = (white[..., None] - profiles) / (white - black)[..., None]
    return depths[:, :1] + np.trapezoid(dark, depths[:, None], axis=2)


def _robust_line(x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """Return slopes and values at x = 0 of lines; points far from the others do not count."""
    weights = np.ones_like(x)
    slope = shift = np.zeros(len(x))
    for _ in range(4):
        slope, shift = _line(x, y, weights)
        residuals = np.abs(y - slope[:, None] * x - shift[:, None])
        scale = np.maximum(1.4826 * np.median(residuals, axis=1, keepdims=True), 0.01)
        weights = 1.0 / (1.0 + (residuals / (2.4 * scale)) ** 2)
    return slope, shift


def _off_line(residuals: NDArray) -> NDArray:
    """Return by how much pieces of a side lie off its line, all but those a finger hides [px].

    Where a corner was taken for that of the paper, the side is black and white only in part.
    """
    pieces = [piece.mean(axis=1) for piece in np.array_split(residuals, _PIECES, axis=1)]
    return np.quantile(np.abs(pieces), 0.7, axis=0)


def _line(x: NDArray, y: NDArray, weights: NDArray) -> tuple[NDArray, NDArray]:
    """Return slopes and values at x = 0 of weighted least squares lines along the last axis."""
    total = weights.sum(axis=-1)
    x_mean, y_mean = np.sum(x * weights, axis=-1) / total, np.sum(y * weights, axis=-1) / total
    centred = (x - x_mean[..., None]) * weights
    slope = np.sum(y * centred, axis=-1) / np.sum(x * centred, axis=-1)
    return slope, y_mean - slope * x_mean


def _meet(first: tuple[NDArray, NDArray], second: tuple[NDArray, NDArray]) -> NDArray:
    """Return where two lines meet; NaN if they are parallel."""
    (p, d), (q, e) = first, second
    area = d[0] * e[1] - d[1] * e[0]
    if abs(area) < 1e-6:
        return np.full(2, np.nan)
    between = q - p
    return p + d * (between[0] * e[1] - between[1] * e[0]) / area
