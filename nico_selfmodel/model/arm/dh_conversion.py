"""Lines in space -> Denavit-Hartenberg rows, for any position of the axes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.rotation import signed_angle, tangent_basis
from nico_selfmodel.geometry.transform import transform

PARALLEL_WITHIN = np.radians(5.0)
"""Axes closer to parallel than this get Hayati's row: the common normal's feet run away as
1 / angle (236 mm at 3 deg, 1.9 m at 1 deg for an axis noise of 0.3 deg)."""


@dataclass(frozen=True, eq=False)
class DhRows:
    """Numbers of a Denavit-Hartenberg table; see `DhTable` for their meaning."""

    X_W0: NDArray
    D: NDArray
    theta: NDArray
    r: NDArray
    alpha: NDArray
    beta: NDArray


def parallel_rows(directions: NDArray) -> NDArray:
    """Return for each axis whether it is parallel to the next one within `PARALLEL_WITHIN`.

    Args:
        directions: Unit directions. Shape (n, 3).

    Returns:
        Boolean, shape (n,); the last axis has no next one.
    """
    sines = np.linalg.norm(np.cross(directions[:-1], directions[1:]), axis=1)
    return np.append(sines < np.sin(PARALLEL_WITHIN), False)


def dh_rows_of_lines(
    directions: NDArray,
    points: NDArray,
    hand: NDArray,
    *,
    parallel: NDArray,
    flip: NDArray,
    first: tuple[float, float],
) -> DhRows:
    """Convert lines at the zero configuration to rows.

    Args:
        directions: Unit directions z_{i-1}. Shape (n, 3).
        points: A point on each axis [m]. Shape (n, 3).
        hand: The point that becomes the origin of the last frame [m]. Shape (3,).
        parallel: Rows to be written in Hayati's form. Shape (n,).
        flip: Rows whose x_i is turned round. Shape (n,).
        first: D_1 [m] and theta_1 [rad], which only fix frame 0 on the first axis.
    """
    n = len(directions)
    feet, ends = _normals(directions, points, hand, parallel)
    D, theta, r, alpha, beta = (np.zeros(n) for _ in range(5))
    D[0], theta[0] = first
    before: NDArray | None = None
    x_first = np.zeros(3)
    for i in range(n):
        z = directions[i]
        z_next = directions[i + 1] if i + 1 < n else z
        x = _normal_direction(z, z_next, ends[i] - feet[i], parallel[i] or i + 1 == n, before)
        x = -x if flip[i] else x
        y = np.cross(z, x)
        r[i] = (ends[i] - feet[i]) @ x
        if parallel[i]:
            # Rx(a) Ry(b) e_z = (sin b, -sin a cos b, cos a cos b)
            beta[i] = np.arcsin(np.clip(z_next @ x, -1.0, 1.0))
        alpha[i] = np.arctan2(-(z_next @ y), z_next @ z) if i + 1 < n else 0.0
        if before is None:
            x_first = x
        else:
            D[i] = (feet[i] - ends[i - 1]) @ z
            theta[i] = signed_angle(before, x, z)
        before = _x_after_twist(x, y, z, alpha[i], beta[i])
    z = directions[0]
    y_first = np.cross(z, x_first)
    x_zero = x_first * np.cos(theta[0]) - y_first * np.sin(theta[0])
    rotation = np.column_stack([x_zero, np.cross(z, x_zero), z])
    return DhRows(transform(rotation, feet[0] - D[0] * z), D, theta, r, alpha, beta)


def _normals(
    directions: NDArray, points: NDArray, hand: NDArray, parallel: NDArray
) -> tuple[NDArray, NDArray]:
    """Return where each row's normal leaves its axis, and where it ends on the next. (n, 3) each.

    A parallel row leaves its axis where the row before arrived (D = 0); leading parallel rows take
    the height of the first real normal instead.
    """
    n = len(directions)
    feet, ends = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    along = (hand - points[-1]) @ directions[-1]
    feet[-1], ends[-1] = points[-1] + along * directions[-1], hand
    for i in range(n - 1):
        if not parallel[i]:
            feet[i], ends[i] = common_normal_feet(
                points[i], directions[i], points[i + 1], directions[i + 1]
            )
    leading = int(np.argmin(parallel))
    for i in range(leading - 1, -1, -1):
        ends[i] = feet[i + 1]
        feet[i] = points[i] + ((ends[i] - points[i]) @ directions[i]) * directions[i]
    for i in range(leading + 1, n - 1):
        if parallel[i]:
            feet[i] = ends[i - 1]
            height = (feet[i] - points[i + 1]) @ directions[i]
            slope = directions[i + 1] @ directions[i]
            ends[i] = points[i + 1] + height / slope * directions[i + 1]
    return feet, ends


def _normal_direction(
    z: NDArray, z_next: NDArray, normal: NDArray, radial: bool, before: NDArray | None
) -> NDArray:
    """Return the unit x_i: z x z_next, or for parallel axes and the hand the way to the next."""
    x = normal - (normal @ z) * z if radial else np.cross(z, z_next)
    length = np.linalg.norm(x)
    if length > 1e-12:
        return x / length
    # The next axis, or the hand, lies on this axis: any direction serves, so keep the last one.
    x = tangent_basis(z)[:, 0] if before is None else before - (before @ z) * z
    return x / np.linalg.norm(x)


def _x_after_twist(x: NDArray, y: NDArray, z: NDArray, alpha: float, beta: float) -> NDArray:
    """Return the x axis of the frame after Rx(alpha) Ry(beta) [frame (x, y, z)]. Shape (3,)."""
    turned = np.sin(alpha) * np.sin(beta) * y - np.cos(alpha) * np.sin(beta) * z
    return np.cos(beta) * x + turned


def common_normal_feet(
    point_a: ArrayLike, direction_a: ArrayLike, point_b: ArrayLike, direction_b: ArrayLike
) -> tuple[NDArray, NDArray]:
    """Return the feet of the common normal of two lines that are not parallel.

    Solves a + s da + r x = b + t db with x along da x db (the thesis' eq. 6.10 without the detour
    of eq. 6.11-6.13).

    Args:
        point_a: A point of line a. Shape (3,).
        direction_a: Unit direction of line a. Shape (3,).
        point_b: A point of line b. Shape (3,).
        direction_b: Unit direction of line b. Shape (3,).

    Returns:
        The foot on a and the foot on b. Each of shape (3,).

    Raises:
        ValueError: If the lines are parallel to machine precision.
    """
    a, da = np.asarray(point_a, dtype=float), np.asarray(direction_a, dtype=float)
    b, db = np.asarray(point_b, dtype=float), np.asarray(direction_b, dtype=float)
    normal = np.cross(da, db)
    if np.linalg.norm(normal) < 1e-12:
        raise ValueError("parallel lines have no single common normal")
    s, t, _ = np.linalg.solve(np.stack([da, -db, normal], axis=1), b - a)
    return a + s * da, b + t * db
