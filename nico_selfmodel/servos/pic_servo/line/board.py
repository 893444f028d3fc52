"""One PIC-SERVO board: its commands as methods, in counts and seconds.

The raw units of the board (counts a tick, times 65536) appear here and below, nowhere above.
"""

from contextlib import suppress
from dataclasses import dataclass

from nico_selfmodel.errors import ServoFault
from nico_selfmodel.servos.pic_servo.line.bus import Bus, UncertainError
from nico_selfmodel.servos.pic_servo.protocol import commands as nmc
from nico_selfmodel.servos.pic_servo.protocol.commands import Command, StopMode
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains
from nico_selfmodel.servos.pic_servo.protocol.status import (
    DEVICE_TYPES,
    WATCHED,
    Status,
    StatusItem,
)
from nico_selfmodel.servos.pic_servo.protocol.trajectory import (
    LoadTrajectory,
    TrajectoryFlag,
    acceleration_units,
    velocity_units,
)

FIRST_SC_VERSION = 10
"""From here on goals may change on the fly and positions may be set."""
LAST_SC_VERSION = 20
"""Up to here it is known what the bits of I/O Control mean."""
SERVO_TYPE = 0
ZERO_MARK = 0x4E49434F
"""Home register of a board whose zero is known: lost with power, exactly as the zero is."""
_MARK_TOLERANCE = 1_000_000
_MOVED = 50
"""How far a motor may have moved before its new position is read [counts]."""


@dataclass(frozen=True)
class DeviceId:
    """What a module answers to be."""

    type: int
    version: int

    def __str__(self) -> str:
        return f"{DEVICE_TYPES.get(self.type, f'type {self.type}')} version {self.version}"


class PicServo:
    """A module at its address. Making one sends nothing.

    Every method raises `BusError` where there is no good reply.
    """

    def __init__(self, bus: Bus, address: int) -> None:
        """Stand for the module at an address.

        Args:
            address: 1-127.
        """
        self.bus, self.address = bus, address
        self.items = 0
        """The status mask that it has, as far as is known."""
        self.rate_divisor = 1

    def ask(self, command: Command, *, repeatable: bool | None = None) -> Status:
        """Send a command and return the reply, laid out by this module's status mask.

        Args:
            command: What to do.
            repeatable: Whether it may be sent again when its reply is lost; as the command itself
                says if omitted.
        """
        return self.bus.exchange(self.address, command, self.items, repeatable=repeatable)

    def read(self, items: int) -> Status:
        """Return chosen items, once, whatever the status mask is."""
        return self.bus.exchange(self.address, nmc.ReadStatus(items), items)

    def identify(self) -> DeviceId:
        """Return type and version."""
        status = self.read(StatusItem.DEVICE)
        assert status.device_type is not None
        assert status.device_version is not None
        return DeviceId(status.device_type, status.device_version)

    def watch(self, items: int = WATCHED) -> Status:
        """Choose what every reply carries from now on."""
        status = self.bus.exchange(self.address, nmc.DefineStatus(items), items)
        self.items = items
        return status

    def poll(self) -> Status:
        """Return the watched items."""
        return self.ask(nmc.NoOperation())

    def set_output(self, mode: int) -> Status:
        """Choose how the board drives its motor; before the amplifier is switched on.

        Args:
            mode: A combination of `OutputMode`. THREE_PHASE on a board with one PWM output, or the
                reverse, can damage it.
        """
        return self.ask(nmc.IoControl(mode))

    def set_gains(self, gains: Gains) -> Status:
        """Set the numbers of the position loop.

        Raises:
            ValueError: If one is out of range.
        """
        gains.check()
        status = self.ask(nmc.SetGain(gains))
        self.rate_divisor = gains.rate_divisor
        return status

    def hold(self) -> Status:
        """Stop at once where it is, amplifier on, servo on."""
        return self.ask(nmc.StopMotor(StopMode.AMPLIFIER | StopMode.ABRUPT))

    def stop_smoothly(self) -> Status:
        """Decelerate, then hold; amplifier on."""
        return self.ask(nmc.StopMotor(StopMode.AMPLIFIER | StopMode.SMOOTH))

    def arm_amplifier(self) -> Status:
        """Switch the amplifier on with the motor off."""
        return self.ask(nmc.StopMotor(StopMode.AMPLIFIER | StopMode.MOTOR_OFF))

    def release(self) -> Status:
        """Switch motor and amplifier off: a loaded joint falls."""
        return self.ask(nmc.StopMotor(StopMode.MOTOR_OFF))

    def clear_faults(self) -> Status:
        """Clear the status bits that stay."""
        return self.ask(nmc.ClearBits())

    def move_to(
        self,
        position: int,
        velocity: float | None = None,
        acceleration: float | None = None,
        *,
        start: bool = True,
    ) -> Status:
        """Move to a position on a trapezoidal profile.

        Args:
            position: Goal [counts].
            velocity: Largest speed [counts/s]; the last one if omitted.
            acceleration: [counts/s^2]; the last one if omitted.
            start: Now, or at the next `start` of the group.

        Raises:
            ValueError: If a number does not fit the chip.
        """
        now = TrajectoryFlag.START_NOW if start else 0
        return self.ask(
            LoadTrajectory(
                TrajectoryFlag.SERVO | now,
                position,
                None if velocity is None else velocity_units(velocity, self.rate_divisor),
                None
                if acceleration is None
                else acceleration_units(acceleration, self.rate_divisor),
            )
        )

    def brake(self, acceleration: float, *, start: bool = True) -> Status:
        """Decelerate to a standstill and hold.

        Args:
            acceleration: [counts/s^2].
            start: Now, or at the next `start` of the group.

        Raises:
            ValueError: If the acceleration does not fit the chip.
        """
        now = TrajectoryFlag.START_NOW if start else 0
        units = acceleration_units(acceleration, self.rate_divisor)
        flags = TrajectoryFlag.SERVO | TrajectoryFlag.VELOCITY_MODE | now
        return self.ask(LoadTrajectory(flags, velocity=0, acceleration=units))

    def capture_home(self, mode: int) -> Status:
        """Arm the capture of the home position; the motion itself is another command.

        Args:
            mode: Events and what to do at them, a combination of `HomingMode`; 0 disarms.

        Raises:
            UncertainError: If the reply to arming was lost.
        """
        return self.ask(nmc.SetHoming(mode), repeatable=not mode)

    def set_position(self, position: int) -> Status:
        """Call the place where the motor stands `position` [counts]. Not during a move.

        A lost reply is resolved by reading the position: only a command that was not carried out is
        repeated.

        Args:
            position: New value of the register [counts].

        Raises:
            ServoFault: If the register does not take the value.
        """
        command = nmc.ResetPosition(nmc.ResetMode.SET_POSITION, position)
        found = None
        for _ in range(self.bus.settings.attempts):
            with suppress(UncertainError):  # the reading tells
                self.ask(command)
            status = self.read(StatusItem.POSITION)
            found = status.position
            if found is not None and abs(found - position) <= _MOVED:
                return status
        raise ServoFault(
            f"module {self.address} does not take position {position}, it stays at {found}: does "
            f"its firmware have version {FIRST_SC_VERSION} or later?"
        )

    def zero_at(self, position: int) -> None:
        """Make where the motor stands `position` [counts], and mark that its zero is known.

        The mark is the home register: like the zero it is lost at power-off.

        Raises:
            ServoFault: If a register does not take its value.
        """
        self.set_position(ZERO_MARK)
        for _ in range(self.bus.settings.attempts):
            with suppress(UncertainError):  # the reading tells
                self.ask(nmc.SaveHome())
            status = self.read(StatusItem.HOME | StatusItem.POSITION)
            if _has_mark(status):
                break
        else:
            raise ServoFault(f"module {self.address} does not keep its home register")
        # What a limp joint moved meanwhile is kept.
        assert status.position is not None
        self.set_position(position + status.position - ZERO_MARK)

    def knows_its_zero(self) -> bool:
        """Return whether the zero was set since the board was last powered up."""
        return is_marked(self.read(StatusItem.HOME | StatusItem.POSITION))


def is_marked(status: Status) -> bool:
    """Return whether the registers say that the zero is known.

    Where a program died while it wrote the mark, the position still is the mark: no zero at all.
    """
    if status.position is None or abs(status.position - ZERO_MARK) < _MARK_TOLERANCE:
        return False
    return _has_mark(status)


def _has_mark(status: Status) -> bool:
    return status.home is not None and abs(status.home - ZERO_MARK) < _MARK_TOLERANCE
