"""What is known of a joint's encoder before anything is learned."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import check_keys, integer_value, number_value, text_value
from nico_selfmodel.model.encoder_units import COUNTS, check_unit, unit_size
from nico_selfmodel.names import check_name, shown

HOME = "home"
_KEYS = ("name", "encoder_unit", "counts_per_turn", "lower", "upper", "sign")
# Readings closer than this, or than one count, are not called a motion.
_STILL_RAD = math.radians(0.02)


@dataclass(frozen=True)
class JointInfo:
    """A joint as its encoder shows it.

    Raises:
        ValueError: If a value is not valid.
    """

    name: str
    """Name of the joint; `home` is reserved."""
    encoder_unit: str
    """Unit of the readings: `counts`, `rad` or `deg`."""
    counts_per_turn: float | None = None
    """Counts of one turn of the encoder; given with `counts`, never otherwise."""
    lower: float | None = None
    """Lowest reading that the joint can reach [encoder unit], if known."""
    upper: float | None = None
    """Highest reading that the joint can reach [encoder unit], if known."""
    sign: int = 1
    """+1, or -1 where the readings are known to fall as the joint turns forward."""

    def __post_init__(self) -> None:
        """Check the values."""
        check_name(self.name, "the name of a joint")
        if self.name == HOME:
            raise ValueError(f"a joint cannot be called {HOME!r}: the sweep column uses that word")
        self._check_numbers()

    def _check_numbers(self) -> None:
        for key in ("counts_per_turn", "lower", "upper"):
            value = getattr(self, key)
            if value is not None:
                object.__setattr__(self, key, float(value))
                if not math.isfinite(value):
                    raise ValueError(f"joint {self.name!r}: {key} must be finite, got {value}")
        check_unit(self.name, self.encoder_unit, self.counts_per_turn)
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(
                f"joint {self.name!r}: lower must be less than upper,"
                f" got {self.lower} and {self.upper}"
            )
        if self.sign not in (1, -1):
            raise ValueError(f"joint {self.name!r}: sign must be 1 or -1, got {self.sign}")

    @property
    def radians_per_unit(self) -> float:
        """Size of one unit of the reading at the encoder [rad]; the gear is not in it."""
        return unit_size(self.encoder_unit, self.counts_per_turn)

    @property
    def still_tolerance(self) -> float:
        """Change of the reading too small to be called a motion [encoder unit].

        One count, or 0.02 degrees where that is more.
        """
        tolerance = _STILL_RAD / self.radians_per_unit
        return max(1.0, tolerance) if self.encoder_unit == COUNTS else tolerance

    @classmethod
    def from_mapping(cls, entry: Any, where: str) -> "JointInfo":
        """Make a joint from its entry in a YAML file.

        Args:
            where: Place for messages.

        Raises:
            DataError: If the entry is not valid.
        """
        if not isinstance(entry, Mapping):
            raise DataError(
                f"{where}: a joint must be a mapping with 'name' and 'encoder_unit', got"
                f" {shown(entry)}"
            )
        check_keys(entry, _KEYS, where)
        sign = integer_value(entry, "sign", where)
        try:
            return cls(
                name=text_value(entry, "name", where),
                encoder_unit=text_value(entry, "encoder_unit", where),
                counts_per_turn=number_value(entry, "counts_per_turn", where),
                lower=number_value(entry, "lower", where),
                upper=number_value(entry, "upper", where),
                sign=1 if sign is None else sign,
            )
        except ValueError as error:
            raise DataError(f"{where}: {error}") from None

    def to_mapping(self) -> dict[str, Any]:
        """Return the entry of this joint in a YAML file, without what is not known."""
        entry = {key: getattr(self, key) for key in _KEYS}
        if self.sign == 1:
            del entry["sign"]
        return {key: value for key, value in entry.items() if value is not None}
