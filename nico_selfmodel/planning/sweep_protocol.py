"""Which poses an arm under motion capture visits: home, sweeps, random poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.planning.plans import Plan, random_commands, sweep_commands
from nico_selfmodel.plant import ArmDescription

_NICO_HOME = {
    "shoulder_pitch": -50.0,
    "shoulder_roll": 30.0,
    "upper_arm_twist": -20.0,
    "elbow": -75.0,
}
"""Elbow bent, so that no joint's axis passes near the hand [deg]."""
_NICO_ARCS = {
    "shoulder_pitch": 48.0,
    "shoulder_roll": 63.0,
    "upper_arm_twist": 100.0,
    "elbow": 64.0,
}
"""What the tracker sees of each joint's circle [deg]."""
_NICO_RANGES = {
    "shoulder_pitch": 90.0,
    "shoulder_roll": 80.0,
    "upper_arm_twist": 120.0,
    "elbow": 100.0,
}
"""Where random poses keep the hand in sight [deg]."""


@dataclass(frozen=True, eq=False)
class SweepProtocol:
    """Which poses a session visits."""

    home: NDArray
    """Home as a share of each joint's range between its stops. Shape (n,)."""
    arcs: NDArray
    """Arc of each joint's sweep, as a share of its range. Shape (n,)."""
    ranges: NDArray
    """Range of random poses about home, as a share. Shape (n,)."""
    circle_points: int = 26
    """Poses on each joint's circle, home included."""
    home_repeats: int = 4
    """Visits of home."""
    random_poses: int = 0
    """Random poses."""

    @classmethod
    def for_arm(cls, arm: ArmDescription) -> "SweepProtocol":
        """Return a protocol that suits an arm: Nico's own, or up to 120 deg within the stops."""
        span = np.degrees(arm.upper - arm.lower)
        lower = np.degrees(arm.lower)
        home = 0.5 * np.ones(len(span))
        arcs = np.minimum(1.0, 120.0 / span)
        ranges = arcs.copy()
        for i, joint in enumerate(arm.joints):
            part = joint.split("_", 1)[1] if "_" in joint else joint
            if arm.robot == "nico" and part in _NICO_HOME:
                home[i] = (_NICO_HOME[part] - lower[i]) / span[i]
                arcs[i], ranges[i] = _NICO_ARCS[part] / span[i], _NICO_RANGES[part] / span[i]
        return cls(home, arcs, ranges)

    def on_share_of_arcs(self, share: float) -> "SweepProtocol":
        """Return the protocol with shorter sweeps."""
        return replace(self, arcs=share * self.arcs)

    def minimal(self) -> "SweepProtocol":
        """Return the protocol of nine samples: home once, two more poses a joint."""
        return replace(self, circle_points=3, home_repeats=1)

    def plan(
        self, joints: Sequence[JointInfo], rng: np.random.Generator, *, sweeps: bool = True
    ) -> Plan:
        """Return the poses for joints with stops, circles only if wanted."""
        lower = np.array([joint.lower for joint in joints], dtype=float)
        upper = np.array([joint.upper for joint in joints], dtype=float)
        span = upper - lower
        home = lower + self.home * span
        plan: Plan = []
        if sweeps:
            counts = [self.circle_points - 1] * len(span)
            plan += sweep_commands(
                joints, home, self.arcs * span, counts, home_repeats=self.home_repeats
            )
        return plan + random_commands(joints, home, self.ranges * span, self.random_poses, rng)
