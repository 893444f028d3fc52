"""A simulated Feetech STS3215: its memory table and its profile. It has no watchdog."""

from nico_selfmodel.servos.feetech import motor as table
from nico_selfmodel.servos.feetech.simulated.packets import FeetechFraming
from nico_selfmodel.servos.profile import Motion
from nico_selfmodel.servos.register_servo.simulated.line import RegisterLine
from nico_selfmodel.servos.register_servo.simulated.servo import SimulatedServo

_LARGEST_POSITION, _TIME = 11, 44
_VOLTAGE, _TEMPERATURE = 62, 63
_FAST = 1e6


class SimulatedFeetech(SimulatedServo):
    """An STS3215. What it does where the manual is silent is what would be worst for a host."""

    size = 80
    torque_register = table.TORQUE_ENABLE

    def power_cycle(self) -> None:
        """Come up anew: off, without faults; what outlasts the power stays."""
        super().power_cycle()
        if not any(self.table):
            self._kept = bytearray(table.TORQUE_ENABLE)
            self._kept[table.MODEL : table.MODEL + 2] = (777).to_bytes(2, "little")
            self._kept[_LARGEST_POSITION : _LARGEST_POSITION + 2] = (4095).to_bytes(2, "little")
        self.table = bytearray(self._kept) + bytearray(self.size - len(self._kept))
        self.table[table.LOCK] = 1
        self._take_offset()

    def _take_offset(self) -> None:
        data = self.table[table.HOMING_OFFSET : table.HOMING_OFFSET + 2]
        self.offset = -table.from_magnitude(data, table.SIGN_OF_OFFSET)

    def _signed(self, register: int) -> int:
        return table.from_magnitude(self.table[register : register + 2])

    def refresh(self) -> None:
        """Bring the registers up to date that say how things are."""
        pairs = ((table.PRESENT_POSITION, self.position), (table.PRESENT_SPEED, self.profile.rate))
        for register, value in pairs:
            self.table[register : register + 2] = table.to_magnitude(round(value))
        self.table[_VOLTAGE], self.table[_TEMPERATURE] = 121, 30 + self.serial % 20
        self.table[table.STATUS] = self.faults
        self.table[table.MOVING] = self.profile.motion == Motion.TRAPEZOID

    def write(self, register: int, data: bytes) -> None:
        """Write registers, and do what that says."""
        end = min(register + len(data), table.PRESENT_POSITION)
        data = data[: max(0, end - register)]
        self.table[register:end] = data
        if register < table.TORQUE_ENABLE:
            if not self.table[table.LOCK]:
                self._kept[register : min(end, table.TORQUE_ENABLE)] = data
            self._take_offset()
        if register <= table.TORQUE_ENABLE < end:
            if data[table.TORQUE_ENABLE - register]:
                self.faults = 0
            self.switch(on=bool(data[table.TORQUE_ENABLE - register]))
        if self.servo_on and register <= table.GOAL_SPEED + 1 and end > table.TORQUE_ENABLE:
            self._go()

    def _go(self) -> None:
        goal = self._signed(table.GOAL_POSITION)
        first, last = (
            int.from_bytes(self.table[k : k + 2], "little")
            for k in (table.SMALLEST_POSITION, _LARGEST_POSITION)
        )
        goal = max(first, min(last, goal)) if last else goal
        acceleration = 100.0 * self.table[table.ACCELERATION]
        speed = abs(self._signed(table.GOAL_SPEED))
        self.profile.go(goal, speed or _FAST, acceleration or _FAST)


class FeetechLine(RegisterLine):
    """Servos on one half-duplex line."""

    servo_type = SimulatedFeetech
    framing = FeetechFraming()

    def ailing(self, module: SimulatedServo) -> int:
        """Return the bits that say what ails a servo."""
        return module.faults
