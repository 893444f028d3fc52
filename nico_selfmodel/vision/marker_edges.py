"""Corners of a square marker from the edges of its black border, without bias.

A corner is a bad place to look at: blur rounds it off. Each side is located along its whole length
instead, by the area under the brightness across it, which no symmetric blur moves; a line goes
through that, and the lines meet in the corners.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.homography import apply_homography, homography

_POSITIONS = 40  # along a side
_DEPTHS = 25  # across it
_REACH = 0.75  # of a cell, to both sides of an edge: black within, white without
_WIDEST, _NARROWEST = 4.0, 1.2  # that reach [px]
_PASSES = 6
_SETTLED = 0.003  # [px]
_NEARLY_SETTLED = 0.1  # after all passes; what still moves has no end [px]
_LEAST_CONTRAST = 12.0  # grey levels between black and white
_LEAST_VISIBLE = 0.6  # of the positions along a side
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
        inner = _inner_corners(refined, cells)
        edges = [_edge(gray, refined, inner, side) for side in range(4)]
        lines = [edge[:2] for edge in edges if edge is not None]
        if len(lines) < 4:
            return None
        straight = all(edge[2] for edge in edges if edge is not None)
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


def _edge(
    gray: NDArray, corners: NDArray, inner: NDArray, side: int
) -> tuple[NDArray, NDArray, bool] | None:
    """Return a point on the edge after corner `side`, its direction, and if it is straight."""
    start, end = corners[side], corners[(side + 1) % 4]
    length = np.linalg.norm(end - start)
    along = (end - start) / length
    outwards = np.array([along[1], -along[0]])
    if outwards @ (corners.mean(axis=0) - start) > 0.0:
        outwards = -outwards
    border = np.abs((inner[[side, (side + 1) % 4]] - start) @ outwards).min()
    reach = np.clip(_REACH * border, _NARROWEST, _WIDEST)
    margin = min(max(0.06, 2.5 / length), 0.3)  # of the side, at corners that blur has rounded
    positions = np.linspace(margin, 1.0 - margin, _POSITIONS) * length
    depths = np.linspace(-reach, reach, _DEPTHS)
    points = start + positions[:, None, None] * along + depths[:, None] * outwards
    height, width = gray.shape
    visible = np.all((points >= 0.0) & (points <= (width - 1.0, height - 1.0)), axis=(1, 2))
    if visible.mean() < _LEAST_VISIBLE:
        return None
    maps = points[visible].astype(np.float32)
    profiles = cv2.remap(gray, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR).astype(float)
    offsets = _offsets(profiles, positions[visible], depths)
    if offsets is None:
        return None
    x = positions[visible] - 0.5 * length
    slope, shift = _robust_line(x, offsets)
    bent = max(1.0, (length / _BENT_FROM) ** 2)
    straight = bool(_off_line(offsets - slope * x - shift) < _STRAIGHT * bent)
    middle = start + 0.5 * length * along + shift * outwards
    return middle, along + slope * outwards, straight


def _inner_corners(corners: NDArray, cells: int) -> NDArray:
    """Return where the black border ends inwards. Shape (4, 2)."""
    square = np.array([[0.0, 0], [cells, 0], [cells, cells], [0, cells]])
    inner = np.array([[1.0, 1], [cells - 1, 1], [cells - 1, cells - 1], [1, cells - 1]])
    return apply_homography(homography(square, corners), inner)


def _offsets(profiles: NDArray, positions: NDArray, depths: NDArray) -> NDArray | None:
    """Return where along each profile black ends [px], or None if it is not black then white."""
    x = positions - positions.mean()
    ends = np.stack([profiles[:, :3].mean(axis=1), profiles[:, -3:].mean(axis=1)])
    slopes, levels = _line(x, ends, np.ones_like(x))
    black, white = slopes[:, None] * x + levels[:, None]  # light may fall off along the edge
    if np.min(white - black) < _LEAST_CONTRAST:
        return None
    dark = (white[:, None] - profiles) / (white - black)[:, None]
    return depths[0] + np.trapezoid(dark, depths, axis=1)


def _robust_line(x: NDArray, y: NDArray) -> tuple[float, float]:
    """Return slope and value at x = 0 of a line; points far from the others do not count."""
    weights = np.ones_like(x)
    slope = shift = np.zeros(())
    for _ in range(4):
        slope, shift = _line(x, y, weights)
        residuals = np.abs(y - slope * x - shift)
        scale = max(1.4826 * float(np.median(residuals)), 0.01)
        weights = 1.0 / (1.0 + (residuals / (2.4 * scale)) ** 2)
    return float(slope), float(shift)


def _off_line(residuals: NDArray) -> float:
    """Return by how much pieces of a side lie off its line, all but those a finger hides [px].

    Where a corner was taken for that of the paper, the side is black and white only in part.
    """
    pieces = [piece.mean() for piece in np.array_split(residuals, _PIECES)]
    return float(np.quantile(np.abs(pieces), 0.7))


def _line(x: NDArray, y: NDArray, weights: NDArray) -> tuple[NDArray, NDArray]:
    """Return slopes and values at x = 0 of weighted least squares lines. y: shape (..., n)."""
    total = weights.sum()
    x_mean, y_mean = x @ weights / total, y @ weights / total
    centred = (x - x_mean) * weights
    slope = (y @ centred) / (x @ centred)
    return slope, y_mean - slope * x_mean


def _meet(first: tuple[NDArray, NDArray], second: tuple[NDArray, NDArray]) -> NDArray:
    """Return where two lines meet; NaN if they are parallel."""
    (p, d), (q, e) = first, second
    area = d[0] * e[1] - d[1] * e[0]
    if abs(area) < 1e-6:
        return np.full(2, np.nan)
    between = q - p
    return p + d * (between[0] * e[1] - between[1] * e[0]) / area
