"""Commands of joints and readings of their encoders over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array, read_only
from nico_selfmodel.dataset.array_hash import array_hash
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.names import check_name


@dataclass(frozen=True, eq=False)
class MotionRecording:
    """Where joints were told to go, and where their encoders said they were, row by row.

    Raises:
        ValueError: If shapes differ, times do not rise, or numbers are not finite.
    """

    name: str
    """What it is called."""
    joints: tuple[JointInfo, ...]
    """What their encoders are. Length n."""
    time: NDArray
    """Of each row [s], rising. Shape (T,)."""
    commanded: NDArray
    """Where each joint had last been told to go [encoder unit]. Shape (T, n)."""
    encoders: NDArray
    """What each encoder read [encoder unit]; nan where it was not read. Shape (T, n)."""
    source: str = ""
    """Where it is from, in words."""

    def __post_init__(self) -> None:
        """Check everything and make the arrays read-only."""
        check_name(self.name, "the name of a recording")
        names = [joint.name for joint in self.joints]
        if not names or len(set(names)) < len(names):
            raise ValueError(
                f"expected joints of different names, got {', '.join(names) or 'none'}"
            )
        count = np.size(self.time)
        object.__setattr__(self, "time", frozen_array(self.time, (count,), "time"))
        shape = (count, len(names))
        object.__setattr__(self, "commanded", frozen_array(self.commanded, shape, "commanded"))
        object.__setattr__(self, "encoders", read_only(self.encoders, float))
        if self.encoders.shape != shape or np.isinf(self.encoders).any():
            raise ValueError(f"encoders must have shape {shape} and be finite, or nan if not read")
        late = np.flatnonzero(np.diff(self.time) <= 0.0)
        if late.size:
            row = int(late[0])
            raise ValueError(
                f"times must rise, but after {self.time[row]:g} s comes {self.time[row + 1]:g} s"
            )

    def __len__(self) -> int:
        return len(self.time)

    @property
    def content_hash(self) -> str:
        """The hash by which it is known again, however its files are written."""
        head = repr([joint.to_mapping() for joint in self.joints])
        columns = {key: getattr(self, key) for key in ("time", "commanded", "encoders")}
        return array_hash(head, columns)
