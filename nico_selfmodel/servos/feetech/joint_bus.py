"""The Feetech servos of an arm on their bus."""

from nico_selfmodel.servos.feetech.motor import MODEL, SMALLEST_POSITION, FeetechMotor
from nico_selfmodel.servos.feetech.sdk import FeetechSdk
from nico_selfmodel.servos.feetech.simulated.servo import FeetechLine
from nico_selfmodel.servos.makes import FEETECH
from nico_selfmodel.servos.register_servo.joint_bus import RegisterJointBus
from nico_selfmodel.servos.register_servo.register_motor import RegisterMotor

MODELS = {777: "STS3215", 2825: "STS3250"}
"""Model number -> name: those whose memory table is that of the STS series."""


class FeetechJointBus(RegisterJointBus):
    """The servos of a configuration."""

    make, sdk_type, motor_type = FEETECH, FeetechSdk, FeetechMotor
    model_register, models = MODEL, MODELS

    @staticmethod
    def simulated_line() -> type[FeetechLine]:
        """Return the class of the simulated line of such servos."""
        return FeetechLine

    def limits(self, motor: RegisterMotor) -> tuple[int, int]:
        """Return the servo's own limits [register].

        Raises:
            BusError: If it does not answer.
        """
        data = self.bus.read(motor.address, SMALLEST_POSITION, 4).data
        first, last = int.from_bytes(data[:2], "little"), int.from_bytes(data[2:], "little")
        return (first, last) if last else self.config.make.registers  # 0: many turns
