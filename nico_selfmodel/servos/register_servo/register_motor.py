"""One servo as the arm's controller sees it: goals that are read back, and written until they fit.

What several servos are told at once nobody confirms. So with each position the servo's own goal,
speed and acceleration are read, and what is not what it was told is told again.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.arm.motor import Reading
from nico_selfmodel.servos.arm.servo_config import JointServo
from nico_selfmodel.servos.link_counts import LinkCounts
from nico_selfmodel.servos.register_servo.register_bus import RegisterBus
from nico_selfmodel.servos.register_servo.sdk import StatusPacket

_STOPS = 5
"""How often a stop is written before it counts as not taken."""
_PATIENCE = 0.5
"""How long a servo may hold another goal than it was told [s]: damaged packets are sent again."""
_TELLINGS = 3
"""How often it was told in that time at least: a host that hangs tells seldom, and lets the
watchdog of a Dynamixel end, which then takes no goal until it is told again."""


@dataclass(frozen=True)
class Goal:
    """What a servo was told: registers as it holds them."""

    position: int
    velocity: int
    acceleration: int


@dataclass(frozen=True)
class State:
    """What a servo's registers say."""

    position: int
    goal: Goal
    commanded: int
    """Where its profile wants it to be."""
    rate: float
    """How fast that moves [counts/s]."""
    standing: bool
    fault: str | None
    """What is wrong with it, if it is meant to hold."""


class RegisterMotor(ABC):
    """A servo at its id. Making one sends nothing.

    As of every `Motor`, each method raises `BusError` where it does not answer.
    """

    answers = False
    block: tuple[int, int]
    """Registers that are read in each cycle: the first, and how many bytes."""
    goal_register: int
    """Where the bytes of `encode` begin."""
    torque_register: int
    position: tuple[int, int]
    """Register of the position, and how many bytes it has."""

    def __init__(self, joint: JointServo, bus: RegisterBus) -> None:
        """Stand for a servo."""
        self.joint, self.bus, self.address = joint, bus, joint.address
        self.told: Goal | None = None
        """What it is to hold, None where it is switched off."""
        self.waiting = False
        """Whether that was not written yet."""
        self.fresh: StatusPacket | None = None
        """What was read with the others, until it is used."""
        self.state: State | None = None
        """The last that was read."""
        self.seen = -math.inf
        """When [s]."""
        self._differs_since, self._tellings = math.inf, 0

    @property
    def counts(self) -> LinkCounts:
        """How well the wire to it works."""
        return self.bus.counts[self.address]

    @property
    def doubtful(self) -> bool:
        """Whether a reading counts only if a second one agrees."""
        return self.bus.noisy

    @property
    def now(self) -> float:
        """Time of the port [s]."""
        return self.bus.port.now()

    @abstractmethod
    def decode(self, status: StatusPacket) -> State:
        """Return what the registers of `block` say."""

    @staticmethod
    @abstractmethod
    def number(data: bytes) -> int:
        """Return the position that bytes hold."""

    @abstractmethod
    def encode(self, goal: Goal) -> bytes:
        """Return the bytes from `goal_register` on."""

    def units(self, velocity: float, acceleration: float) -> tuple[int, int]:
        """Return the registers of a speed [counts/s] and an acceleration [counts/s^2]."""
        make = self.joint.make
        v, a = velocity / make.velocity_step, acceleration / make.acceleration_step
        largest = round(make.largest_acceleration / make.acceleration_step)
        return max(1, round(v)), min(max(1, round(a)), largest)  # 0 would be no limit at all

    @abstractmethod
    def prepare(self) -> None:
        """Bring a servo that is off to where it may be switched on: mode, faults."""

    def look(self) -> State:
        """Read the servo now."""
        status, self.fresh = self.fresh, None
        if status is None:
            status = self.bus.read(self.address, *self.block)
        self.seen, self.state = self.now, self.decode(status)
        return self.state

    def poll(self) -> Reading:
        """Return what the servo says now; what it was told and does not hold is told again."""
        state = self.look()
        fault = state.fault
        if self.told is None or state.goal == self.told:
            self._differs_since, self._tellings = math.inf, 0
            if self._stalled(state):
                self.recover()
        elif not self.waiting:
            self.waiting = True
            self.counts.refused += 1
            self._differs_since = min(self._differs_since, self.now)
            self._tellings += 1
            self.recover()
        if self._tellings > _TELLINGS and self.now - self._differs_since > _PATIENCE:
            fault = fault or "it does not take its goals; switch it off and on, then enable it"
        return Reading(state.position, state.commanded, state.standing, fault)

    def look_again(self, reading: Reading) -> Reading:
        """Return a reading with its position read anew.

        A packet of the position alone is short: what damages two bytes of it so that its checksum
        does not show it is a hundred times rarer than of a whole state.
        """
        if reading.fault is not None or self.state is None:
            return self.poll()
        position = self.number(self.bus.read(self.address, *self.position).data)
        self.state = replace(self.state, position=position)
        return replace(reading, position=position)

    def _stalled(self, state: State) -> bool:
        """Return whether it stopped by itself before it was at its goal."""
        if self.told is None or self.waiting or not state.standing:
            return False
        return abs(state.commanded - self.told.position) > 1

    @abstractmethod
    def recover(self) -> None:
        """Make a servo take goals again that holds another one than it was told."""

    def move_to(
        self, goal: int, velocity: float | None, acceleration: float | None, *, start: bool
    ) -> Reading:
        """Note a goal; the bus sends it with those of the others, when it is flushed."""
        reading = self.poll()
        self.tell(goal, velocity, acceleration)
        return reading

    def brake(self, acceleration: float, *, start: bool) -> Reading:
        """Note that it is to slow down to a standstill."""
        reading = self.poll()
        self.tell_to_stop(smoothly=True, acceleration=acceleration)
        return reading

    def tell(self, goal: int, velocity: float | None, acceleration: float | None) -> None:
        """Note a goal [register, counts/s, counts/s^2]; what is None stays as it was."""
        v, a = self.units(velocity or 1.0, acceleration or 1.0)
        last = self.told
        self.told = Goal(
            goal,
            last.velocity if velocity is None and last else v,
            last.acceleration if acceleration is None and last else a,
        )
        self.waiting = True

    def tell_to_stop(self, *, smoothly: bool, acceleration: float | None = None) -> None:
        """Note that it is to stop, from what was read last: a goal that it stands at in time."""
        state = self.state
        if state is None or self.told is None:
            return
        first, last = self.joint.make.registers
        make, units = self.joint.make, state.goal.acceleration
        if not smoothly or (acceleration is None and units == 0):  # 0 is as fast as it can
            acceleration = make.largest_acceleration
        elif acceleration is None:
            acceleration = make.acceleration_step * units
        way = state.rate**2 / (2.0 * acceleration) if smoothly else 0.0
        if not state.standing:
            way += abs(state.rate) * max(0.0, self.now - self.seen)
        goal = round(state.commanded + math.copysign(way, state.rate))
        self.tell(max(first, min(last, goal)), None, acceleration)

    def stop(self, *, smoothly: bool) -> None:
        """Stop and hold; returns when it has confirmed.

        Raises:
            BusError: If it does not answer, or does not take it.
        """
        for _ in range(_STOPS):
            state = self.look()
            if self.told is None or (state.goal == self.told and not self.waiting):
                return
            self.recover()
            if not self.waiting:
                self.tell_to_stop(smoothly=smoothly)
            self.write_goal()
        raise BusError(f"servo {self.address} does not take the stop")

    def write_goal(self) -> None:
        """Write what it was told, by itself, so that it confirms.

        Raises:
            BusError: If it does not.
        """
        assert self.told is not None
        self.bus.write(self.address, self.goal_register, self.encode(self.told))
        self.was_written()

    def was_written(self) -> None:
        """Note that what it was told has been sent."""
        self.waiting = False

    def halt(self) -> None:
        """Begin to stop it where an earlier program left it moving.

        By the speed and the acceleration of the configuration: those of its registers are whatever
        was left there, so that a stop might take many seconds.
        """
        self.told, self.waiting, self.fresh = None, False, None
        self.forget_profile()
        holds = bool(self.bus.read(self.address, self.torque_register, 1).data[0])
        state = self.look()
        if not holds or state.fault is not None:
            return
        self.told = state.goal
        self.watch_over(on=True)
        if not (state.standing and abs(state.commanded - state.goal.position) <= 1):
            # One that stopped by itself must not go on to where it was sent.
            joint = self.joint
            acceleration = joint.largest_acceleration
            self.tell_to_stop(smoothly=True, acceleration=acceleration)
            assert self.told is not None
            self.tell(
                self.told.position, joint.max_velocity * joint.counts_per_radian, acceleration
            )
            self.write_goal()

    def take_over(self) -> bool:
        """Stop it where an earlier program left it moving.

        Returns:
            Whether it holds its joint, without a fault.
        """
        self.halt()
        if self.told is None:
            return False
        self.stop(smoothly=True)
        return True

    def switch_on(self) -> None:
        """Let it hold where it stands.

        Raises:
            BusError: If it does not answer.
            ServoFault: If it refuses.
        """
        self.prepare()
        self.forget_profile()
        state = self.look()
        joint = self.joint
        velocity = joint.max_velocity * joint.counts_per_radian
        # Before the torque, lest it go where it was sent last.
        self.tell(state.position, velocity, joint.largest_acceleration)
        self.write_goal()
        self.bus.write(self.address, self.torque_register, b"\x01")
        self.tell(self.look().position, None, None)
        self.write_goal()
        # Last: where its host was held up in between it would take no goal.
        self.watch_over(on=True)

    @abstractmethod
    def forget_profile(self) -> None:
        """Note that where the servo is to be is where it stands."""

    @abstractmethod
    def watch_over(self, *, on: bool) -> None:
        """Let the servo itself watch whether its host is alive, where it can."""

    def release(self) -> None:
        """Switch it off: a loaded joint falls."""
        self.told, self.waiting = None, False
        self.bus.write(self.address, self.torque_register, b"\x00")
        self.watch_over(on=False)

    def knows_its_zero(self) -> bool:
        """Return whether its homing offset is that of the configuration, or any will do."""
        wanted = self.joint.homing_offset
        return wanted is None or self.homing_offset() == wanted

    @abstractmethod
    def homing_offset(self) -> int:
        """Return its homing offset."""

    @abstractmethod
    def zero_at(self, register: int) -> None:
        """Make where it stands `register`, by its homing offset, which it keeps for good.

        Raises:
            ServoFault: If it is switched on, or its offset does not reach that far.
            BusError: If it does not answer.
        """

    def check_offset(self, offset: int, largest: int) -> None:
        """Refuse a homing offset [counts] that the servo cannot hold.

        Raises:
            ServoFault: If it does not reach that far.
        """
        if abs(offset) > largest:
            raise ServoFault(
                f"servo {self.address} would need a homing offset of {offset} counts, it has at "
                f"most {largest}: turn its horn, or give the joint other 'zero_counts'"
            )
