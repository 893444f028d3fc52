"""The simulated line of Feetech servos."""

from nico_selfmodel.servos.feetech.simulated.packets import FeetechFraming
from nico_selfmodel.servos.feetech.simulated.servo import SimulatedFeetech
from nico_selfmodel.servos.register_servo.simulated.line import RegisterLine
from nico_selfmodel.servos.register_servo.simulated.servo import SimulatedServo


class FeetechLine(RegisterLine):
    """Servos on one half-duplex line."""

    servo_type = SimulatedFeetech
    framing = FeetechFraming()

    def ailing(self, module: SimulatedServo) -> int:
        """Return the bits that say what ails a servo."""
        return module.faults
