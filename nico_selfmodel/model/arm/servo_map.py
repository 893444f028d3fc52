"""Encoder readings <-> joint displacements."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array, read_only

ENCODER_UNITS = ("counts", "rad", "deg")


@dataclass(frozen=True, eq=False)
class ServoMap:
    """The linear map of every joint, `sign * radians(reading) = offset + gear * q`.

    The thesis' eq. 6.8 with the unit and the wiring made explicit. The gear of a self-model is
    positive: whichever way a joint turns belongs to the direction of its axis, unless `sign` states
    it as a fact. A solver may pass through negative gears on its way.

    Readings and angles may be Drake's `AutoDiffXd` and `Expression` too.
    """

    joints: tuple[str, ...]
    """Names, in the order of the chain. Length n."""
    offset: NDArray
    """Encoder angle at q = 0 [rad]. Shape (n,)."""
    gear: NDArray
    """Encoder radians per joint radian. Shape (n,)."""
    unit: tuple[str, ...]
    """`counts`, `rad` or `deg` of each reading. Length n."""
    counts_per_turn: NDArray
    """Counts per encoder turn; nan where the unit is not counts. Shape (n,)."""
    sign: NDArray
    """+1 or -1, stated by the data set. Shape (n,)."""

    def __post_init__(self) -> None:
        """Check shapes and ranges, and make the arrays read-only."""
        n = len(self.joints)
        for name in ("offset", "gear", "sign"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name))
        counts = read_only(self.counts_per_turn, float)
        object.__setattr__(self, "counts_per_turn", counts)
        if len(self.unit) != n or set(self.unit) - set(ENCODER_UNITS):
            raise ValueError(f"unit must name one of {ENCODER_UNITS} a joint, got {self.unit}")
        if counts.shape != (n,) or np.any(~(counts > 0.0) & (np.array(self.unit) == "counts")):
            raise ValueError("counts_per_turn must be positive for every joint read in counts")
        if np.any(self.gear == 0.0) or not np.isin(self.sign, (-1.0, 1.0)).all():
            raise ValueError("gear must not be zero and sign must be +1 or -1")

    @property
    def radians_per_unit(self) -> NDArray:
        """Encoder radians per unit of the reading, with the sign. Shape (n,)."""
        unit = np.array(self.unit)
        scale = np.where(unit == "deg", np.pi / 180.0, 1.0)
        counts = np.where(unit == "counts", self.counts_per_turn, 1.0)
        return self.sign * np.where(unit == "counts", 2.0 * np.pi / counts, scale)

    def to_radians(self, readings: ArrayLike) -> NDArray:
        """Return encoder angles [rad] of readings in their own unit. Shape (..., n)."""
        return np.asarray(readings) * self.radians_per_unit

    def to_joint(self, readings: ArrayLike) -> NDArray:
        """Return joint displacements q [rad] of readings. Shape (..., n)."""
        return (self.to_radians(readings) - self.offset) / self.gear

    def to_encoder(self, q: ArrayLike) -> NDArray:
        """Return the readings at joint displacements q [rad]. Shape (..., n)."""
        return (self.offset + self.gear * np.asarray(q)) / self.radians_per_unit

    def rezeroed(self, q: ArrayLike) -> "ServoMap":
        """Return the same servos with zero displacement moved to `q` [rad]. Shape (n,)."""
        return replace(self, offset=self.offset + self.gear * np.asarray(q, dtype=float))
