"""Forward kinematics of a chain of revolute lines, and its analytic derivatives.

Joint i turns everything beyond it about the line (point c_i, direction d_i) by q_i:
E_i x = c_i + R_i (x - c_i), and p = E_1 ... E_n p_zero. Arrays hold the pose last, (..., N), so
that every operation runs along contiguous memory.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import skew


def line_rotations(directions: NDArray, q: NDArray) -> NDArray:
    """Return R_i of all joints and poses, R = d d' + (I - d d') cos q + [d]x sin q (Rodrigues).

    Args:
        directions: Unit directions. Shape (n, 3).
        q: Joint displacements [rad]. Shape (n, N).

    Returns:
        Shape (n, 3, 3, N).
    """
    n, count = q.shape
    outer = directions[:, :, None] * directions[:, None, :]
    parts = np.stack([outer, np.eye(3) - outer, skew(directions)], axis=-1).reshape(n, 9, 3)
    waves = np.empty((n, 3, count))
    waves[:, 0] = 1.0
    np.cos(q, out=waves[:, 1])
    np.sin(q, out=waves[:, 2])
    return (parts @ waves).reshape(n, 3, 3, count)


def carried_rotations(directions: NDArray, q: NDArray) -> NDArray:
    """Return what turns each joint's surroundings, A_i = R_1 ... R_{i-1}, and A_{n+1}.

    Args:
        directions: Unit directions. Shape (n, 3).
        q: Joint displacements [rad]. Shape (n, N).

    Returns:
        Shape (n + 1, 3, 3, N).
    """
    n, count = q.shape
    rotations = line_rotations(directions, q)
    carried = np.empty((n + 1, 3, 3, count))
    carried[0] = np.eye(3)[:, :, None]
    carried[1] = rotations[0]
    for i in range(1, n):
        np.einsum("ijk,jlk->ilk", carried[i], rotations[i], out=carried[i + 1])
    return carried


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
        p = c[:, None] + v * cosine + cross(d, v) * sine + d[:, None] * (along * (1.0 - cosine))
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
    carried: NDArray | None = None,
) -> HandDerivatives:
    """Return tracked points with their derivatives by every line parameter.

    With A_i = R_1 ... R_{i-1} and r_i the arm from axis i to the tracked point, in the frame of
    measurement: dp/dq_i = (A_i d_i) x r_i, dp/dc_i.b = (A_i - A_{i+1}) b, and since a change b of
    the direction turns the axis by d x b, dp/dd_i.b = ((A_i - A_{i+1}) (d_i x b)) x r_i;
    dp/dp_zero = A_{n+1}, and p = sum_i (A_i - A_{i+1}) c_i + A_{n+1} p_zero.

    Args:
        directions: Unit directions d_i. Shape (n, 3).
        points: A point c_i of each axis [m]. Shape (n, 3).
        p_zero: Tracked point of each pose at q = 0 [m]. Shape (3, N).
        q: Joint displacements [rad]. Shape (n, N).
        direction_basis: Two changes b of each direction, normal to it. Shape (n, 3, 2).
        point_basis: Two changes b of each point. Shape (n, 3, 2).
        carried: `carried_rotations(directions, q)`, where they are known already.

    Returns:
        The points and their derivatives.
    """
    carried = carried_rotations(directions, q) if carried is None else carried
    turned = np.swapaxes(skew(directions) @ direction_basis, 1, 2)
    change = np.concatenate([turned, np.swapaxes(point_basis, 1, 2), points[:, None]], axis=1)
    moved = change[:, None] @ (carried[:-1] - carried[1:])
    shift = moved[:, :, 4]
    p = shift.sum(axis=0) + np.einsum("ijk,jk->ik", carried[-1], p_zero)
    along = np.stack([directions, points], axis=1)[:, None] @ carried[:-1]
    before = np.cumsum(shift, axis=0) - shift
    arm = p - along[:, :, 1] - before
    lever = np.concatenate([moved[:, :, :2], along[:, :, :1]], axis=2)
    swing = cross(lever.swapaxes(0, 1), arm.swapaxes(0, 1)[:, :, None])
    return HandDerivatives(
        p, swing[:, :, :2], moved[:, :, 2:4].swapaxes(0, 1), swing[:, :, 2], carried[-1]
    )


def cross(a: NDArray, v: NDArray) -> NDArray:
    """Return a x v along the first axis, which has length 3; the others broadcast."""
    return np.stack(
        [a[1] * v[2] - a[2] * v[1], a[2] * v[0] - a[0] * v[2], a[0] * v[1] - a[1] * v[0]]
    )
