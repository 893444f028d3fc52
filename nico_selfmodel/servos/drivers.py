"""Which driver belongs to a make, loaded when it is used."""

from collections.abc import Callable
from typing import Any

from nico_selfmodel.servos.arm.motor import JointBus
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.found_motor import Scan
from nico_selfmodel.servos.makes import DYNAMIXEL, FEETECH, Make, make_named


def driver_of(make: Make) -> type[JointBus]:
    """Return the driver of a make: the one place that says which it is."""
    if make is DYNAMIXEL:
        from nico_selfmodel.servos.dynamixel.joint_bus import DynamixelJointBus

        return DynamixelJointBus
    if make is FEETECH:
        from nico_selfmodel.servos.feetech.joint_bus import FeetechJointBus

        return FeetechJointBus
    from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus

    return PicServoJointBus


def simulated_line(make: str) -> Callable[..., Any]:
    """Return the class of a make's simulated line: `(motors or how many, faults, plant)`.

    Raises:
        ValueError: If there is no such make.
    """
    return driver_of(make_named(make)).simulated_line()


def simulated_motors(config: ServoConfig) -> Any:
    """Return the simulated motors of a configuration, as `SimulatedBus` takes them."""
    servo_type = getattr(simulated_line(config.make.name), "servo_type", None)
    if servo_type is None:
        return len(config.joints)  # boards are given their addresses
    return [servo_type(joint.address, baud=config.baud) for joint in config.joints]


def scan_port(make: Make, port: str, baud: int | None, last: int) -> Scan:
    """Find the motors on a port. Moves and resets nothing.

    Args:
        baud: Rate of the line; PIC-SERVO boards are looked for at 19200, servos at every rate, if
            None.
        last: Highest address to look at.

    Raises:
        ValueError: If motors of this make have no such rate.
        PortLostError: If the port cannot be opened.
        BusError: If the package that speaks to this make is missing, or two share an address.
    """
    if baud is not None and baud not in make.bauds:
        raise ValueError(f"--baud must be one of {sorted(make.bauds)}, got {baud}")
    return driver_of(make).scan(port, baud, last)
