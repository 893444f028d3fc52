"""Which poses an arm under motion capture visits: home, sweeps, random poses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.planning.plans import Plan, random_commands, sweep_commands
from nico_selfmodel.plant import ArmDescription


@dataclass(frozen=True)
class _Swept:
    """How a joint of a known robot is swept [deg]."""

    home: float
    """Where it stands while others are swept."""
    arc: float
    """What the tracker sees of its circle."""
    range: float
    """Where random poses keep the hand in sight."""


# The elbow is bent, so that no joint's axis passes near the hand.
_SWEPT = {
    "nico": {
        "shoulder_pitch": _Swept(home=-50.0, arc=48.0, range=90.0),
        "shoulder_roll": _Swept(home=30.0, arc=63.0, range=80.0),
        "upper_arm_twist": _Swept(home=-20.0, arc=100.0, range=120.0),
        "elbow": _Swept(home=-75.0, arc=64.0, range=100.0),
    }
}
"""Robot -> joint, of whichever side -> how it is swept."""


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
        """Return what suits an arm: the robot's own, or up to 120 deg within the stops."""
        span = np.degrees(arm.upper - arm.lower)
        lower = np.degrees(arm.lower)
        home = 0.5 * np.ones(len(span))
        arcs = np.minimum(1.0, 120.0 / span)
        ranges = arcs.copy()
        known = _SWEPT.get(arm.robot, {})
        for i, joint in enumerate(arm.joints):
            if swept := known.get(joint.split("_", 1)[-1]):
                home[i] = (swept.home - lower[i]) / span[i]
                arcs[i], ranges[i] = swept.arc / span[i], swept.range / span[i]
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
