"""Which driver, scan and simulation belong to a make; each is loaded when it is used."""

from collections.abc import Callable
from typing import Any

from nico_selfmodel.servos.arm.motor import JointBus
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.found_motor import FoundMotor, Scan
from nico_selfmodel.servos.makes import DYNAMIXEL, FEETECH, Make, make_named


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


def simulated_motors(config: ServoConfig) -> Any:
    """Return the simulated motors of a configuration, as `SimulatedBus` takes them."""
    servo_type = getattr(simulated_line(config.make.name), "servo_type", None)
    if servo_type is None:
        return len(config.joints)  # boards are given their addresses
    return [servo_type(joint.address, baud=config.baud) for joint in config.joints]


def scan_port(make: Make, port: str, baud: int | None, last: int) -> Scan:
    """Find the motors on a port. Moves and resets nothing.

    Args:
        make: Theirs.
        port: Serial port.
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
    if make is DYNAMIXEL:
        from nico_selfmodel.servos.dynamixel.joint_bus import DynamixelJointBus
        from nico_selfmodel.servos.dynamixel.sdk import DynamixelSdk

        return _scan_servos(make, port, baud, last, DynamixelSdk(), DynamixelJointBus)
    if make is FEETECH:
        from nico_selfmodel.servos.feetech.joint_bus import FeetechJointBus
        from nico_selfmodel.servos.feetech.sdk import FeetechSdk

        return _scan_servos(make, port, baud, last, FeetechSdk(), FeetechJointBus)
    from nico_selfmodel.servos.pic_servo.line.bus import Bus
    from nico_selfmodel.servos.pic_servo.line.chain import scan

    with Bus.open(port, baud or make.bauds[0]) as bus:
        found = [
            FoundMotor(
                module.address,
                str(module.device),
                module.status.position or 0,
                module.servo_on,
                module.zero_known,
                module.newly_addressed,
            )
            for module in scan(bus, range(1, last + 1))
        ]
        return Scan(bus.rate, tuple(found), bus.total())


def _scan_servos(make: Make, port: str, baud: int | None, last: int, sdk: Any, kind: Any) -> Scan:
    from nico_selfmodel.servos.ports import SerialPort
    from nico_selfmodel.servos.register_servo.register_bus import RegisterBus
    from nico_selfmodel.servos.register_servo.scanning import scan_servos

    rates = make.bauds if baud is None else (baud,)
    bus = RegisterBus(SerialPort(port, rates[0]), sdk)
    try:
        return scan_servos(bus, kind, make, rates, last)
    finally:
        bus.close()
