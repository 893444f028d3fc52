"""Homographies between planes by the normalised direct linear transform, and a square's centre."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.normalisation import normalised_points

_DEGENERATE = 1e-10  # of the largest singular value; well spread points have 1e-2 and more


def homography(source: ArrayLike, target: ArrayLike) -> NDArray:
    """Return the homography that takes points of one plane to points of another.

    The normalised direct linear transform: it minimises an algebraic error, so that it is exact
    for exact points and a start for a refinement otherwise. The equations are those of the standard
    form (thesis eq. 5.3 has misprints); the normalisation moves the *centroid* to the origin and
    the points to a root mean square distance of sqrt 2 (thesis eq. 7.2 prints the width and height
    of the bounding box).

    Args:
        source: Points of the first plane. Shape (..., n, 2) with n >= 4.
        target: Their images. Shape (..., n, 2); leading dimensions broadcast.

    Returns:
        H with `target ~ H source`, of Frobenius norm 1 and a positive denominator at the centroid
        of the source points. Shape (..., 3, 3).

    Raises:
        ValueError: If a shape is wrong, a number is not finite, or the points do not determine an
            invertible homography (three of four on a line, all on a line, coincident).
    """
    source, target = _point_lists(source, target)
    source, target = np.broadcast_arrays(source, target)
    a, from_source = normalised_points(source, "source")
    b, from_target = normalised_points(target, "target")
    _, values, vt = np.linalg.svd(_equations(a, b), full_matrices=False)
    H = vt[..., -1, :].reshape(*vt.shape[:-2], 3, 3)
    flat = np.abs(np.linalg.det(H)) <= _DEGENERATE
    if np.any(flat | (values[..., 7] <= _DEGENERATE * values[..., 0])):
        raise ValueError(
            "the points do not determine a homography: too many of them lie on one line, or"
            " coincide"
        )
    H = np.linalg.solve(from_target, H @ from_source)
    H /= np.linalg.norm(H, axis=(-2, -1), keepdims=True)
    middle = np.mean(source, axis=-2)
    denominator = np.sum(H[..., 2, :2] * middle, axis=-1) + H[..., 2, 2]
    return H * np.where(denominator < 0.0, -1.0, 1.0)[..., None, None]


def apply_homography(H: ArrayLike, points: ArrayLike) -> NDArray:
    """Return the images of points.

    Args:
        H: Shape (..., 3, 3).
        points: Shape (..., n, 2).

    Returns:
        Shape (..., n, 2).

    Raises:
        ValueError: If a shape is wrong, or a point lies on the line that H takes to infinity.
    """
    H, points = np.asarray(H, dtype=float), np.asarray(points, dtype=float)
    if H.shape[-2:] != (3, 3):
        raise ValueError(f"H must have shape (..., 3, 3), got {H.shape}")
    if points.ndim < 2 or points.shape[-1] != 2:
        raise ValueError(f"points must have shape (..., n, 2), got {points.shape}")
    images = points @ np.swapaxes(H[..., :2], -1, -2) + H[..., None, :, 2]
    if np.any(images[..., 2] == 0.0):
        raise ValueError("a point lies on the line that this homography takes to infinity")
    return images[..., :2] / images[..., 2:]


def marker_center(corners: ArrayLike) -> NDArray:
    """Return the image of a square's centre, from the images of its corners.

    That is the centre of the model square under the homography of the four corners (thesis section
    7.1.1.2). A homography keeps lines, and the centre lies on both diagonals: it is where the
    diagonals of the image meet, which is computed here in closed form. The mean of the corners is
    something else as soon as the square is tilted.

    Args:
        corners: In order around the square. Shape (..., 4, 2). NaN gives NaN.

    Returns:
        Shape (..., 2).

    Raises:
        ValueError: If the shape is wrong, or the corners are no image of a square seen from one
            side: not convex, not in order around it, or three on a line.
    """
    corners = np.asarray(corners, dtype=float)
    if corners.shape[-2:] != (4, 2):
        raise ValueError(f"corners must have shape (..., 4, 2), got {corners.shape}")
    first, second = corners[..., 2, :] - corners[..., 0, :], corners[..., 3, :] - corners[..., 1, :]
    across = corners[..., 1, :] - corners[..., 0, :]
    area = _cross(first, second)
    share = _cross(across, second), _cross(across, first)  # of `area`, along each diagonal
    inside = [(s * np.sign(area) > 0.0) & (np.abs(s) < np.abs(area)) for s in share]
    if not np.all((inside[0] & inside[1]) | np.isnan(area)):
        raise ValueError(
            "corners must be those of a convex quadrangle, in order around it, no three on a line"
        )
    return corners[..., 0, :] + (share[0] / area)[..., None] * first


def _point_lists(source: ArrayLike, target: ArrayLike) -> tuple[NDArray, NDArray]:
    source, target = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    shapes = source.shape, target.shape
    if any(len(shape) < 2 or shape[-1] != 2 or shape[-2] < 4 for shape in shapes) or (
        source.shape[-2] != target.shape[-2]
    ):
        raise ValueError(
            "source and target must both have shape (..., n >= 4, 2),"
            f" got {source.shape} and {target.shape}"
        )
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise ValueError("source and target must be finite numbers")
    return source, target


def _equations(source: NDArray, target: NDArray) -> NDArray:
    """Return the rows of the direct linear transform, at least nine. Shape (..., rows, 9)."""
    n = source.shape[-2]
    rows = np.zeros((*source.shape[:-2], max(2 * n, 9), 9))  # four points leave one row of zeros
    b = np.concatenate([source, np.ones((*source.shape[:-1], 1))], axis=-1)
    rows[..., :n, 3:6] = -b
    rows[..., :n, 6:] = target[..., 1:] * b
    rows[..., n : 2 * n, :3] = b
    rows[..., n : 2 * n, 6:] = -target[..., :1] * b
    return rows


def _cross(a: NDArray, b: NDArray) -> NDArray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
