"""From which side joints came: what backlash is seen by."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.joint_info import JointInfo


@dataclass(frozen=True, eq=False)
class Sides:
    """From which side each joint came, as a robot is watched moving from pose to pose."""

    tremor: NDArray
    """By how much readings change while joints stand. Shape (n,)."""
    side: NDArray
    """How each reading changed when its joint last moved; 0 before that. Shape (n,)."""
    last: NDArray | None = None
    """Readings when each joint last moved. Shape (n,)."""

    @classmethod
    def of(cls, joints: Sequence[JointInfo]) -> "Sides":
        """Know nothing yet.

        Args:
            joints: They, with what counts as standing still.
        """
        tremor = np.array([joint.still_tolerance for joint in joints])
        return cls(read_only(tremor), read_only(np.zeros(len(joints))))

    def after(self, encoders: NDArray) -> "Sides":
        """Return what is known after one more reading, nan of joints not read. Shape (n,)."""
        if self.last is None:
            return replace(self, last=read_only(encoders))
        moved = encoders - self.last
        far = np.abs(moved) > self.tremor
        side = np.where(far, np.sign(moved), self.side)
        last = np.where(far | np.isnan(self.last), encoders, self.last)
        return replace(self, side=read_only(side), last=read_only(last))
