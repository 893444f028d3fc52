"""The sixteen commands of the protocol as typed values, their data as the chip reads it."""

import struct
from dataclasses import dataclass, fields
from enum import IntFlag
from typing import ClassVar, Self

from nico_selfmodel.servos.pic_servo.protocol.gains import Gains


@dataclass(frozen=True)
class Command:
    """What every command has. Its data bytes are its fields, in order; those that are None lack."""

    code: ClassVar[int]
    lengths: ClassVar[tuple[int, ...]]
    """Numbers of data bytes that the chip understands."""

    repeatable: ClassVar[bool] = True
    """Whether sending it twice does what sending it once does."""
    layout: ClassVar[str] = ""
    """How `struct` packs each field (least significant byte first)."""

    def payload(self) -> bytes:
        """Return its data bytes."""
        values = [getattr(self, field.name) for field in fields(self)]
        given = [value for value in values if value is not None]
        return struct.pack(f"<{self.layout[: len(given)]}", *given)

    @classmethod
    def from_payload(cls, data: bytes) -> Self:
        """Return the command of data bytes whose number is one of `lengths`."""
        layouts = (f"<{cls.layout[:count]}" for count in range(len(cls.layout) + 1))
        layout = next(one for one in layouts if struct.calcsize(one) == len(data))
        return cls(*struct.unpack(layout, data))


class ResetMode(IntFlag):
    """What Reset Position makes of the position."""

    RELATIVE_TO_HOME = 0x01
    SET_POSITION = 0x02


@dataclass(frozen=True)
class ResetPosition(Command):
    """Make the position zero, count it from home, or make it a given number.

    The commanded position follows, so that the motor does not jump. Not during a move.
    """

    code: ClassVar[int] = 0x0
    lengths: ClassVar[tuple[int, ...]] = (0, 1, 5)
    repeatable: ClassVar[bool] = False  # what the axis moved in between would be lost
    layout: ClassVar[str] = "Bi"
    mode: int = 0
    """A `ResetMode`, or 0 for zero here."""
    position: int | None = None
    """Counts, with SET_POSITION (version 10 and later)."""

    def payload(self) -> bytes:
        """Return its data bytes; none for zero here."""
        return super().payload() if self.mode or self.position is not None else b""


@dataclass(frozen=True)
class SetAddress(Command):
    """Give a module its address and its group.

    The first one after a reset also wakes the next module of the chain at address 0, so that
    sending it twice to address 0 would give two modules one address.
    """

    code: ClassVar[int] = 0x1
    lengths: ClassVar[tuple[int, ...]] = (2,)
    repeatable: ClassVar[bool] = False
    address: int
    """0x01-0x7F."""
    group: int = 0xFF
    """0x80-0xFF."""
    leader: bool = False
    """Whether this module answers for its group."""

    def payload(self) -> bytes:
        """Return its data bytes."""
        return bytes([self.address, self.group & 0x7F if self.leader else self.group])

    @classmethod
    def from_payload(cls, data: bytes) -> Self:
        """Return the command of two data bytes."""
        return cls(data[0], data[1] | 0x80, leader=not data[1] & 0x80)


@dataclass(frozen=True)
class _OneByte(Command):
    lengths: ClassVar[tuple[int, ...]] = (1,)
    layout: ClassVar[str] = "B"
    mode: int


@dataclass(frozen=True)
class DefineStatus(_OneByte):
    """Choose what every reply from now on carries, this command's own among them."""

    code: ClassVar[int] = 0x2
    # mode: a mask of `StatusItem`


@dataclass(frozen=True)
class ReadStatus(DefineStatus):
    """Choose what this one reply carries."""

    code: ClassVar[int] = 0x3


@dataclass(frozen=True)
class _WithoutData(Command):
    lengths: ClassVar[tuple[int, ...]] = (0,)


@dataclass(frozen=True)
class StartMotion(_WithoutData):
    """Carry out the buffered trajectories, usually of a whole group."""

    code: ClassVar[int] = 0x5


@dataclass(frozen=True)
class SetGain(Command):
    """Set the numbers of the position loop; before the servo is switched on."""

    code: ClassVar[int] = 0x6
    lengths: ClassVar[tuple[int, ...]] = (14, 15)
    gains: Gains

    def payload(self) -> bytes:
        """Return its data bytes."""
        return self.gains.encode()

    @classmethod
    def from_payload(cls, data: bytes) -> Self:
        """Return the command of 14 or 15 data bytes."""
        return cls(Gains.decode(data))


class StopMode(IntFlag):
    """How Stop Motor stops."""

    AMPLIFIER = 0x01
    """Level of the amplifier enable output; every Stop Motor sets it, also to off."""
    MOTOR_OFF = 0x02
    ABRUPT = 0x04
    SMOOTH = 0x08
    HERE = 0x10
    """Go to a given position without a profile."""
    ADVANCED = 0x20


@dataclass(frozen=True)
class StopMotor(Command):
    """Stop the motor in one of several ways and switch the amplifier."""

    code: ClassVar[int] = 0x7
    lengths: ClassVar[tuple[int, ...]] = (1, 5)
    layout: ClassVar[str] = "Bi"
    mode: int
    """A combination of `StopMode`."""
    position: int | None = None
    """Counts, with HERE."""


class OutputMode(IntFlag):
    """I/O Control as version 10 and later read it. A wrong one can damage an amplifier."""

    OFF_AT_LIMIT = 0x04
    STOP_AT_LIMIT = 0x08
    THREE_PHASE = 0x10
    ANTIPHASE = 0x20
    FAST_PATH = 0x40
    STEP_AND_DIRECTION = 0x80


@dataclass(frozen=True)
class IoControl(_OneByte):
    """Choose how the board drives its motor."""

    code: ClassVar[int] = 0x8
    # mode: a combination of `OutputMode`


class HomingMode(IntFlag):
    """Events that mark home, and what the motor does then (one of OFF, ABRUPT, SMOOTH)."""

    LIMIT_1 = 0x01
    LIMIT_2 = 0x02
    OFF = 0x04
    INDEX = 0x08
    ABRUPT = 0x10
    SMOOTH = 0x20
    POSITION_ERROR = 0x40
    OVERCURRENT = 0x80


@dataclass(frozen=True)
class SetHoming(_OneByte):
    """Arm the capture of the home position; the motion itself is a trajectory."""

    code: ClassVar[int] = 0x9
    repeatable: ClassVar[bool] = False  # would arm a second capture after the first
    # mode: a combination of `HomingMode`


# What JR Kerr's later library sends; the divider is 20 MHz / 16 / (code + 1).
BAUD_CODES = {9600: 129, 19200: 64, 57600: 21, 115200: 10}
BAUD_OF_CODE = {127: 9600, 129: 9600, 63: 19200, 64: 19200, 20: 57600, 21: 57600, 10: 115200}


@dataclass(frozen=True)
class SetBaud(_OneByte):
    """Change the rate of the line at once; to a group that has no leader, so that none answers."""

    code: ClassVar[int] = 0xA
    repeatable: ClassVar[bool] = False
    # mode: a code of `BAUD_CODES`


@dataclass(frozen=True)
class ClearBits(_WithoutData):
    """Clear the status bits that stay."""

    code: ClassVar[int] = 0xB


@dataclass(frozen=True)
class SaveHome(_WithoutData):
    """Copy the position to the home register."""

    code: ClassVar[int] = 0xC
    repeatable: ClassVar[bool] = False


@dataclass(frozen=True)
class PathPoints(Command):
    """Append points to the path buffer, or start path mode with none."""

    code: ClassVar[int] = 0xD
    lengths: ClassVar[tuple[int, ...]] = (0, 2, 4, 6, 8, 10, 12, 14)
    repeatable: ClassVar[bool] = False
    words: tuple[int, ...] = ()
    """Up to seven: counts a tick in 8.8 format, whose two low bits are sense and rate."""

    def payload(self) -> bytes:
        """Return its data bytes."""
        return struct.pack(f"<{len(self.words)}H", *self.words)

    @classmethod
    def from_payload(cls, data: bytes) -> Self:
        """Return the command of an even number of data bytes."""
        return cls(struct.unpack(f"<{len(data) // 2}H", data))


@dataclass(frozen=True)
class NoOperation(_WithoutData):
    """Ask for nothing but a reply."""

    code: ClassVar[int] = 0xE


@dataclass(frozen=True)
class HardReset(Command):
    """Return to the state after power-up: torque off, positions zero, no addresses.

    A data byte writes the configuration memory, which this driver never does.
    """

    code: ClassVar[int] = 0xF
    lengths: ClassVar[tuple[int, ...]] = (0, 1)
    repeatable: ClassVar[bool] = False
    layout: ClassVar[str] = "B"
    options: int | None = None
