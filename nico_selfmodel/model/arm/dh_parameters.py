"""Names, values and derivatives of the Denavit-Hartenberg parameters of a measured arm.

The vector holds M0 (position and rotation vector of frame 0), for each joint D, theta_offset, r,
alpha, beta and gear, and for each marker its point in the last frame. theta_offset is the encoder
angle at theta = 0: `sign * radians(reading) = theta_offset + gear * theta` (thesis eq. 6.8).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import (
    rotation_from_vector,
    rotation_vector_of,
    rotation_vector_slope,
)
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.model.arm.loaded_posture import loaded
from nico_selfmodel.model.arm.servo_map import ServoMap

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
    bending: Bending | None = None
    """What bends; a rigid arm if omitted."""

    @property
    def base_turn(self) -> NDArray:
        """Rotation vector of frame 0 in W [rad]. Shape (3,)."""
        return rotation_vector_of(self.table.X_W0[:3, :3]) if self.turn is None else self.turn

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters: 6 + 6 n + 3 m, and those of what bends."""
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        joints = [f"{joint}.{part}" for joint in self.table.joints for part in JOINT_PARTS]
        hands = [f"hand.{marker}.{axis}" for marker in self.table.markers for axis in "xyz"]
        bent = () if self.bending is None else self.bending.names
        return (*M0_NAMES, *joints, *hands, *bent)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of all parameters, `m`, `rad`, `1` (encoder per joint angle) or `rad/m`."""
        joints = [_UNITS[part] for _ in self.table.joints for part in JOINT_PARTS]
        hands = ("m",) * (3 * len(self.table.markers))
        bent = () if self.bending is None else self.bending.units
        return (*("m",) * 3, *("rad",) * 3, *joints, *hands, *bent)

    def scales(self, size: float) -> NDArray:
        """Return the natural size of each parameter, on which a sigma says if it is known at all.

        A radian of the joint, which is as many gears of the encoder; the arm's own lengths; the
        gear itself. What is read in other units, or through another gear, is known as well.

        Args:
            size: Of the arm or of its workspace [m].

        Returns:
            Shape (P,).
        """
        by_unit = {"m": size, "rad": 1.0, "1": 1.0, "rad/m": 1.0 / size}
        scales = np.array([by_unit[unit] for unit in self.units])
        joints = scales[6 : 6 + 6 * len(self.servos.gear)].reshape(-1, len(JOINT_PARTS))
        for part in ("theta_offset", "gear"):
            joints[:, JOINT_PARTS.index(part)] = self.servos.gear
        return scales

    @property
    def values(self) -> NDArray:
        """Values in the order of `names`."""
        t = self.table
        theta_offset = self.servos.offset - self.servos.gear * t.theta_zero
        joints = np.stack([t.D, theta_offset, t.r, t.alpha, t.beta, self.servos.gear], axis=1)
        base = np.concatenate([t.X_W0[:3, 3], self.base_turn])
        bent = np.zeros(0) if self.bending is None else self.bending.values
        return np.concatenate([base, joints.ravel(), t.p_NH.ravel(), bent])

    @property
    def gears(self) -> NDArray:
        """Gears of the joints. Shape (n,)."""
        return self.servos.gear

    def with_bending(self, bending: Bending | None) -> "DhParameters":
        """Return the same arm in which something else bends."""
        return replace(self, bending=bending)

    @property
    def gauge(self) -> frozenset[str]:
        """Names that no measurement of points can tell from the others; fixed by default."""
        joints = self.table.joints
        names = {f"{joints[0]}.theta_offset", f"{joints[-1]}.alpha"}
        names |= {f"{j}.D" for j, fixed in zip(joints, self.table.fixed_D, strict=True) if fixed}
        parallel = self.table.parallel
        names |= {f"{j}.beta" for j, near in zip(joints, parallel, strict=True) if not near}
        return frozenset(names | {f"hand.{self.table.markers[0]}.{axis}" for axis in "xyz"})

    def with_values(self, values: NDArray) -> "DhParameters":
        """Return the same arm with other values, in the order of `names`; theta_zero stays."""
        t, n = self.table, len(self.table.joints)
        ends = [6, 6 + 6 * n, 6 + 6 * n + 3 * len(t.markers)]
        base, joints, hands, bent = np.split(np.asarray(values, dtype=float), ends)
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
        bending = None if self.bending is None else self.bending.with_values(bent)
        servos = replace(self.servos, offset=offset, gear=gear)
        return DhParameters(table, servos, base[3:], bending)

    def points(
        self, encoder_angles: NDArray, marker: NDArray, approach: NDArray | None = None
    ) -> NDArray:
        """Predict tracked points alone, as `predict` does. Shape (N, 3)."""
        q = (encoder_angles - self.servos.offset) / self.servos.gear
        return loaded(self.table, self.bending, q, approach).points(self.table.p_NH[marker])

    def predict(
        self, encoder_angles: NDArray, marker: NDArray, approach: NDArray | None = None
    ) -> tuple[NDArray, NDArray]:
        """Predict tracked points with their derivatives by every parameter.

        Turning about an axis (unit a through o) moves the hand p by a x (p - o), sliding along it
        by a; theta = (encoder - theta_offset) / gear.

        Args:
            encoder_angles: `ServoMap.to_radians` of the readings, floats or Drake's scalars.
                Shape (N, n).
            marker: Index of each pose's tracked point. Shape (N,).
            approach: How each encoder angle last moved, -1, 1, or 0 where it is not known, as all
                are if omitted. Shape (N, n).

        Returns:
            p_WH, shape (N, 3), and its derivatives, shape (N, 3, P).
        """
        t, n = self.table, len(self.table.joints)
        q = (encoder_angles - self.servos.offset) / self.servos.gear
        posture = loaded(t, self.bending, q, approach)
        frames = posture.frames
        last = frames[-1].transpose(1, 2, 0)
        R = last[:3, :3]
        p = np.sum(R * t.p_NH[marker].T, axis=1) + last[:3, 3]
        by_pose = np.zeros((3, len(self.names), len(q)), p.dtype)
        by_pose[:, :3] = np.eye(3)[:, :, None]
        turn = rotation_vector_slope(self.base_turn)
        by_pose[:, 3:6] = cross(turn[:, :, None], (p - t.X_W0[:3, 3:])[:, None])
        for k, by_part in enumerate(self._by_joint(frames, p, posture.q + t.theta_zero)):
            by_pose[:, 6 + k : 6 + 6 * n : 6] = by_part
        for m in range(len(t.markers)):
            column = 6 + 6 * n + 3 * m
            by_pose[:, column : column + 3] = R * (marker == m)
        if self.bending is not None:
            by_pose[:, 6 + 6 * n + 3 * len(t.markers) :] = posture.slopes(
                self.bending, p.T
            ).transpose(0, 2, 1)
        return p.T, by_pose.transpose(2, 0, 1)

    def _by_joint(self, frames: NDArray, p: NDArray, theta: NDArray) -> tuple[NDArray, ...]:
        """Return the derivatives by each of the parts of rows, p of shape (3, N). (3, n, N)."""
        t, gear = self.table, self.servos.gear[:, None]
        axes = frames[:, :, :3].transpose(2, 3, 0, 1)
        arm = p[:, None] - axes[:, 3]
        z, y = axes[:, 2, :-1], axes[:, 1, 1:]
        # The frame after a row has turned by beta about y since alpha turned it about this x.
        x = np.cos(t.beta)[:, None] * axes[:, 0, 1:] + np.sin(t.beta)[:, None] * axes[:, 2, 1:]
        swing = -cross(z, arm[:, :-1]) / gear
        beyond = arm[:, 1:]
        return z, swing, x, cross(x, beyond), cross(y, beyond), swing * theta.T


def slopes_by_angle(parameters: DhParameters, jacobian: NDArray) -> NDArray:
    """Return derivatives by the joint angles, dp/dq = -gear dp/d(theta_offset). Shape (N, 3, n)."""
    at = [parameters.names.index(f"{joint}.theta_offset") for joint in parameters.table.joints]
    return -jacobian[:, :, at] * parameters.servos.gear
