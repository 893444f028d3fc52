"""What a driver knows of its arm at one moment."""

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only


@dataclass(frozen=True, eq=False)
class ArmState:
    """Where the joints are and what ails them. What was not read is nan and not valid."""

    ROWS: ClassVar = ("q", "readings", "valid", "age", "moving", "enabled", "zero_known")
    """What `rows` holds of each joint, in this order."""

    time: float
    """Monotonic time of the port [s]."""
    joints: tuple[str, ...]
    """Names, length n."""
    q: NDArray
    """Joint displacements by the self-model [rad]; nan where the zero is not known. Shape (n,)."""
    readings: NDArray
    """Encoder readings [counts]. Shape (n,)."""
    age: NDArray
    """How old each reading is [s]; inf where there is none. Shape (n,)."""
    valid: NDArray
    """Whether the joint was read, is not lost and has no fault. Shape (n,)."""
    moving: NDArray
    """Whether the joint is on its way to a goal. Shape (n,)."""
    enabled: NDArray
    """Whether its servo is meant to be on. Shape (n,)."""
    zero_known: NDArray
    """Whether its zero was set since power-up, or is trusted. Shape (n,)."""
    trouble: tuple[str | None, ...]
    """What is wrong with each joint, None where nothing is."""
    rows: NDArray = field(init=False)
    """The arrays as one of numbers, for whoever copies them often; where a joint is not valid, its
    q and reading are nan. Shape (len(ROWS), n)."""
    oldest: float = field(init=False)
    """Largest age [s]."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in self.ROWS:
            object.__setattr__(self, name, read_only(getattr(self, name)))
        rows = np.array([getattr(self, name) for name in self.ROWS], dtype=float)
        valid = self.ROWS.index("valid")
        rows[:valid, rows[valid] == 0.0] = np.nan
        object.__setattr__(self, "rows", read_only(rows))
        object.__setattr__(self, "oldest", float(self.age.max(initial=0.0)))

    def to_mapping(self) -> dict[str, Any]:
        """Return the state as plain data, for JSON; what is not known is None."""
        return {
            "joints": {
                name: {
                    "q_rad": _number(self.q[k]),
                    "reading_counts": _number(self.readings[k]),
                    "age_s": _number(self.age[k]),
                    "valid": bool(self.valid[k]),
                    "moving": bool(self.moving[k]),
                    "enabled": bool(self.enabled[k]),
                    "zero_known": bool(self.zero_known[k]),
                    "trouble": self.trouble[k],
                }
                for k, name in enumerate(self.joints)
            },
        }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
