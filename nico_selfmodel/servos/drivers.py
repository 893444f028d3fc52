"""Which driver, scan and simulation belong to a make; each is loaded when it is used."""

from collections.abc import Callable
from typing import Any

from nico_selfmodel.servos.arm.motor import JointBus
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.makes import DYNAMIXEL, FEETECH, make_named


def open_joint_bus(port: str, config: ServoConfig, settings: BusSettings) -> JointBus:
    """Open the motors of a configuration; sends nothing.

    Raises:
        PortLostError: If the port cannot be opened.
        BusError: If the package that speaks to this make is missing.
    """
    if config.make is DYNAMIXEL:
        from nico_selfmodel.servos.dynamixel.joint_bus import DynamixelJointBus

        return DynamixelJointBus.open(port, config, settings)
    if config.make is FEETECH:
        from nico_selfmodel.servos.feetech.joint_bus import FeetechJointBus

        return FeetechJointBus.open(port, config, settings)
    from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus

    return PicServoJointBus.open(port, config, settings)


def simulated_line(make: str) -> Callable[..., Any]:
    """Return the class of a make's simulated line: `(motors or how many, faults, plant)`.

    Raises:
        ValueError: If there is no such make.
    """
    if make_named(make) is DYNAMIXEL:
        from nico_selfmodel.servos.dynamixel.simulated.line import DynamixelLine

        return DynamixelLine
    if make_named(make) is FEETECH:
        from nico_selfmodel.servos.feetech.simulated.line import FeetechLine

        return FeetechLine
    from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine

    return PicServoLine
