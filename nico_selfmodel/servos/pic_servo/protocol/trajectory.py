"""Load Trajectory, and the units that the chip counts speeds in."""

import struct
from dataclasses import dataclass
from enum import IntFlag
from typing import ClassVar, Self

from nico_selfmodel.servos.pic_servo.protocol.commands import Command
from nico_selfmodel.servos.pic_servo.protocol.packets import DamagedPacketError
from nico_selfmodel.servos.profile import UNITS_PER_COUNT

TICK = 0.512e-3
"""Period of the servo loop [s]."""
LARGEST_VELOCITY = 83_886_080
LARGEST_ACCELERATION = 2**31 - 1


class TrajectoryFlag(IntFlag):
    """The control byte of Load Trajectory."""

    POSITION = 0x01
    VELOCITY = 0x02
    ACCELERATION = 0x04
    PWM = 0x08
    SERVO = 0x10
    """Position servo; without it the PWM drives the motor."""
    VELOCITY_MODE = 0x20
    REVERSE = 0x40
    """Backwards; in a trapezoidal move: the goal is relative to the last one."""
    START_NOW = 0x80


# Flag, field, layout; a field that is not sent keeps its last value.
_FIELDS = (
    (TrajectoryFlag.POSITION, "position", "<i"),
    (TrajectoryFlag.VELOCITY, "velocity", "<I"),
    (TrajectoryFlag.ACCELERATION, "acceleration", "<I"),
    (TrajectoryFlag.PWM, "pwm", "<B"),
)


@dataclass(frozen=True)
class LoadTrajectory(Command):
    """A motion: to a position, at a velocity, or at a PWM."""

    code: ClassVar[int] = 0x4
    lengths: ClassVar[tuple[int, ...]] = tuple(range(1, 15))
    # repeatable unless it is relative: see `may_repeat`
    flags: int = TrajectoryFlag.SERVO | TrajectoryFlag.START_NOW
    """SERVO, VELOCITY_MODE, REVERSE and START_NOW; the others follow from what is given."""
    position: int | None = None
    """Counts."""
    velocity: int | None = None
    """Counts a tick, times 65536; never negative."""
    acceleration: int | None = None
    """Counts a tick squared, times 65536; never negative."""
    pwm: int | None = None
    """0-255."""

    @property
    def relative(self) -> bool:
        """Whether the goal counts from the last one."""
        return bool(self.flags & TrajectoryFlag.REVERSE) and self.position is not None

    @property
    def control(self) -> int:
        """The control byte."""
        given = [flag for flag, name, _ in _FIELDS if getattr(self, name) is not None]
        return int(sum(given) | self.flags & 0xF0)

    def payload(self) -> bytes:
        """Return its data bytes."""
        values = [(layout, getattr(self, name)) for _, name, layout in _FIELDS]
        parts = [struct.pack(layout, value) for layout, value in values if value is not None]
        return bytes([self.control]) + b"".join(parts)

    @classmethod
    def from_payload(cls, data: bytes) -> Self:
        """Return the command of its data bytes.

        Raises:
            DamagedPacketError: If their number is not what the control byte announces.
        """
        present = [(name, layout) for flag, name, layout in _FIELDS if data[0] & flag]
        length = 1 + sum(struct.calcsize(layout) for _, layout in present)
        if len(data) != length:
            raise DamagedPacketError(
                f"LoadTrajectory with {len(data)} data bytes, its control byte announces {length}"
            )
        values, place = {}, 1
        for name, layout in present:
            (values[name],) = struct.unpack_from(layout, data, place)
            place += struct.calcsize(layout)
        return cls(data[0] & 0xF0, **values)


def velocity_units(counts_per_s: float, rate_divisor: int = 1) -> int:
    """Return the chip's number for a speed [counts/s], at least 1.

    Raises:
        ValueError: If it is negative, not finite or faster than the encoder input.
    """
    return _units(counts_per_s * TICK * rate_divisor, LARGEST_VELOCITY, "velocity")


def acceleration_units(counts_per_s2: float, rate_divisor: int = 1) -> int:
    """Return the chip's number for an acceleration [counts/s^2], at least 1.

    Raises:
        ValueError: If it is negative, not finite or too large.
    """
    tick = TICK * rate_divisor
    return _units(counts_per_s2 * tick**2, LARGEST_ACCELERATION, "acceleration")


def acceleration_step(rate_divisor: int = 1) -> float:
    """Return what accelerations are multiples of [counts/s^2]."""
    return 1.0 / (UNITS_PER_COUNT * (TICK * rate_divisor) ** 2)


def _units(counts_per_tick: float, largest: int, what: str) -> int:
    units = counts_per_tick * UNITS_PER_COUNT
    if not 0.0 <= units <= largest:
        raise ValueError(
            f"{what} must be between 0 and {largest / UNITS_PER_COUNT:g} counts a tick, got "
            f"{counts_per_tick:g}"
        )
    # 0 would be a move that never starts.
    return max(1, round(units))
