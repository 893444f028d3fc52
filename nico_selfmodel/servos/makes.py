"""The makes of motors that can be driven: and the numbers of each."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Make:
    """What there is to know of a make before its driver is loaded."""

    name: str
    """As the servo configuration calls it."""
    title: str
    """As a message calls its motors."""
    unit: str
    """What an address belongs to: a module, or a servo with an id."""
    addresses: tuple[int, int]
    """First and last that a motor may have."""
    bauds: tuple[int, ...]
    """Rates of the line, the one from the factory first."""
    registers: tuple[int, int]
    """First and last position that may be commanded."""
    counts_per_turn: float | None = None
    """Of the joint, None where that depends on its encoder and gear."""
    zero_counts: int = 0
    """Register at the zero of the encoder's angle, unless the configuration says another."""
    velocity_step: float = 0.0
    """Speeds are multiples of it [counts/s]; 0 where they are as good as continuous."""
    acceleration_step: float = 0.0
    """Accelerations are multiples of it [counts/s^2]."""
    largest_velocity: float = math.inf
    """[counts/s]."""
    largest_acceleration: float = math.inf
    """[counts/s^2]."""
    still: int = 16
    """What a joint that stands may move between two readings without a second look [counts]."""
    keeps_zero: bool = False
    """Whether the encoder is absolute, so that its zero outlasts the power."""


PIC_SERVO = Make(
    "pic-servo",
    "PIC-SERVO boards",
    "module",
    addresses=(1, 127),
    bauds=(19200, 9600, 57600, 115200),
    registers=(-(2**30), 2**30),  # half of the register, so that no goal can wrap
)
_TURN = 4096
DYNAMIXEL = Make(
    "dynamixel",
    "Dynamixel servos (protocol 2.0, X series)",
    "id",
    addresses=(0, 252),
    bauds=(57600, 1_000_000, 115200, 2_000_000, 3_000_000, 4_000_000, 9600),
    registers=(0, _TURN - 1),
    counts_per_turn=_TURN,
    zero_counts=_TURN // 2,
    velocity_step=0.229 * _TURN / 60.0,  # 0.229 rev/min
    acceleration_step=214.577 * _TURN / 3600.0,  # 214.577 rev/min^2
    largest_velocity=1023 * 0.229 * _TURN / 60.0,
    largest_acceleration=32767 * 214.577 * _TURN / 3600.0,
    still=4,
    keeps_zero=True,
)
FEETECH = Make(
    "feetech",
    "Feetech servos (STS series)",
    "id",
    addresses=(0, 253),
    bauds=(1_000_000, 500_000, 250_000, 128_000, 115200, 57600, 38400),
    registers=(0, _TURN - 1),
    counts_per_turn=_TURN,
    zero_counts=_TURN // 2,
    velocity_step=1.0,
    acceleration_step=100.0,
    largest_velocity=3400.0,
    largest_acceleration=254 * 100.0,
    still=4,
    keeps_zero=True,
)
MAKES = {make.name: make for make in (PIC_SERVO, DYNAMIXEL, FEETECH)}


def make_named(name: str) -> Make:
    """Return a make.

    Raises:
        ValueError: If there is none of this name.
    """
    if name not in MAKES:
        raise ValueError(f"'make' must be one of {', '.join(MAKES)}, got {name!r}")
    return MAKES[name]
