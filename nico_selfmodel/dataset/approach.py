"""From which side joints came: what backlash is seen by."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.joint_info import JointInfo


class Sides:
    """From which side each joint came, as a robot is watched moving from pose to pose."""

    def __init__(self, joints: Sequence[JointInfo]) -> None:
        """Know nothing yet.

        Args:
            joints: They, with what counts as standing still.
        """
        self._tremor = np.array([joint.still_tolerance for joint in joints])
        self._last: NDArray | None = None
        self._side = np.zeros(len(joints))

    def after(self, encoders: NDArray) -> NDArray:
        """Return how each reading changed when its joint last moved; 0 before that. Shape (n,)."""
        if self._last is None:
            self._last = np.array(encoders)
        moved = encoders - self._last
        far = np.abs(moved) > self._tremor
        self._side = np.where(far, np.sign(moved), self._side)
        self._last = np.where(far, encoders, self._last)
        return self._side
