"""Plans: sweep labels and commands, in the order in which a body visits them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.joint_info import JointInfo

HOME = "home"
Plan = list[tuple[str, NDArray]]
"""Sweep label (a joint, `home`, or empty for a free pose) and command of each pose."""


def sweep_commands(
    joints: Sequence[JointInfo],
    home: ArrayLike,
    arcs: ArrayLike,
    counts: Sequence[int],
    *,
    home_repeats: int = 1,
) -> list[tuple[str, NDArray]]:
    """Plan a circle of every joint about a shared home pose (thesis algorithm 1).

    Args:
        joints: Joints with stops.
        home: Home pose [encoder units]. Shape (n,).
        arcs: Arc of each joint, spread evenly about home and kept between the stops
            [encoder units]. Shape (n,).
        counts: Poses of each joint beside home. Length n.
        home_repeats: How often home itself is visited.

    Returns:
        Sweep labels and commands.
    """
    home = np.asarray(home, dtype=float)
    plan = [(HOME, home)] * home_repeats
    for i, (joint, arc, count) in enumerate(
        zip(joints, np.asarray(arcs, dtype=float), counts, strict=True)
    ):
        low, high = home[i] - 0.5 * arc, home[i] + 0.5 * arc
        low = low if joint.lower is None else max(low, joint.lower)
        high = high if joint.upper is None else min(high, joint.upper)
        # An odd count would visit home again in its middle.
        values = np.linspace(low, high, count + count % 2)
        for value in values[np.sort(np.argsort(-np.abs(values - home[i]), kind="stable")[:count])]:
            command = home.copy()
            command[i] = value
            plan.append((joint.name, command))
    return plan


def random_commands(
    joints: Sequence[JointInfo],
    home: ArrayLike,
    ranges: ArrayLike,
    count: int,
    rng: np.random.Generator,
) -> list[tuple[str, NDArray]]:
    """Plan random poses within a range about home, kept between the stops.

    Args:
        joints: Joints with stops.
        home: Home pose [encoder units]. Shape (n,).
        ranges: Full range of each joint about home [encoder units]. Shape (n,).

    Returns:
        Empty sweep labels and commands.
    """
    home, half = np.asarray(home, dtype=float), 0.5 * np.asarray(ranges, dtype=float)
    low = [-np.inf if joint.lower is None else joint.lower for joint in joints]
    high = [np.inf if joint.upper is None else joint.upper for joint in joints]
    low, high = np.maximum(home - half, low), np.minimum(home + half, high)
    return [("", command) for command in rng.uniform(low, high, (count, len(home)))]


def given_commands(joints: Sequence[JointInfo], readings: ArrayLike) -> Plan:
    """Plan poses that somebody chose.

    Args:
        joints: Joints; those with stops are kept between them.
        readings: The poses [encoder units]. Shape (N, n).

    Returns:
        Empty sweep labels and commands.

    Raises:
        ValueError: If there is no pose, or one lies beyond a stop.
    """
    readings = np.asarray(readings, dtype=float)
    if readings.ndim != 2 or readings.shape[1] != len(joints) or not len(readings):
        raise ValueError(f"poses must have shape (N, {len(joints)}), got {readings.shape}")
    for joint, column in zip(joints, readings.T, strict=True):
        low = -np.inf if joint.lower is None else joint.lower
        high = np.inf if joint.upper is None else joint.upper
        beyond = np.flatnonzero((column < low) | (column > high))
        if beyond.size:
            raise ValueError(
                f"pose {beyond[0] + 1} of {len(readings)}: {joint.name} would go to "
                f"{column[beyond[0]]:g}, its stops are at {low:g} and {high:g}"
            )
    return [("", command) for command in readings]


def commands_of_angles(
    joints: Sequence[JointInfo], lower: ArrayLike, upper: ArrayLike, q: ArrayLike
) -> NDArray:
    """Return commands for joint angles of a description, as shares of the joints' ranges.

    A body that has not learned its servos knows its stops, and about where they should be.

    Args:
        joints: Joints with stops.
        lower: Lower limits of the description [rad]. Shape (n,).
        upper: Upper limits of the description [rad]. Shape (n,).
        q: Joint angles of the description [rad]. Shape (N, n).

    Returns:
        Commands [encoder units]. Shape (N, n).

    Raises:
        ValueError: If a joint has no stops.
    """
    low, high = _stops(joints)
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    return low + (np.asarray(q, dtype=float) - lower) / (upper - lower) * (high - low)


def angles_of_commands(
    joints: Sequence[JointInfo], lower: ArrayLike, upper: ArrayLike, commands: ArrayLike
) -> NDArray:
    """Return the joint angles of a description that commands stand for: see `commands_of_angles`.

    Args:
        joints: Joints with stops.
        lower: Lower limits of the description [rad]. Shape (n,).
        upper: Upper limits of the description [rad]. Shape (n,).
        commands: Commands [encoder units]. Shape (N, n).

    Returns:
        Joint angles of the description [rad]. Shape (N, n).

    Raises:
        ValueError: If a joint has no stops.
    """
    low, high = _stops(joints)
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    return lower + (np.asarray(commands, dtype=float) - low) / (high - low) * (upper - lower)


def _stops(joints: Sequence[JointInfo]) -> NDArray:
    """Return readings at the lower and upper limits of a description. Shape (2, n)."""
    free = [joint.name for joint in joints if joint.lower is None or joint.upper is None]
    if free:
        raise ValueError(f"joints without stops cannot be sent by angle: {', '.join(free)}")
    stops = np.array([[joint.lower, joint.upper] for joint in joints], dtype=float)
    falling = np.array([joint.sign < 0 for joint in joints])  # as the joint turns forward
    return np.where(falling[:, None], stops[:, ::-1], stops).T


def pose_plan(
    joints: Sequence[JointInfo],
    home: ArrayLike,
    ends: ArrayLike,
    circle_poses: int,
    free: ArrayLike,
    home_repeats: int = 1,
) -> Plan:
    """Plan home, a circle of every joint between two ends about it, and free poses.

    Args:
        home: Pose that all circles share [encoder units]. Shape (n,).
        ends: Lower and upper end of each joint's circle [encoder units]. Shape (n, 2).
        circle_poses: Poses on all circles together, home not counted.
        free: Free poses [encoder units]. Shape (K, n), K may be 0.
        home_repeats: How often home is visited.
    """
    home, ends = np.asarray(home, dtype=float), np.asarray(ends, dtype=float)
    n = len(joints)
    plan: Plan = [(HOME, home)] * home_repeats if circle_poses else []
    for i, joint in enumerate(joints):
        count = circle_poses // n + (1 if i < circle_poses % n else 0)
        for value in np.linspace(ends[i, 0], ends[i, 1], count):
            command = home.copy()
            command[i] = value
            plan.append((joint.name, command))
    return plan + [("", pose) for pose in np.reshape(np.asarray(free, dtype=float), (-1, n))]
