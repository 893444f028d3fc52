"""What an arm is asked, and what became of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.bendable import GEAR
from nico_selfmodel.estimation.diagnosis.gear_check import DoubtfulGear
from nico_selfmodel.model.arm.bending import BACKLASH, BEARING, COUPLING, RIPPLE, SAG

STEPS = (BACKLASH, SAG, BEARING, RIPPLE, GEAR, COUPLING)
"""What is asked, in this order; backlash where the data say from which side joints came, gears that
a unit tells and nobody holds. Backlash is first: where it is, its scatter looks like much else."""


HIDDEN = "unseen poses do not gain"
"""Why a step goes that is there by its evidence, but in unseen poses drowns in other errors."""


@dataclass(frozen=True)
class Step:
    """One effect, and what became of it."""

    effect: str
    """Its name, of `STEPS`."""
    kept: bool
    """Whether it stayed."""
    before: float
    """Geometric mean over poses of the error of unseen poses without it [mm or px]."""
    after: float
    """The same with it."""
    gain: float
    """Mean over poses of log(before / after)."""
    gain_sigma: float
    """Its standard error."""
    worth: float
    """By how much twice the log evidence rose."""
    reason: str
    """Why it went; empty where it stayed."""
    gear: DoubtfulGear | None = None
    """The gear that contradicts its unit where it went for that: a fault, no bend."""

    joint: str = ""
    """The joint that it would turn farthest, where it went for turning one too far."""

    @property
    def hidden(self) -> bool:
        """Whether the data tell it, but not its good for unseen poses."""
        return self.reason == HIDDEN


def from_both_sides(approach: NDArray) -> bool:
    """Whether some joint is known to have come from both sides. Shape (N, n)."""
    approach = np.asarray(approach)
    return bool(((approach < 0).any(axis=0) & (approach > 0).any(axis=0)).any())
