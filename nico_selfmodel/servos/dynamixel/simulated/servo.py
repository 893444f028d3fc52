"""A simulated Dynamixel of the X series: its control table, its profile, its watchdog."""

import math

from nico_selfmodel.servos.dynamixel import motor as table
from nico_selfmodel.servos.dynamixel.sdk import ALERT
from nico_selfmodel.servos.dynamixel.simulated.packets import DynamixelFraming
from nico_selfmodel.servos.makes import DYNAMIXEL
from nico_selfmodel.servos.profile import Motion
from nico_selfmodel.servos.register_servo.simulated.line import RegisterLine
from nico_selfmodel.servos.register_servo.simulated.servo import RefusedError, SimulatedServo

RANGE, LIMIT, ACCESS = 4, 6, 7
"""Errors of a status packet."""
_FAST = 1e6


class SimulatedDynamixel(SimulatedServo):
    """An XM430-W350. What it does where the manual is silent is what would be worst for a host."""

    size = 256
    torque_register = table.TORQUE_ENABLE

    def power_cycle(self) -> None:
        """Come up anew: off, without faults; what outlasts the power stays."""
        super().power_cycle()
        if not any(self.table):
            self._put(0, 1020, 2)
            self.table[6] = 45  # firmware
            self.table[table.OPERATING_MODE] = 3
            self._put(table.LARGEST_POSITION, 4095)
        self.table[table.TORQUE_ENABLE :] = bytes(self.size - table.TORQUE_ENABLE)
        self._put(table.GOAL_POSITION, self.position)

    def _put(self, register: int, value: int, length: int = 4) -> None:
        self.table[register : register + length] = value.to_bytes(
            length, "little", signed=value < 0
        )

    def _get(self, register: int, length: int = 4) -> int:
        return table.signed(self.table[register : register + length])

    def refresh(self) -> None:
        """Bring the registers up to date that say how things are."""
        moving = self.profile.motion == Motion.TRAPEZOID
        self.table[table.HARDWARE_ERROR] = self.faults
        self._put(120, (int(self.time * 1e3) + 37 * self.serial) & 0x7FFF, 2)
        self.table[122], self.table[table.MOVING_STATUS] = moving, 2 * moving + (not moving)
        rate = round(self.profile.rate / DYNAMIXEL.velocity_step)
        self._put(128, rate)
        self._put(table.PRESENT_POSITION, self.position)
        self._put(table.VELOCITY_TRAJECTORY, rate)
        self._put(table.POSITION_TRAJECTORY, self.profile.counts if self.servo_on else 0)

    def write(self, register: int, data: bytes) -> None:
        """Write registers, and do what that says.

        Raises:
            RefusedError: If they may not be written now.
        """
        end = register + len(data)
        if register < table.TORQUE_ENABLE and self.table[table.TORQUE_ENABLE]:
            raise RefusedError(ACCESS)
        if end > table.MOVING_STATUS:
            raise RefusedError(ACCESS)

        def covers(other: int) -> bool:
            return register <= other < end

        if covers(table.TORQUE_ENABLE) and self.faults:
            raise RefusedError(ACCESS)
        if covers(table.GOAL_POSITION):
            if self.table[table.BUS_WATCHDOG] == table.WATCHDOG_ENDED:
                raise RefusedError(ACCESS)
            begin = table.GOAL_POSITION - register
            goal = table.signed(data[begin : begin + 4])
            first, last = self._get(table.SMALLEST_POSITION), self._get(table.LARGEST_POSITION)
            if not first <= goal <= last:
                raise RefusedError(LIMIT)
        self.table[register:end] = data
        if covers(table.HOMING_OFFSET):
            self.offset = self._get(table.HOMING_OFFSET)
        if covers(table.TORQUE_ENABLE):
            self.switch(on=bool(data[table.TORQUE_ENABLE - register]))
        if self.servo_on and any(
            map(covers, (table.TORQUE_ENABLE, table.GOAL_POSITION, table.BUS_WATCHDOG))
        ):
            self._go()

    def _go(self) -> None:
        velocity = self._get(table.PROFILE_VELOCITY) * DYNAMIXEL.velocity_step
        acceleration = self._get(table.PROFILE_ACCELERATION) * DYNAMIXEL.acceleration_step
        goal = self._get(table.GOAL_POSITION)
        self.profile.go(goal, velocity or _FAST, acceleration or _FAST)

    def watch(self) -> None:
        """Stop where nothing was heard for as long as the watchdog says."""
        units = self.table[table.BUS_WATCHDOG]
        if units in (0, table.WATCHDOG_ENDED) or not self.servo_on:
            return
        ends = self.heard + units * table.WATCHDOG_UNIT
        if self.time > ends and math.isfinite(ends):
            self.profile.advance(ends)
            self.profile.hold()
            self.table[table.BUS_WATCHDOG] = table.WATCHDOG_ENDED


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
