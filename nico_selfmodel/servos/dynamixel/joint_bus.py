"""The Dynamixels of an arm on their bus."""

from nico_selfmodel.errors import RobotError
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.dynamixel.motor import LARGEST_POSITION, DynamixelMotor, signed
from nico_selfmodel.servos.dynamixel.sdk import DynamixelSdk
from nico_selfmodel.servos.dynamixel.simulated.servo import DynamixelLine
from nico_selfmodel.servos.makes import DYNAMIXEL
from nico_selfmodel.servos.register_servo.joint_bus import RegisterJointBus
from nico_selfmodel.servos.register_servo.register_bus import RegisterBus
from nico_selfmodel.servos.register_servo.register_motor import RegisterMotor

MODELS = {
    30: "MX-28(2.0)", 311: "MX-64(2.0)", 321: "MX-106(2.0)",
    1000: "XH430-W350", 1001: "XD430-T350", 1010: "XH430-W210", 1011: "XD430-T210",
    1020: "XM430-W350", 1030: "XM430-W210", 1040: "XH430-V350", 1050: "XH430-V210",
    1060: "XL430-W250", 1070: "XC430-W150", 1080: "XC430-W240", 1090: "2XL430-W250",
    1100: "XH540-W270", 1101: "XD540-T270", 1110: "XH540-W150", 1111: "XD540-T150",
    1120: "XM540-W270", 1130: "XM540-W150", 1140: "XH540-V270", 1150: "XH540-V150",
    1160: "2XC430-W250", 1170: "XW540-T260", 1180: "XW540-T140", 1190: "XL330-M077",
    1200: "XL330-M288", 1210: "XC330-T181", 1220: "XC330-T288", 1230: "XC330-M181",
    1240: "XC330-M288", 1270: "XW430-T333", 1280: "XW430-T200",
}  # fmt: skip
"""Model number -> name: those whose control table is that of the X series."""
MODEL_REGISTER = 0


class DynamixelJointBus(RegisterJointBus):
    """The servos of a configuration."""

    make, sdk_type, motor_type = DYNAMIXEL, DynamixelSdk, DynamixelMotor
    model_register, models = MODEL_REGISTER, MODELS

    def __init__(self, bus: RegisterBus, config: ServoConfig) -> None:
        """Describe them."""
        super().__init__(bus, config)
        for motor in self.motors:
            assert isinstance(motor, DynamixelMotor)
            motor.heartbeat = config.heartbeat

    @staticmethod
    def simulated_line() -> type[DynamixelLine]:
        """Return the class of the simulated line of such servos."""
        return DynamixelLine

    def limits(self, motor: RegisterMotor) -> tuple[int, int]:
        """Return the servo's own limits [register].

        Raises:
            BusError: If it does not answer.
        """
        data = self.bus.read(motor.address, LARGEST_POSITION, 8).data
        return signed(data[4:]), signed(data[:4])

    def close(self) -> None:
        """Give the port back; the servos hold without watching for packets. Never fails."""
        for motor in self.motors:
            if motor.told is not None:
                try:
                    motor.watch_over(on=False)
                except RobotError:
                    break  # its watchdog ends, and it stops; connecting sets it anew
        super().close()
