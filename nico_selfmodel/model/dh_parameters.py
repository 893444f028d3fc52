"""Names, values and derivatives of the Denavit-Hartenberg parameters of a measured arm.

The vector holds M0 (position and rotation vector of frame 0), for each joint D, theta_offset, r,
alpha, beta and gear, and for each marker its point in the last frame. theta_offset is the encoder
angle at theta = 0: `sign * radians(reading) = theta_offset + gear * theta` (thesis eq. 6.8).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import (
    rotation_about,
    rotation_from_vector,
    rotation_vector_of,
    skew,
)
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.servo_map import ServoMap

M0_NAMES = tuple(f"M0.{part}" for part in ("x", "y", "z", "rx", "ry", "rz"))
JOINT_PARTS = ("D", "theta_offset", "r", "alpha", "beta", "gear")
_UNITS = {"D": "m", "theta_offset": "rad", "r": "m", "alpha": "rad", "beta": "rad", "gear": "1"}


@dataclass(frozen=True, eq=False)
class DhParameters:
    """A table and its servos as one named vector."""

    table: DhTable
    """The rows."""
    servos: ServoMap
    """Encoders <-> joint displacements."""
    turn: NDArray | None = None
    """Rotation vector of frame 0 [rad]; the shortest one if omitted. A solver that passes a half
    turn needs it to stay on the branch where it is. Shape (3,)."""

    @property
    def base_turn(self) -> NDArray:
        """Rotation vector of frame 0 in W [rad]. Shape (3,)."""
        return rotation_vector_of(self.table.X_W0[:3, :3]) if self.turn is None else self.turn

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters. Length 6 + 6 n + 3 m."""
        joints = [f"{joint}.{part}" for joint in self.table.joints for part in JOINT_PARTS]
        hands = [f"hand.{marker}.{axis}" for marker in self.table.markers for axis in "xyz"]
        return (*M0_NAMES, *joints, *hands)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all parameters, `m`, `rad` or `1` (encoder per joint angle)."""
        joints = [_UNITS[part] for _ in self.table.joints for part in JOINT_PARTS]
        return ("m",) * 3 + ("rad",) * 3 + tuple(joints) + ("m",) * (3 * len(self.table.markers))

    @property
    def values(self) -> NDArray:
        """Values in the order of `names`."""
        t = self.table
        theta_offset = self.servos.offset - self.servos.gear * t.theta_zero
        joints = np.stack([t.D, theta_offset, t.r, t.alpha, t.beta, self.servos.gear], axis=1)
        base = np.concatenate([t.X_W0[:3, 3], self.base_turn])
        return np.concatenate([base, joints.ravel(), t.p_NH.ravel()])

    @property
    def gauge(self) -> frozenset[str]:
        """Names that no measurement of points can tell from the others; pinned by default."""
        joints = self.table.joints
        names = {f"{joints[0]}.theta_offset", f"{joints[-1]}.alpha"}
        names |= {f"{j}.D" for j, pinned in zip(joints, self.table.pinned_D, strict=True) if pinned}
        parallel = self.table.parallel
        names |= {f"{j}.beta" for j, near in zip(joints, parallel, strict=True) if not near}
        return frozenset(names | {f"hand.{self.table.markers[0]}.{axis}" for axis in "xyz"})

    def with_values(self, values: NDArray) -> "DhParameters":
        """Return the same arm with other values, in the order of `names`; theta_zero stays."""
        t, n = self.table, len(self.table.joints)
        base, joints, hands = np.split(np.asarray(values, dtype=float), [6, 6 + 6 * n])
        D, theta_offset, r, alpha, beta, gear = joints.reshape(n, 6).T
        table = replace(
            t,
            X_W0=transform(rotation_from_vector(base[3:]), base[:3]),
            D=D,
            r=r,
            alpha=alpha,
            beta=beta,
            p_NH=hands.reshape(-1, 3),
        )
        offset = theta_offset + gear * t.theta_zero
        return DhParameters(table, replace(self.servos, offset=offset, gear=gear), base[3:])

    def predict(self, encoder_angles: NDArray, marker: NDArray) -> tuple[NDArray, NDArray]:
        """Predict tracked points with their derivatives by every parameter.

        Turning about an axis (unit a through o) moves the hand p by a x (p - o), sliding along it
        by a; theta = (encoder - theta_offset) / gear.

        Args:
            encoder_angles: `ServoMap.to_radians` of the readings. Shape (N, n).
            marker: Index of each pose's tracked point. Shape (N,).

        Returns:
            p_WH, shape (N, 3), and its derivatives, shape (N, 3, P).
        """
        t, n = self.table, len(self.table.joints)
        q = (encoder_angles - self.servos.offset) / self.servos.gear
        theta = q + t.theta_zero
        frames = t.frames(q)
        last = frames[-1]
        p = np.einsum("kij,kj->ki", last[:, :3, :3], t.p_NH[marker]) + last[:, :3, 3]
        jacobian = np.zeros((len(q), 3, 6 + 6 * n + 3 * len(t.markers)))
        jacobian[:, :, :3] = np.eye(3)
        jacobian[:, :, 3:6] = -skew(p - t.X_W0[:3, 3]) @ _left_jacobian(self.base_turn)
        for i in range(n):
            before, after = frames[i], frames[i + 1]
            turned = before[:, :3, :3] @ rotation_about(np.array([0.0, 0.0, 1.0]), theta[:, i])
            z, x = before[:, :3, 2], turned[:, :, 0]
            y = np.einsum("kij,j->ki", turned, [0.0, np.cos(t.alpha[i]), np.sin(t.alpha[i])])
            swing = np.cross(z, p - before[:, :3, 3])
            beyond = p - after[:, :3, 3]
            column = 6 + 6 * i
            jacobian[:, :, column] = z
            jacobian[:, :, column + 1] = -swing / self.servos.gear[i]
            jacobian[:, :, column + 2] = x
            jacobian[:, :, column + 3] = np.cross(x, beyond)
            jacobian[:, :, column + 4] = np.cross(y, beyond)
            jacobian[:, :, column + 5] = -swing * (theta[:, i] / self.servos.gear[i])[:, None]
        for m in range(len(t.markers)):
            column = 6 + 6 * n + 3 * m
            jacobian[:, :, column : column + 3] = last[:, :3, :3] * (marker == m)[:, None, None]
        return p, jacobian


def _left_jacobian(vector: NDArray) -> NDArray:
    """Return d(rotation, as a turn in W) / d(rotation vector), the left Jacobian of SO(3).

    J = I + (1 - cos t)/t^2 [v]x + (t - sin t)/t^3 [v]x^2.
    """
    angle, k = np.linalg.norm(vector), skew(vector)
    if angle < 1e-5:
        return np.eye(3) + 0.5 * k + k @ k / 6.0
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + first * k + second * k @ k
