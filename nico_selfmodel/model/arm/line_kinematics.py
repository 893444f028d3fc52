"""Forward kinematics of a chain of revolute lines, and its analytic derivatives.

Joint i turns everything beyond it about the line (point c_i, direction d_i) by q_i:
E_i x = c_i + R_i (x - c_i), and p = E_1 ... E_n p_zero. Arrays hold the pose last, (..., N), so
that every operation runs along contiguous memory; before the joints (..., n, N) may stand many
chains of as many joints.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import skew


def line_rotations(directions: NDArray, q: NDArray) -> NDArray:
    """Return R_i of all joints and poses, R = d d' + (I - d d') cos q + [d]x sin q (Rodrigues).

    Args:
        directions: Unit directions. Shape (..., n, 3).
        q: Joint displacements [rad]. Shape (..., n, N).

    Returns:
        Shape (..., n, 3, 3, N).
    """
    count = q.shape[-1]
    outer = directions[..., :, None] * directions[..., None, :]
    parts = np.stack([outer, np.eye(3) - outer, skew(directions)], axis=-1)
    waves = np.empty((*q.shape[:-1], 3, count))
    waves[..., 0, :] = 1.0
    np.cos(q, out=waves[..., 1, :])
    np.sin(q, out=waves[..., 2, :])
    turned = parts.reshape(*directions.shape[:-1], 9, 3) @ waves
    return turned.reshape(*q.shape[:-1], 3, 3, count)


def _carried_rotations(directions: NDArray, q: NDArray) -> NDArray:
    """Return what turns each joint's surroundings, A_i = R_1 ... R_{i-1}, and A_{n+1}.

    Shapes (..., n, 3) and (..., n, N) -> (..., n + 1, 3, 3, N).
    """
    *many, n, count = q.shape
    rotations = line_rotations(directions, q)
    carried = np.empty((*many, n + 1, 3, 3, count))
    carried[..., 0, :, :, :] = np.eye(3)[:, :, None]
    carried[..., 1:2, :, :, :] = rotations[..., :1, :, :, :]
    for i in range(1, n):
        before, turn = carried[..., i, :, :, :], rotations[..., i, :, :, :]
        np.einsum("...ijk,...jlk->...ilk", before, turn, out=carried[..., i + 1, :, :, :])
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
    """Tracked points. Shape (3, ..., N)."""
    by_direction: NDArray
    """By the coordinates of each direction along its given basis. Shape (3, ..., n, 2, N)."""
    by_point: NDArray
    """By the coordinates of each axis point along its given basis. Shape (3, ..., n, 2, N)."""
    by_angle: NDArray
    """By the joint displacements. Shape (3, ..., n, N)."""
    by_hand: NDArray
    """By the tracked point at q = 0: the rotation R_1 ... R_n. Shape (3, ..., 3, N)."""


@dataclass(frozen=True, eq=False)
class CarriedLines:
    """Lines at the displacements of many poses: all of the derivatives that needs no point.

    With A_i = R_1 ... R_{i-1} and r_i the arm from axis i to the tracked point, in the frame of
    measurement: dp/dq_i = (A_i d_i) x r_i, dp/dc_i.b = (A_i - A_{i+1}) b, and since a change b of
    the direction turns the axis by d x b, dp/dd_i.b = ((A_i - A_{i+1}) (d_i x b)) x r_i;
    dp/dp_zero = A_{n+1}, and p = sum_i (A_i - A_{i+1}) c_i + A_{n+1} p_zero.
    """

    directions: NDArray
    """Unit directions d_i. Shape (..., n, 3)."""
    carried: NDArray
    """A_1 ... A_{n+1}, the last index that of poses. Shape (..., n + 1, 3, 3, N)."""
    difference: NDArray
    """A_i - A_{i+1}. Shape (..., n, 3, 3, N)."""
    levers: NDArray
    """(A_i - A_{i+1}) (d_i x b), b of the basis of directions. Shape (..., n, 3, 2, N)."""
    by_point: NDArray
    """(A_i - A_{i+1}) b, b of the basis of points. Shape (..., n, 3, 2, N)."""

    @classmethod
    def at(
        cls, directions: NDArray, q: NDArray, direction_basis: NDArray, point_basis: NDArray
    ) -> "CarriedLines":
        """Carry lines along.

        Args:
            directions: Unit directions d_i. Shape (..., n, 3).
            q: Joint displacements [rad]. Shape (..., n, N).
            direction_basis: Two changes b of each direction, normal to it. Shape (..., n, 3, 2).
            point_basis: Two changes b of each point. Shape (..., n, 3, 2).
        """
        carried = _carried_rotations(directions, q)
        difference = carried[..., :-1, :, :, :] - carried[..., 1:, :, :, :]
        turned = skew(directions) @ direction_basis
        changes = np.swapaxes(np.concatenate([turned, point_basis], axis=-1), -1, -2)
        moved = changes[..., None, :, :] @ difference
        return cls(directions, carried, difference, moved[..., :2, :], moved[..., 2:, :])

    def derivatives(
        self, points: NDArray, p_zero: NDArray, beyond: NDArray | None = None
    ) -> HandDerivatives:
        """Return tracked points with their derivatives by every line parameter.

        Args:
            points: A point c_i of each axis [m]. Shape (..., n, 3).
            p_zero: Tracked point of each pose at q = 0 [m]. Shape (..., 3, N).
            beyond: What else moves the tracked point away from each axis, in the frame of
                measurement [m]; nothing if omitted. Shape (..., n, 3, N). It is no part of p.
        """
        points = points[..., None, None, :]
        shift = (points @ self.difference)[..., 0, :]
        last = self.carried[..., -1, :, :, :]
        p = shift.sum(axis=-3) + np.einsum("...ijk,...jk->...ik", last, p_zero)
        ends = np.stack([self.directions, points[..., 0, 0, :]], axis=-2)[..., None, :, :]
        along = ends @ self.carried[..., :-1, :, :, :]
        # sums over the joints before each; numpy's own cumsum takes ten times as long here
        n, flat = shift.shape[-3], (*shift.shape[:-2], -1)
        before = (np.tri(n, k=-1) @ shift.reshape(flat)).reshape(shift.shape)
        arm = p[..., None, :, :] - along[..., 1, :] - before
        if beyond is not None:
            arm = arm + beyond
        lever = np.concatenate([self.levers, along[..., :1, :]], axis=-2)
        swing = cross(np.moveaxis(lever, -3, 0), np.moveaxis(arm, -2, 0)[..., None, :])
        return HandDerivatives(
            np.moveaxis(p, -2, 0),
            swing[..., :2, :],
            np.moveaxis(self.by_point, -3, 0),
            swing[..., 2, :],
            np.moveaxis(last, -3, 0),
        )


def cross(a: NDArray, v: NDArray) -> NDArray:
    """Return a x v along the first axis, which has length 3; the others broadcast."""
    out = np.empty((3, *np.broadcast_shapes(a.shape[1:], v.shape[1:])), np.result_type(a, v))
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[i] * v[j], a[j] * v[i], out=out[k])
    return out
