"""Stopping several axes, each of them even when another fails."""

from collections.abc import Callable, Sequence

from nico_selfmodel.errors import RobotError, ServoFault
from nico_selfmodel.servos.arm.axis import Axis
from nico_selfmodel.servos.arm.motor import JointBus, Reading
from nico_selfmodel.servos.arm.servo_config import LONGEST_STOP
from nico_selfmodel.servos.arm.take_over import take_over
from nico_selfmodel.servos.bus_settings import NoisyLineError
from nico_selfmodel.servos.ports import PortLostError

_STANDSTILL = 1.0
"""How long a joint that was stopped may take until it stands [s]."""
_PAUSE = 0.1
"""Between two looks at a joint that is to stand [s]."""


def stop_each(bus: JointBus, axes: Sequence[Axis], *, smoothly: bool = True) -> list[str]:
    """Stop axes and have them hold: all at once, then each by itself, as a group cannot answer.

    Each is looked at before it is told by itself; one that has a fault by then is switched off.

    Args:
        axes: Which were enabled.
        smoothly: Brake, instead of stopping at once.

    Returns:
        What failed, in words; empty if every axis confirmed.

    Raises:
        PortLostError: If the port is gone: then nobody can be told.
    """
    if not axes:
        return []
    failures = []
    try:
        bus.stop_all([axis.motor for axis in axes], smoothly=smoothly)
    except PortLostError:
        raise
    except RobotError as error:
        failures.append(str(error))
    # Not before: who interrupts this must find something to stop.
    for axis in axes:
        axis.stopped()
    return failures + _each(axes, lambda axis: _confirm_stop(axis, smoothly=smoothly))


def _confirm_stop(axis: Axis, *, smoothly: bool) -> None:
    """Stop an axis by itself; where it has a fault it is switched off, and that is raised."""
    switch_off_if_faulty(axis)
    axis.motor.stop(smoothly=smoothly)


def _each(axes: Sequence[Axis], action: Callable[[Axis], object]) -> list[str]:
    """Do something with each axis; return why it failed, in words.

    On a line that never becomes quiet nobody else can be understood either.

    Raises:
        PortLostError: If the port is gone.
    """
    failures = []
    for axis in axes:
        try:
            action(axis)
        except NoisyLineError as error:
            return [*failures, f"{error}; all were told, none could confirm"]
        except PortLostError:
            raise
        except ServoFault as fault:
            failures.append(str(fault))
        except RobotError as error:
            failures.append(f"{axis}: {error}")
    return failures


def without_faults(axes: Sequence[Axis]) -> list[Axis]:
    """Look at axes before they are told to hold; those that have a fault are switched off.

    Being told to stop and hold would switch them on: after an emergency stop that is all of them.

    Returns:
        The others. Where one does not answer those behind it are not waited for: to stop counts
        more, and `stop_each` looks at each again.
    """
    for axis in axes:
        try:
            switch_off_if_faulty(axis)
        except ServoFault:
            continue  # the state tells
        except RobotError:
            break
    return [axis for axis in axes if axis.enabled]


def switch_off_if_faulty(axis: Axis) -> None:
    """Look at an axis, and switch it off where it has a fault.

    Raises:
        ServoFault: Its fault.
        BusError: If it does not answer.
    """
    try:
        axis.accept(axis.motor.poll())
    except ServoFault as fault:
        axis.lost = str(fault)
        release_each([axis])
        raise


def release_each(axes: Sequence[Axis]) -> list[str]:
    """Switch motors off: what gravity pulls falls.

    Returns:
        What failed, in words; empty if every axis confirmed.
    """
    for axis in axes:
        axis.enabled = False
        axis.stopped()
    return _each(axes, lambda axis: axis.motor.release())


def release_at_once(bus: JointBus, axes: Sequence[Axis]) -> list[str]:
    """Switch motors off, first all without waiting for an answer, then each until it confirms.

    Returns:
        What failed, in words; empty if every axis confirmed.
    """
    failures = []
    try:
        bus.release_all([axis.motor for axis in axes])
    except PortLostError:
        raise
    except RobotError as error:
        failures.append(str(error))
    return failures + release_each(axes)


def still_moving(bus: JointBus, axes: Sequence[Axis]) -> list[str]:
    """Wait until axes that were stopped stand, and stop abruptly what does not come to rest.

    Returns:
        Names of those that still move then, a joint that falls or is pushed among them.

    Raises:
        BusError: If one does not answer.
        ServoFault: If one reports a fault.
    """
    for smoothly in (True, False):
        until = bus.port.now() + _STANDSTILL
        while going := _going(bus, axes):
            if bus.port.now() > until:
                break
        if not going:
            return []
        if smoothly:
            stop_each(bus, [axis for axis in axes if axis.enabled], smoothly=False)
    return [axis.joint.name for axis in going]


def _going(bus: JointBus, axes: Sequence[Axis]) -> list[Axis]:
    """Look at axes twice; return those that moved in between, or are still braking."""
    before = [_look(axis) for axis in axes]
    bus.port.sleep(_PAUSE)
    after = [_look(axis) for axis in axes]
    return [
        axis
        for axis, one, other in zip(axes, before, after, strict=True)
        if not other.standing or abs(other.position - one.position) > axis.joint.still
    ]


def _look(axis: Axis) -> Reading:
    axis.accept(axis.motor.poll())
    assert axis.last is not None
    return axis.last


def stop_unseen(bus: JointBus, axes: Sequence[Axis], *, release: bool) -> None:
    """Stop or release axes before anybody is looked for, at the rate of the configuration.

    Each is asked but once; where one is silent all that may listen are told without an answer.

    Args:
        bus: Their bus; need not be connected.
        axes: All of the arm.
        release: Switch motors off too: what gravity pulls falls.

    Raises:
        PortLostError: If the port is gone.
    """
    with bus.hurried():
        silent = _each(axes, lambda axis: axis.motor.halt())
    motors = [axis.motor for axis in axes]
    if release:
        bus.release_all(motors)
    elif silent:
        bus.stop_all(motors, smoothly=True)
        # Of a motor that nobody can look at the acceleration is not known.
        bus.port.sleep(LONGEST_STOP)
        bus.stop_all(motors, smoothly=False)


def stop_what_answers(axes: Sequence[Axis], *, release: bool) -> tuple[list[str], list[str]]:
    """Stop or release axes of an arm that cannot be connected as a whole.

    Args:
        axes: All of the arm.
        release: Switch motors off too: what gravity pulls falls.

    Returns:
        Names of the joints that confirmed, and what failed, in words.
    """
    _each(axes, lambda axis: axis.motor.halt())  # all brake before the first is waited for
    done, failures = [], []
    for axis in axes:
        failed = _each([axis], take_over)
        if release and not failed:
            failed = release_each([axis])
        failures += failed
        done += [] if failed else [axis.joint.name]
    return done, failures
