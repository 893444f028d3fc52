"""Trapezoidal motions of several joints that start and end together."""

from collections.abc import Sequence

from nico_selfmodel.servos.arm.axis import Axis
from nico_selfmodel.servos.arm.trapezoid import common_duration, speed_for


def aim_together(
    axes: Sequence[Axis], goals: Sequence[int], speeds: Sequence[float], rates: Sequence[float]
) -> float:
    """Aim axes so that all arrive when the slowest does; sends nothing.

    Args:
        axes: Which joints; read lately.
        goals: Where to, within their limits [register].
        speeds: At most the limits [counts/s].
        rates: Accelerations, at most the limits [counts/s^2].

    Returns:
        How long it will take [s].

    Raises:
        ServoFault: If a joint was not read yet.
    """
    distances = [abs(goal - axis.commanded) for axis, goal in zip(axes, goals, strict=True)]
    seconds = common_duration(distances, speeds, rates)
    for axis, goal, d, v, a in zip(axes, goals, distances, speeds, rates, strict=True):
        axis.aim(goal, min(v, axis.joint.faster(speed_for(d, seconds, v, a))), a)
    return seconds
