"""What must be true of a joint before it may be sent anywhere."""

import math
from collections.abc import Sequence

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.arm.axis import Axis

_FARTHEST_DEG = 360.0
"""Wherever a joint stood when its power came, it is read less than a turn beyond its limits."""


def require_zero(axes: Sequence[Axis], *, trusted: bool) -> None:
    """Refuse joints that do not know where they are.

    Args:
        axes: The joints that are to move; connected.
        trusted: Whether the zero of power-up is good enough.

    Raises:
        ServoFault: If a zero is not known, or a reading cannot be true.
    """
    unknown = [axis.joint.name for axis in axes if not axis.zero_known]
    if unknown and not trusted:
        raise ServoFault(
            f"rezero is due: the zero of {', '.join(unknown)} is not known since the boards "
            "were switched on; home the arm, or trust the zero that it has"
        )
    for axis in axes:
        joint = axis.joint
        at = math.degrees(joint.reading(axis.position) / joint.counts_per_radian)
        low, high = math.degrees(joint.lower), math.degrees(joint.upper)
        if not low - _FARTHEST_DEG <= at <= high + _FARTHEST_DEG:
            raise ServoFault(
                f"{axis} reads {at:.0f} deg, its limits are {low:.1f} to {high:.1f} deg: its zero "
                "is lost; home it before moving"
            )


def require_ready(axes: Sequence[Axis], *, trusted: bool) -> None:
    """Refuse joints that cannot move now, or do not know where they are.

    Args:
        axes: The joints that are to move; connected.
        trusted: Whether the zero of power-up is good enough.

    Raises:
        ServoFault: If one is lost, not enabled, or its zero is not known.
    """
    for axis in axes:
        if axis.lost:
            raise ServoFault(f"{axis.lost}; connect anew before moving")
        if not axis.enabled:
            raise ServoFault(f"{axis} is not enabled: enable it before moving")
    require_zero(axes, trusted=trusted)
