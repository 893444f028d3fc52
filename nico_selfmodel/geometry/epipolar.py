"""Two views of the same points: eight-point algorithm, essential matrix, epipolar lines.

Points are ideal image coordinates (x, y) = (X/Z, Y/Z), or undistorted pixels where a fundamental
matrix is asked for. The second camera sees p_2 = R p_1 + t, and x_2' E x_1 = 0 with E = [t]x R.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.normalisation import normalised_points
from nico_selfmodel.geometry.rotation import skew


def homogeneous(points: ArrayLike) -> NDArray:
    """Append a one to each point. Shape (..., d) -> (..., d + 1)."""
    points = np.asarray(points, dtype=float)
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def eight_point(first: ArrayLike, second: ArrayLike) -> NDArray:
    """Estimate F with x_2' F x_1 = 0 from matched points (Hartley 1997, normalised).

    Args:
        first: Points in the first view. Shape (N, 2), N >= 8.
        second: The same points in the second view. Shape (N, 2).

    Returns:
        F of rank two and unit norm. Shape (3, 3).

    Raises:
        ValueError: If there are fewer than eight pairs, or their positions leave F open (points of
            one plane do).
    """
    first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    if first.shape != second.shape or first.ndim != 2 or first.shape[1] != 2 or len(first) < 8:
        raise ValueError(
            f"two equal shapes (N, 2) with N >= 8 are needed, got {first.shape}, {second.shape}"
        )
    a, t_first = normalised_points(first, "first")
    b, t_second = normalised_points(second, "second")
    rows = (homogeneous(b)[:, :, None] * homogeneous(a)[:, None, :]).reshape(-1, 9)
    triangle = np.linalg.qr(rows, mode="r") if len(rows) > 9 else rows
    _, values, vt = np.linalg.svd(triangle, full_matrices=True)
    if len(values) < 8 or values[7] <= 1e-9 * values[0]:
        raise ValueError("the points leave the epipolar geometry open: do they lie in one plane?")
    u, s, v = np.linalg.svd(vt[-1].reshape(3, 3))
    matrix = t_second.T @ (u * [s[0], s[1], 0.0]) @ v @ t_first
    return matrix / np.linalg.norm(matrix)


def essential(rotation: ArrayLike, translation: ArrayLike) -> NDArray:
    """Return E = [t]x R. Shapes (3, 3) and (3,) -> (3, 3)."""
    return skew(translation) @ np.asarray(rotation, dtype=float)


def poses_of_essential(matrix: ArrayLike) -> list[tuple[NDArray, NDArray]]:
    """Return the four (R, t) with |t| = 1 that an essential matrix allows.

    Args:
        matrix: E up to scale. Shape (3, 3).

    Returns:
        Rotation, shape (3, 3), and unit translation, shape (3,), of each.
    """
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    u, vt = u * np.sign(np.linalg.det(u)), vt * np.sign(np.linalg.det(vt))
    w = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [(u @ turn @ vt, sign * u[:, 2]) for turn in (w, w.T) for sign in (1.0, -1.0)]


@dataclass(frozen=True, eq=False)
class RelativePose:
    """The second camera against the first, up to the length of the baseline."""

    rotation: NDArray
    """R in p_2 = R p_1 + t. Shape (3, 3)."""
    translation: NDArray
    """t, of unit length. Shape (3,)."""
    share_in_front: float
    """Share of the points that lie in front of both cameras."""

    @classmethod
    def from_points(cls, first: ArrayLike, second: ArrayLike) -> "RelativePose":
        """Estimate the relative pose; of the four that E allows, cheirality chooses.

        Args:
            first: Ideal image coordinates in the first view. Shape (N, 2), N >= 8.
            second: In the second view. Shape (N, 2).

        Returns:
            The pose with the most points in front of both cameras.

        Raises:
            ValueError: As in `eight_point`.
        """
        first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
        matrix = eight_point(first, second)
        found = []
        for rotation, translation in poses_of_essential(matrix):
            depths = two_view_depths(rotation, translation, first, second)
            found.append(cls(rotation, translation, float((depths > 0.0).all(axis=1).mean())))
        return max(found, key=lambda pose: pose.share_in_front)


def two_view_depths(
    rotation: NDArray, translation: NDArray, first: NDArray, second: NDArray
) -> NDArray:
    """Return depths z_1, z_2 of the points nearest to both rays, z_2 x_2 = z_1 R x_1 + t.

    Args:
        rotation: R. Shape (3, 3).
        translation: t. Shape (3,).
        first: Ideal image coordinates. Shape (N, 2).
        second: Ideal image coordinates. Shape (N, 2).

    Returns:
        Shape (N, 2); in the unit of t.
    """
    a, b = homogeneous(first) @ rotation.T, homogeneous(second)
    aa, bb, ab = np.sum(a * a, axis=1), np.sum(b * b, axis=1), np.sum(a * b, axis=1)
    at, bt = a @ translation, b @ translation
    determinant = np.maximum(aa * bb - ab * ab, np.finfo(float).tiny)
    return np.stack([(ab * bt - bb * at), (aa * bt - ab * at)], axis=1) / determinant[:, None]


def epipolar_lines(matrix: NDArray, points: ArrayLike) -> NDArray:
    """Return the lines l_2 = F x_1 on which the second view must show each point.

    The right form of the thesis' eq. 5.13.

    Args:
        matrix: F; its transpose for lines in the first view. Shape (3, 3).
        points: Shape (N, 2).

    Returns:
        Lines a x + b y + c = 0 with a^2 + b^2 = 1. Shape (N, 3).
    """
    lines = homogeneous(points) @ np.asarray(matrix, dtype=float).T
    return lines / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)


def epipolar_distances(matrix: NDArray, first: ArrayLike, second: ArrayLike) -> NDArray:
    """Return the distance of each point from the other's epipolar line, in both views.

    Args:
        matrix: F with x_2' F x_1 = 0. Shape (3, 3).
        first: Shape (N, 2).
        second: Shape (N, 2).

    Returns:
        Distances in the first and in the second view, in the points' unit. Shape (N, 2).
    """
    in_second = np.sum(epipolar_lines(matrix, first) * homogeneous(second), axis=1)
    in_first = np.sum(epipolar_lines(matrix.T, second) * homogeneous(first), axis=1)
    return np.abs(np.stack([in_first, in_second], axis=1))
