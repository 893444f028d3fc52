"""The simulated line of Dynamixels."""

from nico_selfmodel.servos.dynamixel.sdk import ALERT
from nico_selfmodel.servos.dynamixel.simulated.packets import DynamixelFraming
from nico_selfmodel.servos.dynamixel.simulated.servo import SimulatedDynamixel
from nico_selfmodel.servos.register_servo.simulated.line import RegisterLine
from nico_selfmodel.servos.register_servo.simulated.servo import SimulatedServo


class DynamixelLine(RegisterLine):
    """Servos on one half-duplex line that speak protocol 2.0."""

    servo_type = SimulatedDynamixel
    framing = DynamixelFraming()

    def greeting(self, module: SimulatedServo) -> bytes:
        """Return model and firmware."""
        return bytes((*module.table[:2], module.table[6]))

    def ailing(self, module: SimulatedServo) -> int:
        """Return the bit that says that something ails a servo."""
        return ALERT if module.faults else 0
