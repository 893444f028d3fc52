"""Forward kinematics of a chain of revolute lines, and its analytic derivatives.

Joint i turns everything beyond it about the line (point c_i, direction d_i) by q_i:
E_i x = c_i + R_i (x - c_i), and p = E_1 ... E_n p_zero. Arrays hold the pose last, (..., N), so
that every operation runs along contiguous memory.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def line_rotations(directions: NDArray, q: NDArray) -> NDArray:
    """Return R_i of all joints and poses (Rodrigues).

    Args:
        directions: Unit directions. Shape (n, 3).
        q: Joint displacements [rad]. Shape (n, N).

    Returns:
        Shape (n, 3, 3, N).
    """
    cosine, sine = np.cos(q), np.sin(q)
    out = np.empty((len(q), 3, 3, q.shape[1]))
    rest = 1.0 - cosine
    for row in range(3):
        for column in range(3):
            outer = (directions[:, row] * directions[:, column])[:, None]
            if row == column:
                out[:, row, column] = cosine + outer * rest
            else:
                # skew(d)[row, column] = -+ d[k], k the third axis
                k = 3 - row - column
                sign = 1.0 if (column - row) % 3 == 2 else -1.0
                out[:, row, column] = outer * rest + (sign * directions[:, k])[:, None] * sine
    return out


def hand_points(directions: NDArray, points: NDArray, p_zero: NDArray, q: NDArray) -> NDArray:
    """Return where the chain carries points, p = E_1 ... E_n p_zero.

    Args:
        directions: Unit directions d_i. Shape (n, 3).
        points: A point c_i of each axis [m]. Shape (n, 3).
        p_zero: Tracked point of each pose at q = 0 [m]. Shape (3, N).
        q: Joint displacements [rad]. Shape (n, N).

    Returns:
        Shape (3, N).
    """
    p = p_zero
    for d, c, angle in zip(directions[::-1], points[::-1], q[::-1], strict=True):
        v = p - c[:, None]
        cosine, sine = np.cos(angle), np.sin(angle)
        along = d @ v
        p = c[:, None] + v * cosine + _cross(d, v) * sine + d[:, None] * (along * (1.0 - cosine))
    return p


@dataclass(frozen=True, eq=False)
class HandDerivatives:
    """Derivatives of tracked points by the geometry of a chain; the pose comes last."""

    p: NDArray
    """Tracked points. Shape (3, N)."""
    by_direction: NDArray
    """By the coordinates of each direction along its given basis. Shape (3, n, 2, N)."""
    by_point: NDArray
    """By the coordinates of each axis point along its given basis. Shape (3, n, 2, N)."""
    by_angle: NDArray
    """By the joint displacements. Shape (3, n, N)."""
    by_hand: NDArray
    """By the tracked point at q = 0: the rotation R_1 ... R_n. Shape (3, 3, N)."""


def hand_derivatives(
    directions: NDArray,
    points: NDArray,
    p_zero: NDArray,
    q: NDArray,
    direction_basis: NDArray,
    point_basis: NDArray,
) -> HandDerivatives:
    """Return tracked points with their derivatives by every line parameter.

    With A_i = R_1 ... R_{i-1}, v_i = P_{i+1} - c_i, P_i = c_i + R_i v_i and P_{n+1} = p_zero:
    dp/dd.b = A_i [(b x v) sin q + (b (v.d) + d (v.b)) (1 - cos q)], dp/dc.b = (A_i - A_{i+1}) b,
    dp/dq = A_i (d x R_i v), dp/dp_zero = A_{n+1}.

    Args:
        directions: Unit directions d_i. Shape (n, 3).
        points: A point c_i of each axis [m]. Shape (n, 3).
        p_zero: Tracked point of each pose at q = 0 [m]. Shape (3, N).
        q: Joint displacements [rad]. Shape (n, N).
        direction_basis: Two changes b of each direction. Shape (n, 3, 2).
        point_basis: Two changes b of each point. Shape (n, 3, 2).

    Returns:
        The points and their derivatives.
    """
    n, count = q.shape
    rotations = line_rotations(directions, q)
    arms, tips = np.empty((n, 3, count)), np.empty((n, 3, count))
    p = p_zero
    for i in range(n - 1, -1, -1):
        arms[i] = p - points[i][:, None]
        tips[i] = np.einsum("ijk,jk->ik", rotations[i], arms[i])
        p = points[i][:, None] + tips[i]
    rest, sine = 1.0 - np.cos(q), np.sin(q)
    by_direction, by_point = np.empty((3, n, 2, count)), np.empty((3, n, 2, count))
    by_angle = np.empty((3, n, count))
    carry = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, count))
    local = np.empty((3, 3, count))
    for i, (d, v) in enumerate(zip(directions, arms, strict=True)):
        along = d @ v
        for k in range(2):
            b = direction_basis[i, :, k]
            bend = b[:, None] * along + d[:, None] * (b @ v)
            local[:, k] = _cross(b, v) * sine[i] + bend * rest[i]
        local[:, 2] = _cross(d, tips[i])
        moved = np.einsum("ijn,jkn->ikn", carry, local)
        by_direction[:, i], by_angle[:, i] = moved[:, :2], moved[:, 2]
        further = np.einsum("ijn,jkn->ikn", carry, rotations[i])
        by_point[:, i] = np.einsum("ijn,jk->ikn", carry - further, point_basis[i])
        carry = further
    return HandDerivatives(p, by_direction, by_point, by_angle, carry)


def _cross(a: NDArray, v: NDArray) -> NDArray:
    """Return a x v for one vector and many, (3,), (3, N) -> (3, N)."""
    return np.stack(
        [a[1] * v[2] - a[2] * v[1], a[2] * v[0] - a[0] * v[2], a[0] * v[1] - a[1] * v[0]]
    )
