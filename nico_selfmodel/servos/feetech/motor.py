"""A Feetech servo of the STS series: its memory table, and a profile that is reckoned here.

The servo tells where it is, not where its own profile wants it to be, and has no watchdog. Its
profile is trapezoidal and known, so that where it should be by now is worked out beside it.
Addresses and units are those of Feetech's memory table of the STS3215.
"""

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.profile import Motion, TimedProfile
from nico_selfmodel.servos.register_servo.register_motor import Goal, RegisterMotor, State
from nico_selfmodel.servos.register_servo.sdk import StatusPacket

MODEL, SMALLEST_POSITION, HOMING_OFFSET, MODE = 3, 9, 31, 33
TORQUE_ENABLE, ACCELERATION, GOAL_POSITION, GOAL_SPEED, LOCK = 40, 41, 42, 46, 55
PRESENT_POSITION, PRESENT_SPEED, STATUS, MOVING = 56, 58, 65, 66
SIGN_OF_POSITION, SIGN_OF_OFFSET = 15, 11
"""Bits that are the sign: the others are the magnitude."""
FAULTS = {
    0x01: "its supply voltage is out of range",
    0x02: "its encoder fails",
    0x04: "it is too hot: let it cool",
    0x08: "over-current: something blocks the joint; free it",
    0x20: "overload: something blocks the joint; free it",
}


def from_magnitude(data: bytes | bytearray, sign: int = SIGN_OF_POSITION) -> int:
    """Return a number that is kept as sign and magnitude, low byte first."""
    value = int.from_bytes(data, "little")
    magnitude = value & ((1 << sign) - 1)
    return -magnitude if value >> sign & 1 else magnitude


def to_magnitude(value: int, sign: int = SIGN_OF_POSITION) -> bytes:
    """Return the two bytes of a number that is kept as sign and magnitude."""
    return ((1 << sign if value < 0 else 0) | abs(value)).to_bytes(2, "little")


class FeetechMotor(RegisterMotor):
    """A servo of the STS series."""

    block = (TORQUE_ENABLE, MOVING + 1 - TORQUE_ENABLE)
    goal_register = ACCELERATION
    torque_register = TORQUE_ENABLE
    position = (PRESENT_POSITION, 2)

    _profile: TimedProfile | None = None
    """Where the servo should be by now, None where that is not known yet."""

    def decode(self, status: StatusPacket) -> State:
        """Return what the registers of `block` say, and where the servo should be by now."""
        data = status.data

        def pair(register: int) -> bytes:
            return data[register - TORQUE_ENABLE : register - TORQUE_ENABLE + 2]

        position = from_magnitude(pair(PRESENT_POSITION))
        goal = Goal(
            from_magnitude(pair(GOAL_POSITION)),
            from_magnitude(pair(GOAL_SPEED)),
            data[ACCELERATION - TORQUE_ENABLE],
        )
        profile, moving = self._profile, bool(data[MOVING - TORQUE_ENABLE])
        if profile is None or self.told is None:
            rate = float(from_magnitude(pair(PRESENT_SPEED))) if moving else 0.0
            # One that holds hangs below its goal, and must not be told to stay there.
            commanded = goal.position if data[0] and not moving else position
            return State(position, goal, commanded, rate, not moving, self._fault(status))
        profile.advance(self.now)
        return State(
            position=position,
            goal=goal,
            commanded=profile.counts,
            rate=profile.rate,
            standing=profile.motion != Motion.TRAPEZOID,
            fault=self._fault(status),
        )

    def _fault(self, status: StatusPacket) -> str | None:
        errors = status.error | status.data[STATUS - TORQUE_ENABLE]
        words = [text for bit, text in FAULTS.items() if errors & bit]
        if words:
            return f"{'; '.join(words)}; then enable it again"
        if self.told is not None and not status.data[0]:
            return "its servo is off though nobody switched it off; enable it again"
        return None

    @staticmethod
    def number(data: bytes) -> int:
        """Return the position that bytes hold."""
        return from_magnitude(data)

    def encode(self, goal: Goal) -> bytes:
        """Return acceleration, goal position, goal time (none) and goal speed."""
        position, speed = to_magnitude(goal.position), to_magnitude(goal.velocity)
        return bytes((goal.acceleration,)) + position + b"\x00\x00" + speed

    def was_written(self) -> None:
        """Let the profile go to the goal that has been sent."""
        super().was_written()
        if self.told is None or self.state is None:
            return
        if self._profile is None:
            self._profile = TimedProfile(self.now)
            self._profile.place(self.state.commanded)
        self._profile.advance(self.now)
        velocity, acceleration = self.told.velocity, 100.0 * self.told.acceleration
        self._profile.go(self.told.position, velocity, acceleration)

    def forget_profile(self) -> None:
        """Note that where the servo is to be is where it stands."""
        self._profile = None

    def recover(self) -> None:
        """Do nothing: a servo that holds another goal is told again."""

    def watch_over(self, *, on: bool) -> None:
        """Do nothing: there is no watchdog. No goal lies further ahead than the heartbeat."""

    def prepare(self) -> None:
        """Choose position mode; faults go with the next switching on.

        Raises:
            BusError: If the servo does not answer.
        """
        self.told = None
        self.bus.write(self.address, TORQUE_ENABLE, b"\x00")
        if self.bus.read(self.address, MODE, 1).data[0]:
            self._write_for_good(MODE, b"\x00")

    def _write_for_good(self, register: int, data: bytes) -> None:
        """Write a register that outlasts the power."""
        self.bus.write(self.address, LOCK, b"\x00")
        self.bus.write(self.address, register, data)
        self.bus.write(self.address, LOCK, b"\x01")

    def homing_offset(self) -> int:
        """Return its homing offset [counts].

        Raises:
            BusError: If it does not answer.
        """
        return from_magnitude(self.bus.read(self.address, HOMING_OFFSET, 2).data, SIGN_OF_OFFSET)

    def zero_at(self, register: int) -> None:
        """Make where it stands `register`, by its homing offset.

        Raises:
            ServoFault: If it is switched on, or its offset does not reach that far.
            BusError: If it does not answer.
        """
        if self.bus.read(self.address, TORQUE_ENABLE, 1).data[0]:
            raise ServoFault(f"servo {self.address} is switched on: release it, then home it")
        # Its position is the encoder's less the offset.
        offset = self.homing_offset() - register + self.look().position
        self.check_offset(offset, (1 << SIGN_OF_OFFSET) - 1)
        self._write_for_good(HOMING_OFFSET, to_magnitude(offset, SIGN_OF_OFFSET))
