"""Units in which encoders tell how far a joint turned or slid: of arms, of bodies and in files."""

import math
from collections.abc import Sequence

from nico_selfmodel.names import shown

COUNTS = "counts"
"""The unit whose size is told beside it: by how many of them make a turn of the encoder."""
_SIZES = {"rad": 1.0, "deg": math.pi / 180.0, "m": 1.0, "mm": 1e-3}
"""Every other unit -> its size [rad or m]."""
ANGLES, LENGTHS = ("rad", "deg", COUNTS), ("m", "mm", COUNTS)
"""Of joints that turn, and of those that slide."""


def unit_size(unit: str, counts_per_turn: float | None = None) -> float:
    """Return the size of one unit of a reading [rad, or m], at the encoder.

    Args:
        unit: One of `ANGLES` or `LENGTHS`.
        counts_per_turn: Counts of one turn of the encoder, of `counts`.
    """
    return 2.0 * math.pi / (counts_per_turn or math.nan) if unit == COUNTS else _SIZES[unit]


def check_unit(
    joint: str, unit: str, counts_per_turn: float | None, among: Sequence[str] = ANGLES
) -> None:
    """Refuse a unit that a joint cannot have, or whose size is not told.

    Args:
        joint: Name, for the message.
        counts_per_turn: Told with `counts`, and only then.
        among: The units that it may have.

    Raises:
        ValueError: If it is one.
    """
    if unit not in among:
        raise ValueError(
            f"joint {joint!r}: encoder_unit must be one of {', '.join(among)}, got {shown(unit)}"
        )
    if unit != COUNTS and counts_per_turn is not None:
        raise ValueError(
            f"joint {joint!r}: counts_per_turn is given, but encoder_unit is {unit!r}; leave it "
            f"out or use {COUNTS!r}"
        )
    if unit == COUNTS and not (counts_per_turn or 0.0) > 0.0:
        raise ValueError(
            f"joint {joint!r}: encoder_unit {COUNTS!r} needs a positive counts_per_turn, got "
            f"{counts_per_turn}"
        )
