"""Rotations and unit vectors: Rodrigues, logarithm, roll-pitch-yaw, charts of the sphere.

Vectors of `skew` and angles of `rotation_about` may be Drake's `AutoDiffXd` or `Expression`.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def skew(v: ArrayLike) -> NDArray:
    """Return the matrix of the cross product, `skew(v) @ w == cross(v, w)`.

    Args:
        v: Vectors. Shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    v = np.asarray(v)
    out = np.zeros((*v.shape[:-1], 3, 3), np.result_type(v, float))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - np.swapaxes(out, -1, -2)


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> NDArray:
    """Rotate about unit axes, R = I cos q + [d]x sin q + d d' (1 - cos q) (Rodrigues).

    Args:
        axis: Unit directions d. Shape (..., 3).
        angle: Angles q [rad], broadcast against the leading shape of `axis`.

    Returns:
        Rotation matrices. Shape (..., 3, 3).
    """
    axis, angle = np.asarray(axis, dtype=float), np.asarray(angle)
    cosine = np.cos(angle)[..., None, None]
    sine = np.sin(angle)[..., None, None]
    outer = axis[..., :, None] * axis[..., None, :]
    return cosine * np.eye(3) + sine * skew(axis) + (1.0 - cosine) * outer


def rotation_vector_of(rotation: ArrayLike) -> NDArray:
    """Return the rotation vector (axis times angle) of one rotation matrix.

    Args:
        rotation: Shape (3, 3).

    Returns:
        Rotation vector with a length in [0, pi] [rad]. Shape (3,).
    """
    rotation = np.asarray(rotation, dtype=float)
    vector = 0.5 * (rotation - rotation.T)[[2, 0, 1], [1, 2, 0]]
    sine = np.linalg.norm(vector)
    cosine = 0.5 * (np.trace(rotation) - 1.0)
    angle = np.arctan2(sine, cosine)
    if sine > 1e-6:
        return vector * (angle / sine)
    if cosine > 0.0:
        return vector
    # Near a half turn: d d' = ((R + R') / 2 - I cos) / (1 - cos); take its largest column, with
    # the sine's direction as the sign.
    outer = (0.5 * (rotation + rotation.T) - cosine * np.eye(3)) / (1.0 - cosine)
    axis = outer[:, np.argmax(np.diag(outer))]
    axis = axis / np.linalg.norm(axis)
    return angle * (-axis if axis @ vector < 0.0 else axis)


def rotation_vectors_of(rotations: ArrayLike) -> NDArray:
    """Return the rotation vectors of many rotation matrices. Shape (..., 3, 3) -> (..., 3).

    By way of the unit quaternion's largest component, which is safe at every angle (Shepperd 1978).
    """
    R = np.asarray(rotations, dtype=float)
    flat = R.reshape(-1, 3, 3)
    trace = np.trace(flat, axis1=1, axis2=2)
    # 4 q q' of the quaternion (w, x, y, z), symmetric
    K = np.empty((len(flat), 4, 4))
    K[:, 0, 0] = 1.0 + trace
    K[:, 0, 1:] = K[:, 1:, 0] = (flat - np.swapaxes(flat, 1, 2))[:, [2, 0, 1], [1, 2, 0]]
    K[:, 1:, 1:] = flat + np.swapaxes(flat, 1, 2)
    K[:, [1, 2, 3], [1, 2, 3]] = 1.0 - trace[:, None] + 2.0 * np.einsum("nii->ni", flat)
    largest = np.argmax(np.einsum("nii->ni", K), axis=1)
    q = K[np.arange(len(flat)), largest]
    q = q / np.linalg.norm(q, axis=1, keepdims=True)
    q = np.where(q[:, :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(sine, q[:, 0])
    factor = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 2.0)
    return (q[:, 1:] * factor[:, None]).reshape(R.shape[:-1])


def rotation_from_quaternion(q: ArrayLike) -> NDArray:
    """Return the rotation of a unit quaternion x, y, z, w. Shape (..., 4) -> (..., 3, 3)."""
    q = np.asarray(q, dtype=float)
    cross, square = skew(q[..., :3]), skew(q[..., :3]) @ skew(q[..., :3])
    return np.eye(3) + 2.0 * (q[..., 3, None, None] * cross + square)


def rotation_from_vector(vector: ArrayLike) -> NDArray:
    """Return rotation matrices of rotation vectors [rad]. Shape (..., 3) -> (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)
    turned = (angle > 0.0)[..., None]
    axis = np.where(turned, vector, [0.0, 0.0, 1.0]) / np.where(turned, angle[..., None], 1.0)
    return rotation_about(axis, angle)


def slope_together(points: ArrayLike) -> NDArray:
    """Return the derivatives of points that move as one, p -> p + v + w x (p - c), c their middle.

    Args:
        points: Places. Shape (n, 3).

    Returns:
        By v, then w. Shape (n, 3, 6).
    """
    points = np.asarray(points, dtype=float)
    turns = -skew(points - points.mean(axis=0))
    return np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)


def rotation_vector_slope(vector: ArrayLike) -> NDArray:
    """Return J with exp([v + dv]) = exp([J dv]) exp([v]), the left Jacobian of the rotations.

    J = I + (1 - cos a) / a^2 [v] + (a - sin a) / a^3 [v]^2, a = |v|.

    Args:
        vector: Rotation vectors [rad]. Shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    vector = np.asarray(vector, dtype=float)
    square = np.sum(vector * vector, axis=-1)
    small = square < 1e-6
    a2 = np.where(small, 1.0, square)
    a = np.sqrt(a2)
    # Taylor series where the closed forms cancel.
    first = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(a)) / a2)
    second = np.where(small, 1.0 / 6.0 - square / 120.0, (a - np.sin(a)) / (a2 * a))
    cross = skew(vector)
    return np.eye(3) + first[..., None, None] * cross + second[..., None, None] * (cross @ cross)


def nearest_rotation(matrix: ArrayLike) -> NDArray:
    """Project a 3 x 3 matrix onto the rotations, U V' with its determinant kept at +1.

    The thesis' eq. A.1-A.2, with the reflection excluded.

    Args:
        matrix: Shape (..., 3, 3).

    Returns:
        The rotation nearest in the Frobenius norm. Shape (..., 3, 3).
    """
    u, _, vt = np.linalg.svd(np.asarray(matrix, dtype=float))
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return u @ vt


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> NDArray:
    """Return Rz(yaw) Ry(pitch) Rx(roll), URDF's convention [rad]. Shape (3, 3)."""
    axes = np.eye(3)
    x, y, z = (rotation_about(a, q) for a, q in zip(axes, (roll, pitch, yaw), strict=True))
    return z @ y @ x


def rpy_of(rotation: NDArray) -> NDArray:
    """Return roll, pitch and yaw of a rotation (3, 3), as URDF has them [rad]. Shape (3,).

    Roll = atan2(R21, R22), pitch = atan2(-R20, |R21, R22|), and with s and c of that very roll
    yaw = atan2(s R02 - c R01, c R11 - s R12), which makes up for what rounding leaves of roll at
    a pitch of 90 deg (Day 2012, Extracting Euler angles from a rotation matrix).

    Args:
        rotation: Shape (3, 3).
    """
    R = np.asarray(rotation, dtype=float)
    roll = np.arctan2(R[2, 1], R[2, 2])
    s, c = np.sin(roll), np.cos(roll)
    pitch = np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2]))
    yaw = np.arctan2(s * R[0, 2] - c * R[0, 1], c * R[1, 1] - s * R[1, 2])
    return np.array([roll, pitch, yaw])


def signed_angle(a: ArrayLike, b: ArrayLike, about: ArrayLike) -> NDArray:
    """Return the angle from `a` to `b` about a unit axis, atan2(z.(a x b), a.b) [rad].

    The right form of the thesis' eq. 6.9, whose arc sine loses sign and quadrant.

    Args:
        a: Vectors normal to `about`. Shape (..., 3).
        b: Vectors normal to `about`. Shape (..., 3).
        about: Unit axis. Shape (..., 3).

    Returns:
        Angles in (-pi, pi]. Shape (...).
    """
    a, b, about = np.broadcast_arrays(a, b, about)
    return np.arctan2(np.sum(about * np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def tangent_basis(direction: ArrayLike) -> NDArray:
    """Return two unit vectors that make a right-handed frame with each direction.

    Duff et al. 2017, "Building an orthonormal basis, revisited": no branch, no division by zero.

    Args:
        direction: Unit vectors d. Shape (..., 3).

    Returns:
        Columns b1, b2 with b1 x b2 = d. Shape (..., 3, 2).
    """
    direction = np.asarray(direction, dtype=float)
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    out = np.empty((*direction.shape, 2))
    out[..., 0, 0], out[..., 1, 0], out[..., 2, 0] = 1.0 + sign * x * x * a, sign * b, -sign * x
    out[..., 0, 1], out[..., 1, 1], out[..., 2, 1] = b, sign + y * y * a, -y
    return out


def frame_along(direction: ArrayLike) -> NDArray:
    """Return a rotation whose z is a unit direction. Shape (3, 3)."""
    return np.column_stack([tangent_basis(direction), direction])


def turned_to_z(directions: ArrayLike) -> NDArray:
    """Return the rotations by the least angle that turn directions u to the z axis.

        R = 1 + [v] + [v]^2 / (1 + u.z),  v = u x z,  1 / (1 + u.z) = (1 - u.z) / |v|^2

    Args:
        directions: Of any length but 0; nothing is turned by that. Shape (N, 3).

    Returns:
        Shape (N, 3, 3).
    """
    p = np.asarray(directions, dtype=float)
    length = np.linalg.norm(p, axis=1, keepdims=True)
    u = np.where(length > 0.0, p / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
    x, y, z = u.T
    across = x * x + y * y
    behind = (z < 0.0) & (across == 0.0)
    over = np.where(z < 0.0, (1.0 - z) / np.where(across > 0.0, across, 1.0), 1.0 / (1.0 + abs(z)))
    R = np.empty((len(u), 3, 3))
    R[:, 0] = np.stack([1.0 - x * x * over, -x * y * over, -x], axis=1)
    R[:, 1] = np.stack([-x * y * over, 1.0 - y * y * over, -y], axis=1)
    R[:, 2] = u
    R[behind] = np.diag([1.0, -1.0, -1.0])
    return R


def move_on_sphere(direction: ArrayLike, step: ArrayLike) -> tuple[NDArray, NDArray]:
    """Follow great circles: d(t) = d cos|t| + B t sin|t|/|t|, with its derivative.

    Args:
        direction: Unit vectors d, whose `tangent_basis` is B. Shape (..., 3).
        step: Chart coordinates t [rad]. Shape (..., 2).

    Returns:
        The moved unit vectors, shape (..., 3), and their derivatives by t, shape (..., 3, 2).
    """
    direction, step = np.asarray(direction, dtype=float), np.asarray(step, dtype=float)
    basis = tangent_basis(direction)
    angle = np.linalg.norm(step, axis=-1)
    sinc = np.sinc(angle / np.pi)
    # (cos a - sinc a) / a^2, whose limit at zero is -1/3
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    slope = np.where(small, -1.0 / 3.0, (np.cos(safe) - np.sinc(safe / np.pi)) / safe**2)
    tangent = np.einsum("...ij,...j->...i", basis, step)
    moved = direction * np.cos(angle)[..., None] + tangent * sinc[..., None]
    derivative = (
        sinc[..., None, None] * basis
        + (slope[..., None] * tangent - sinc[..., None] * direction)[..., :, None]
        * step[..., None, :]
    )
    return moved, derivative


def step_on_sphere(direction: ArrayLike, moved: ArrayLike) -> NDArray:
    """Return the coordinates that lead from one unit vector to another, `move_on_sphere` back.

    Every way leads to the opposite vector: the same one is returned for it.

    Args:
        direction: Unit vector d, whose `tangent_basis` is B. Shape (3,).
        moved: Unit vector. Shape (3,).

    Returns:
        [rad]. Shape (2,).
    """
    direction, moved = np.asarray(direction, dtype=float), np.asarray(moved, dtype=float)
    aside = tangent_basis(direction).T @ moved
    sine = float(np.linalg.norm(aside))
    angle = np.arctan2(sine, moved @ direction)
    return aside * (angle / sine) if sine > 0.0 else np.zeros(2)
