"""Saying where the zero of a joint is."""

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.arm.axis import Axis
from nico_selfmodel.servos.arm.controller import ArmController


def zero_here(arm: ArmController, joint: str, angle: float | None = None) -> None:
    """Say that a joint stands at its home now. Nothing moves; best with the motors off.

    Args:
        joint: Which.
        angle: Encoder angle where it stands [rad]; that of its home if omitted.

    Raises:
        ValueError: If there is no such joint.
        ServoFault: If it moves, or its motor does not take the position.
        BusError: If it does not answer.
    """
    axis = arm.axis(joint)
    if axis.on_its_way:
        raise ServoFault(f"{axis} moves: wait until it stands, then home it")
    angle = axis.joint.home.at if angle is None else angle
    set_zero(axis, axis.joint.register(angle * axis.joint.counts_per_radian))


def set_zero(axis: Axis, register: int) -> None:
    """Make where a joint stands `register`.

    Raises:
        ServoFault: If its motor does not take it.
        BusError: If it does not answer.
    """
    axis.forget_goal()
    axis.motor.zero_at(register)
    axis.begin_anew()
    axis.zero_known = True
    axis.last = None  # what was read before counts from another zero
    axis.accept(axis.motor.poll())
