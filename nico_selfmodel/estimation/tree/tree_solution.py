"""Where the adjustment of a body ended, and what disturbs the recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.alike_errors import AlikeErrors, Decorrelation, turn_groups
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations

_SETTLED = 0.02
"""Relative change of a sigma below which it is the same."""


@dataclass(frozen=True, eq=False)
class TreeNoise:
    """What disturbs a recording."""

    sensor: NDArray
    """Standard deviations of the noise groups [m, rad or px]. Shape (G,)."""
    joint: NDArray
    """Standard deviations of what is read, all that disturbs it together [rad or m]. Shape (m,)."""
    alike: tuple[AlikeErrors, ...] = ()
    """What of it poses share with poses that are alike; nothing where each pose has its own."""
    loud: frozenset[int] = frozenset()
    """Joints that are read worse than others of their motion, and share nothing with them."""

    @property
    def own(self) -> "TreeNoise":
        """What each pose has of its own, without what poses share."""
        sensor, joint = self.sensor.copy(), self.joint
        for one in self.alike:
            if one.turns is None:
                joint = one.alone
            else:
                sensor[turn_groups(one.turns)] = one.alone
        return TreeNoise(sensor, joint, loud=self.loud)

    def sharing(self, alike: Sequence[AlikeErrors]) -> "TreeNoise":
        """Return all noise, what poses share in `sensor` and `joint` too; this is what is own."""
        sensor, joint, shared = self.sensor.copy(), self.joint.copy(), []
        for one in alike:
            own = None if one.turns is None else turn_groups(one.turns)
            alone = self.joint if own is None else self.sensor[own]
            shared.append(replace(one, alone=alone))
            if own is None:
                joint = np.hypot(joint, one.sigma)
            else:
                sensor[own] = np.hypot(alone, np.sqrt(np.mean(one.sigma**2)))
        return TreeNoise(sensor, joint, tuple(shared), self.loud)

    def is_like(self, other: "TreeNoise") -> bool:
        """Whether no standard deviation changed, nor which are shared."""
        one, two = (np.concatenate([noise.sensor, noise.joint]) for noise in (self, other))
        alike = (np.abs(one - two) <= _SETTLED * np.maximum(one, two)).all()
        return self.loud == other.loud and bool(alike)


@dataclass(frozen=True, eq=False)
class TreeSolution:
    """Where an adjustment ended."""

    values: NDArray
    """All parameters. Shape (P,)."""
    noise: TreeNoise
    """What disturbed the data."""
    outliers: NDArray
    """Observations that nothing explains. Boolean, by row of the table, shape (N,)."""
    slipped: NDArray
    """What was read wrongly. Boolean, by visit and noisy joint, shape (visits, m)."""
    cost: float
    """Half the sum of squares, in the noise as it was found."""
    converged: bool
    iterations: int
    """Of all rounds of variances and outliers."""
    variances_known: bool
    """Whether there was enough redundancy to tell the noise."""
    whitened: NDArray
    """Whitened derivatives of the inliers by the free parameters, each pose counted once; priors
    are their last rows. Shape (k, free)."""
    rest: NDArray
    """The whitened residuals that belong to it. Shape (k,)."""
    history: tuple[float, ...] = field(default=())
    joint_errors: NDArray | None = None
    """How far joints were taken to be from their readings at each sample, about which all this is
    linear: see `joint_errors`; None for not at all. Shape (samples, m)."""
    shared: Decorrelation | None = None
    """What takes errors that poses share out of the rows but priors'; None where none are."""

    def slipped_in(self, visits: NDArray) -> NDArray:
        """Return what slipped in visits of some numbers. Shape (v,) -> boolean, (v, m)."""
        slipped = np.zeros((len(visits), self.slipped.shape[1]), dtype=bool)
        real = visits < len(self.slipped)
        slipped[real] = self.slipped[visits[real]]
        return slipped

    def white_by_scalar(self, seen: TreeObservations) -> NDArray:
        """Return what is left of each number, whitened; nan of outliers. Shape (R,)."""
        kept = seen.groups(self.outliers).rows
        white = np.full(len(seen.row), np.nan)
        white[np.sort(kept)] = self.rest[: len(kept)]
        return white
