"""Finding the zero of a joint again after the power was off."""

import math
from collections.abc import Callable
from contextlib import suppress

from nico_selfmodel.errors import RobotError, ServoFault
from nico_selfmodel.servos.pic_servo.arm.axis import Axis
from nico_selfmodel.servos.pic_servo.arm.controller import ArmController
from nico_selfmodel.servos.pic_servo.protocol.commands import HomingMode
from nico_selfmodel.servos.pic_servo.protocol.status import StatusFlag, StatusItem

_EVENTS = {
    "limit_1": HomingMode.LIMIT_1,
    "limit_2": HomingMode.LIMIT_2,
    "index": HomingMode.INDEX,
}
_EXTRA_TIME = 2.0


def zero_here(arm: ArmController, joint: str, angle: float | None = None) -> None:
    """Say that a joint stands at its home now. Nothing moves; best with the motors off.

    Args:
        arm: A connected arm.
        joint: Which.
        angle: Encoder angle where it stands [rad]; that of its home if omitted.

    Raises:
        ValueError: If there is no such joint.
        ServoFault: If it moves, or its board does not take the position.
        BusError: If it does not answer.
    """
    axis = arm.axis(joint)
    if axis.on_its_way:
        raise ServoFault(f"{axis} moves: wait until it stands, then home it")
    angle = axis.joint.home.at if angle is None else angle
    _set_zero(axis, axis.joint.register(angle * axis.joint.counts_per_radian))


def find_home(
    arm: ArmController, joint: str, watch: Callable[[ArmController], object] | None = None
) -> None:
    """Move a joint until its mark shows, and take its zero from there.

    It moves slowly, never further than the configuration says, and like every motion only as long
    as this goes on.

    Args:
        arm: A connected arm with the joint enabled.
        joint: Which; its `home` must name a mark.
        watch: Called after each reading.

    Raises:
        ValueError: If there is no such joint, or its home is where a person puts it.
        ServoFault: If the mark does not show on the way, or the board reports a fault.
        BusError: If it does not answer.
    """
    axis = arm.axis(joint)
    home = axis.joint.home
    if home.method not in _EVENTS:
        raise ValueError(f"{joint} has no mark to look for: put it at its home and zero it there")
    if not axis.enabled:
        raise ServoFault(f"{axis} is not enabled: enable it before homing")
    try:
        _look_for_mark(arm, axis, watch)
    except BaseException:
        _give_up(arm, axis)
        raise
    arm.stop()
    _take_capture(arm, axis)


def _look_for_mark(
    arm: ArmController, axis: Axis, watch: Callable[[ArmController], object] | None
) -> None:
    home, scale = axis.joint.home, axis.joint.counts_per_radian
    axis.module.capture_home(_EVENTS[home.method] | HomingMode.SMOOTH)
    axis.refresh()
    way = math.copysign(home.travel, home.speed) * scale
    axis.aim(
        axis.position + axis.joint.register(way),
        abs(home.speed) * scale,
        axis.joint.max_acceleration * scale,
    )
    until = arm.now() + home.travel / abs(home.speed) + _EXTRA_TIME
    while _searching(axis):
        arm.heartbeat()
        try:
            arm.cycle()
        except ServoFault as error:
            raise ServoFault(
                f"{error}. It was looking for {home.method}: does it stand behind a hard stop?",
                partial=error.partial,
            ) from error
        if watch is not None:
            watch(arm)
        if not axis.on_its_way or arm.now() > until:
            raise ServoFault(
                f"{axis}: no {home.method} within {math.degrees(home.travel):g} deg; check the "
                "switch, and 'home' in the servo configuration"
            )


def _give_up(arm: ArmController, axis: Axis) -> None:
    """Stop, and disarm the board: it would brake at its mark in the midst of a later motion."""
    with suppress(RobotError):
        arm.stop()
    with suppress(RobotError):
        axis.module.capture_home(0)


def _searching(axis: Axis) -> bool:
    return axis.status is not None and bool(axis.status.flags & StatusFlag.HOMING)


def _take_capture(arm: ArmController, axis: Axis) -> None:
    """Wait until the joint stands, then count its position from the captured one."""
    status = axis.module.read(StatusItem.POSITION | StatusItem.HOME)
    while not axis.module.poll().flags & StatusFlag.MOVE_DONE or _differs(axis, status.position):
        status = axis.module.read(StatusItem.POSITION | StatusItem.HOME)
    assert status.position is not None
    assert status.home is not None
    home = axis.joint.register(axis.joint.home.at * axis.joint.counts_per_radian)
    _set_zero(axis, home + status.position - status.home)
    arm.heartbeat()


def _differs(axis: Axis, position: int | None) -> bool:
    return position is None or axis.module.read(StatusItem.POSITION).position != position


def _set_zero(axis: Axis, register: int) -> None:
    axis.forget_goal()
    axis.module.zero_at(register)
    axis.begin_anew()
    axis.zero_known = True
    axis.status = None  # what was read before counts from another zero
    axis.accept(axis.module.poll())
