"""The numbers of a module's position loop."""

import struct
from dataclasses import dataclass, fields
from typing import Self

_LAYOUT = "<HHHHBBHBB"
_LARGEST = {
    "output_limit": 255,
    "current_limit": 255,
    "error_limit": 16383,
    "rate_divisor": 255,
    "dead_band": 255,
    "step_multiplier": 255,
}
_NEVER_ZERO = ("output_limit", "error_limit", "rate_divisor", "step_multiplier")
"""A board without output holds nothing, one without error switches off at the first count."""


@dataclass(frozen=True)
class Gains:
    """Gains and limits of the position loop, in the chip's own units.

    The defaults are JR Kerr's example values.
    """

    kp: int = 100
    kd: int = 1000
    ki: int = 0
    integration_limit: int = 0
    output_limit: int = 255
    """Largest PWM."""
    current_limit: int = 0
    """0 is off; an odd number where the sense voltage grows with the current."""
    error_limit: int = 4000
    """Position error that switches the servo off [counts]."""
    rate_divisor: int = 1
    """The loop runs every so many ticks of 0.512 ms."""
    dead_band: int = 0
    step_multiplier: int | None = 1
    """Version 10 and later; None leaves the byte out."""

    @classmethod
    def valid_range(cls, name: str) -> tuple[int, int]:
        """Return the smallest and largest value of a field."""
        return int(name in _NEVER_ZERO), _LARGEST.get(name, 32767)

    def check(self) -> None:
        """Refuse values that the chip cannot hold.

        Raises:
            ValueError: If one is out of its range; names it.
        """
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), self.valid_range(field.name)
            if value is not None and not low <= value <= high:
                raise ValueError(f"{field.name} must be {low} to {high}, got {value}")

    def encode(self) -> bytes:
        """Return the 14 or 15 data bytes."""
        values = [getattr(self, field.name) for field in fields(self)]
        last = b"" if self.step_multiplier is None else bytes([self.step_multiplier])
        return struct.pack(_LAYOUT, *values[:-1]) + last

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Return the gains of 14 or 15 data bytes."""
        return cls(*struct.unpack_from(_LAYOUT, data), data[14] if len(data) == 15 else None)
