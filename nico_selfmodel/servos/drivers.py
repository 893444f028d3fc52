"""Which driver, which scan and which simulation belong to a make; each is loaded when it is used."""

from collections.abc import Callable
from typing import Any

from nico_selfmodel.servos.arm.motor import JointBus
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings


def open_joint_bus(port: str, config: ServoConfig, settings: BusSettings) -> JointBus:
    """Open the motors of a configuration; sends nothing.

    Raises:
        PortLostError: If the port cannot be opened.
        BusError: If the package that speaks to this make is missing.
    """
    from nico_selfmodel.servos.pic_servo.joint_bus import PicServoJointBus

    return PicServoJointBus.open(port, config, settings)


def simulated_line(make: str) -> Callable[..., Any]:
    """Return the class of a make's simulated line: `(motors or how many, faults, plant)`."""
    from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine

    return PicServoLine
