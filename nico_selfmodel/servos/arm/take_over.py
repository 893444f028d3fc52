"""Getting in touch with motors, and letting them hold, without moving any."""

from nico_selfmodel.servos.arm.axis import Axis


def take_over(axis: Axis) -> None:
    """Look at a motor, stop it where it is still moving, and set it up where it holds.

    It is not switched on; one that is driven without its servo is switched off.

    Raises:
        BusError: If it does not answer.
    """
    axis.lost, axis.enabled, axis.last = None, False, None
    axis.forget_goal()
    axis.begin_anew()
    if axis.motor.take_over():
        axis.stopped()
        axis.enabled = True
    axis.zero_known = axis.motor.knows_its_zero()
    axis.accept(axis.motor.poll())


def switch_on(axis: Axis) -> None:
    """Let a motor hold where its joint stands.

    Nothing moves; faults are cleared, and what the joint was to do before is forgotten.

    Raises:
        BusError: If the motor does not answer.
        ServoFault: If it reports a fault still.
    """
    axis.forget_goal()
    axis.motor.switch_on()
    axis.enabled, axis.lost = True, None
    axis.begin_anew()
    axis.accept(axis.motor.poll())
