"""A Dynamixel of the X series: its control table, its own watchdog, its faults.

Addresses and units are those of the control table in Robotis' e-Manual.
"""

import math

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.dynamixel.sdk import ALERT, DynamixelSdk
from nico_selfmodel.servos.register_servo.register_motor import Goal, RegisterMotor, State
from nico_selfmodel.servos.register_servo.sdk import StatusPacket

DRIVE_MODE, OPERATING_MODE, HOMING_OFFSET, LARGEST_POSITION, SMALLEST_POSITION = 10, 11, 20, 48, 52
TORQUE_ENABLE, HARDWARE_ERROR, BUS_WATCHDOG = 64, 70, 98
PROFILE_ACCELERATION, PROFILE_VELOCITY, GOAL_POSITION = 108, 112, 116
MOVING_STATUS, PRESENT_POSITION, VELOCITY_TRAJECTORY, POSITION_TRAJECTORY = 123, 132, 136, 140

POSITION_MODES = (3, 4, 5)
"""Position, extended position, current-based position."""
TIME_BASED, REVERSED = 0x04, 0x01
"""Bits of the drive mode."""
PROFILE_ONGOING = 0x02
"""Bit of the moving status."""
WATCHDOG_UNIT = 20e-3
WATCHDOG_ENDED = 0xFF
_LARGEST_OFFSET = 1024
"""Of a homing offset, in position mode [counts]."""
_REBOOT = 0.5
"""How long a servo needs to start anew [s]."""
HARDWARE_ERRORS = {
    0x01: "its supply voltage is out of range",
    0x04: "it is too hot: let it cool",
    0x08: "its encoder fails",
    0x10: "electrical shock: its supply is too weak",
    0x20: "overload: something blocks the joint; free it",
}


def signed(data: bytes | bytearray) -> int:
    """Return a little-endian number with a sign."""
    return int.from_bytes(data, "little", signed=True)


class DynamixelMotor(RegisterMotor):
    """A servo of the X series. Its profile and its watchdog are its own.

    Raises:
        BusError: From its methods, if the servo does not answer.
    """

    block = (PROFILE_ACCELERATION, POSITION_TRAJECTORY + 4 - PROFILE_ACCELERATION)
    goal_register = PROFILE_ACCELERATION
    torque_register = TORQUE_ENABLE
    position = (PRESENT_POSITION, 4)

    heartbeat = 0.3
    """After how long without a packet the servo stops by itself [s]."""

    def decode(self, status: StatusPacket) -> State:
        """Return what the registers of `block` say.

        Raises:
            BusError: If the servo has an error and does not answer which.
        """
        data = status.data

        def number(register: int, length: int = 4) -> int:
            begin = register - PROFILE_ACCELERATION
            return signed(data[begin : begin + length])

        moving = bool(data[MOVING_STATUS - PROFILE_ACCELERATION] & PROFILE_ONGOING)
        position = number(PRESENT_POSITION)
        goal = Goal(number(GOAL_POSITION), number(PROFILE_VELOCITY), number(PROFILE_ACCELERATION))
        return State(
            position=position,
            goal=goal,
            commanded=position if self.told is None else number(POSITION_TRAJECTORY),
            rate=number(VELOCITY_TRAJECTORY) * self.joint.make.velocity_step if moving else 0.0,
            standing=not moving,
            fault=self._fault(status, goal),
        )

    def _fault(self, status: StatusPacket, goal: Goal) -> str | None:
        if status.error & ALERT:
            error = self.bus.read(self.address, HARDWARE_ERROR, 1).data[0]
            words = [text for bit, text in HARDWARE_ERRORS.items() if error & bit]
            if words:
                return f"{'; '.join(words)}; then enable it again"
        lost = (
            self.told is not None
            and self.told.velocity
            and not (goal.velocity or goal.acceleration)
        )
        if lost and not self.bus.read(self.address, TORQUE_ENABLE, 1).data[0]:
            return "it lost its power, and its servo is off; enable it again"
        return None

    @staticmethod
    def number(data: bytes) -> int:
        """Return the position that bytes hold."""
        return signed(data)

    def encode(self, goal: Goal) -> bytes:
        """Return profile acceleration, profile velocity and goal position."""
        return b"".join(
            value.to_bytes(4, "little", signed=True)
            for value in (goal.acceleration, goal.velocity, goal.position)
        )

    def recover(self) -> None:
        """Set the watchdog anew where it has ended: until then the servo takes no goal."""
        if self.bus.read(self.address, BUS_WATCHDOG, 1).data[0] == WATCHDOG_ENDED:
            self.watch_over(on=True)
            self.waiting = True

    def watch_over(self, *, on: bool) -> None:
        """Let the servo stop by itself when it hears nothing for the heartbeat."""
        self.bus.write(self.address, BUS_WATCHDOG, b"\x00")  # clears one that has ended
        if on:
            units = min(127, math.ceil(self.heartbeat / WATCHDOG_UNIT))
            self.bus.write(self.address, BUS_WATCHDOG, bytes((units,)))

    def forget_profile(self) -> None:
        """Do nothing: the servo tells where its profile is."""

    def prepare(self) -> None:
        """Clear faults, and choose position mode with a profile of speeds.

        Raises:
            ServoFault: If it refuses.
        """
        self.told = None
        if self.bus.read(self.address, HARDWARE_ERROR, 1).data[0]:
            self._reboot()  # nothing else clears it, and the servo is off already
        self.bus.write(self.address, BUS_WATCHDOG, b"\x00")
        drive, mode = self.bus.read(self.address, DRIVE_MODE, 2).data
        if mode in POSITION_MODES and not drive & (TIME_BASED | REVERSED):
            return
        if drive & REVERSED:
            raise ServoFault(
                f"servo {self.address} is set to reverse mode, which turns its register round: "
                "clear bit 0 of its drive mode and give the joint 'sign: -1' instead"
            )
        self.bus.write(self.address, TORQUE_ENABLE, b"\x00")
        self.bus.write(self.address, DRIVE_MODE, bytes((drive & ~TIME_BASED,)))
        self.bus.write(self.address, OPERATING_MODE, bytes((POSITION_MODES[0],)))

    def _reboot(self) -> None:
        sdk = self.bus.sdk
        assert isinstance(sdk, DynamixelSdk)
        self.bus.send(lambda port: sdk.reboot(port, self.address))
        self.bus.port.sleep(_REBOOT)

    def homing_offset(self) -> int:
        """Return its homing offset [counts].

        Raises:
            BusError: If it does not answer.
        """
        return signed(self.bus.read(self.address, HOMING_OFFSET, 4).data)

    def zero_at(self, register: int) -> None:
        """Make where it stands `register`, by its homing offset.

        Raises:
            ServoFault: If it is switched on, or its offset does not reach that far.
            BusError: If it does not answer.
        """
        offset = self.homing_offset() + register - self.look().position
        self.check_offset(offset, _LARGEST_OFFSET)
        self.bus.write(self.address, HOMING_OFFSET, offset.to_bytes(4, "little", signed=True))
