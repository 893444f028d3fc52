"""The Feetech servos of an arm on their bus."""

from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.feetech.motor import MODEL, SMALLEST_POSITION, FeetechMotor
from nico_selfmodel.servos.feetech.sdk import FeetechSdk
from nico_selfmodel.servos.ports import SerialPort
from nico_selfmodel.servos.register_servo.joint_bus import RegisterJointBus
from nico_selfmodel.servos.register_servo.register_bus import RegisterBus
from nico_selfmodel.servos.register_servo.register_motor import RegisterMotor

MODELS = {777: "STS3215", 2825: "STS3250"}
"""Model number -> name: those whose memory table is that of the STS series."""


class FeetechJointBus(RegisterJointBus):
    """The servos of a configuration."""

    motor_type = FeetechMotor
    model_register, models = MODEL, MODELS

    @classmethod
    def open(cls, port: str, config: ServoConfig, settings: BusSettings) -> "FeetechJointBus":
        """Open a port; sends nothing.

        Raises:
            PortLostError: If the port cannot be opened.
            BusError: If the package `feetech-servo-sdk` is missing.
        """
        sdk = FeetechSdk()
        return cls(RegisterBus(SerialPort(port, config.baud), sdk, settings), config)

    def limits(self, motor: RegisterMotor) -> tuple[int, int]:
        """Return the servo's own limits [register].

        Raises:
            BusError: If it does not answer.
        """
        data = self.bus.read(motor.address, SMALLEST_POSITION, 4).data
        first, last = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:], "little")
        return (first, last) if last else self.config.make.registers  # 0: many turns
