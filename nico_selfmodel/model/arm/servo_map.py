"""Encoder readings <-> joint displacements."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_array, read_only
from nico_selfmodel.model.encoder_units import ANGLES, COUNTS, unit_size


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
        if len(self.unit) != n or set(self.unit) - set(ANGLES):
            raise ValueError(f"unit must name one of {ANGLES} a joint, got {self.unit}")
        if counts.shape != (n,) or np.any(~(counts > 0.0) & (np.array(self.unit) == COUNTS)):
            raise ValueError("counts_per_turn must be positive for every joint read in counts")
        if np.any(self.gear == 0.0) or not np.isin(self.sign, (-1.0, 1.0)).all():
            raise ValueError("gear must not be zero and sign must be +1 or -1")

    @property
    def radians_per_unit(self) -> NDArray:
        """Encoder radians per unit of the reading, with the sign. Shape (n,)."""
        units = zip(self.unit, self.counts_per_turn.tolist(), strict=True)
        return self.sign * np.array([unit_size(unit, counts) for unit, counts in units])

    def to_radians(self, readings: ArrayLike) -> NDArray:
        """Return encoder angles [rad] of readings in their own unit. Shape (..., n)."""
        return np.asarray(readings) * self.radians_per_unit

    def to_joint(self, readings: ArrayLike) -> NDArray:
        """Return joint displacements q [rad] of readings. Shape (..., n)."""
        return (self.to_radians(readings) - self.offset) / self.gear

    def to_encoder(self, q: ArrayLike) -> NDArray:
        """Return the readings at joint displacements q [rad]. Shape (..., n)."""
        return (self.offset + self.gear * np.asarray(q)) / self.radians_per_unit
