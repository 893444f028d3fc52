"""Sensors that are alike, their rows taken together: what sees, what is seen, which joints move it.

All of it is the same wherever the body's parameters stand, and is found once.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.forward.rows_last import at_samples, consecutive
from nico_selfmodel.estimation.tree.forward.sensor_models import Shown
from nico_selfmodel.estimation.tree.tree_observations import SensorRows
from nico_selfmodel.model.tree.tree_motion import TreeMotion


@dataclass(frozen=True, eq=False)
class AttachedEnds:
    """The attached frames at one end of every row: all that is seen, or all that sees."""

    item: NDArray
    """Which of the attached frames it is. Shape (N,)."""
    on: NDArray
    """The link that carries it. Shape (N,)."""
    pose: NDArray
    """Samples. Shape (N,)."""
    moved: NDArray
    """Whether each joint moves it, 0 or 1. Shape (N, n)."""
    k: int
    """How many scalars a row has."""

    @cached_property
    def samples(self) -> NDArray | slice:
        """`pose`, as a slice where samples follow each other."""
        return consecutive(self.pose)

    @cached_property
    def scalar_samples(self) -> NDArray | slice:
        """Samples of all scalars. Shape (N k,)."""
        return consecutive(np.repeat(self.pose, self.k))

    @cached_property
    def by_item(self) -> tuple[tuple[int, NDArray | slice, NDArray | slice], ...]:
        """Each frame that is among them, its scalars, and their samples."""
        item, pose = np.repeat(self.item, self.k), np.repeat(self.pose, self.k)
        found = [(int(one), np.flatnonzero(item == one)) for one in np.unique(item)]
        return tuple((one, consecutive(own), consecutive(pose[own])) for one, own in found)

    def places(self, motion: TreeMotion, frames: NDArray) -> NDArray:
        """Return where they are in W. Frames on links, (m, 4, 4) -> (N, 3)."""
        if len(self.by_item) > 1:
            R, p = motion.R_WL[self.on, :, :, self.pose], motion.p_WL[self.on, :, self.pose]
            return p + (R @ frames[self.item, :3, 3, None])[:, :, 0]
        link, t = self.on[0], frames[self.item[0], :3, 3]
        p = motion.p_WL[link] + np.einsum("ijn,j->in", motion.R_WL[link], t)
        return at_samples(p, self.samples).T

    def orientations(self, motion: TreeMotion, frames: NDArray) -> NDArray:
        """Return how they stand in W. Frames on links, (m, 4, 4) -> (N, 3, 3)."""
        if len(self.by_item) > 1:
            return motion.R_WL[self.on, :, :, self.pose] @ frames[self.item, :3, :3]
        R = at_samples(motion.R_WL[self.on[0]], self.samples).transpose(2, 0, 1)
        return np.ascontiguousarray(R) @ frames[self.item[0], :3, :3]


@dataclass(frozen=True, eq=False)
class SensorRun:
    """Rows of sensors that follow each other and are alike: they are linearised at once."""

    parts: tuple[SensorRows, ...]
    """Of one kind and one mirror each, N rows together."""
    seen: AttachedEnds
    """What is seen."""
    seeing: AttachedEnds
    """What sees; the second marker of a distance."""

    @property
    def kind(self) -> str:
        """Of all of them."""
        return self.parts[0].kind

    @property
    def mirror(self) -> str:
        """In which all of it was seen; empty where directly."""
        return self.parts[0].mirror

    @property
    def pose(self) -> NDArray:
        """Samples. Shape (N,)."""
        return self.seen.pose

    @cached_property
    def measured(self) -> NDArray:
        """Shape (N, k)."""
        return np.concatenate([rows.measured for rows in self.parts])

    @cached_property
    def own(self) -> tuple[slice, ...]:
        """Rows of each part."""
        ends = np.cumsum([len(rows.rows) for rows in self.parts]).tolist()
        return tuple(slice(end - len(r.rows), end) for end, r in zip(ends, self.parts, strict=True))

    @cached_property
    def signs(self) -> NDArray:
        """Which way each joint moves what is seen before what sees. Shape (N, n)."""
        return self.seen.moved - self.seeing.moved


@dataclass(frozen=True, eq=False)
class Sight:
    """What the sensors of a run show of a body, and where it is."""

    shown: Shown
    """Of all rows, but for lenses."""
    parts: tuple[Shown, ...]
    """The same by sensor."""
    R_SW: NDArray
    """How W stands in what sees. Shape (N, 3, 3)."""
    p_WM: NDArray
    """Where what is seen stands, not where it is seen in a mirror. Shape (N, 3)."""
    p_WS: NDArray
    """Where what sees stands. Shape (N, 3)."""
