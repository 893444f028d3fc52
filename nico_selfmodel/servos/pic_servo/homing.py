"""Finding the zero of a joint again after the power was off."""

import math
from collections.abc import Callable
from contextlib import suppress

from nico_selfmodel.errors import RobotError, ServoFault
from nico_selfmodel.servos.arm.axis import Axis
from nico_selfmodel.servos.arm.controller import ArmController
from nico_selfmodel.servos.arm.zeroing import set_zero
from nico_selfmodel.servos.pic_servo.joint_bus import PicServoMotor
from nico_selfmodel.servos.pic_servo.line.board import PicServo
from nico_selfmodel.servos.pic_servo.protocol.commands import HomingMode
from nico_selfmodel.servos.pic_servo.protocol.status import StatusFlag, StatusItem

_EVENTS = {
    "limit_1": HomingMode.LIMIT_1,
    "limit_2": HomingMode.LIMIT_2,
    "index": HomingMode.INDEX,
}
_EXTRA_TIME = 2.0


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
    _board(axis).capture_home(_EVENTS[home.method] | HomingMode.SMOOTH)
    axis.refresh()
    way = math.copysign(home.travel, home.speed) * scale
    axis.aim(
        axis.position + axis.joint.register(way),
        abs(home.speed) * scale,
        axis.joint.largest_acceleration,
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
        _board(axis).capture_home(0)


def _searching(axis: Axis) -> bool:
    assert isinstance(axis.motor, PicServoMotor)
    return bool(axis.motor.flags & StatusFlag.HOMING)


def _take_capture(arm: ArmController, axis: Axis) -> None:
    """Wait until the joint stands, then count its position from the captured one.

    Raises:
        ServoFault: If it does not come to rest, or reports a fault.
        BusError: If it does not answer.
    """
    until = arm.now() + _EXTRA_TIME
    status, moved = _board(axis).read(StatusItem.POSITION | StatusItem.HOME), True
    while moved or not (axis.last and axis.last.standing):
        if arm.now() > until:
            _give_up(arm, axis)
            raise ServoFault(
                f"{axis}: it found {axis.joint.home.method}, but does not come to rest within "
                f"{_EXTRA_TIME:g} s, so that its zero is not known: does it slip or swing? Hold "
                "it, then home it again"
            )
        before = status.position
        axis.accept(axis.motor.poll())
        status = _board(axis).read(StatusItem.POSITION | StatusItem.HOME)
        moved = status.position != before
    assert status.position is not None
    assert status.home is not None
    home = axis.joint.register(axis.joint.home.at * axis.joint.counts_per_radian)
    set_zero(axis, home + status.position - status.home)
    arm.heartbeat()


def _board(axis: Axis) -> PicServo:
    assert isinstance(axis.motor, PicServoMotor)  # no other make has marks: see ServoConfig
    return axis.motor.board
