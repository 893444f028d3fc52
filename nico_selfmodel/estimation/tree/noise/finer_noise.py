"""Noise of sensors along their line of sight, which they may know less surely than the rest.

A camera that tells the pose of a board by its corners knows depth ten times worse than what lies
across, and tilts worse than turns about its view; a camera that measures depth is like that, too.
What looks surer along the line of sight errs for another reason, and is not told apart.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TURN_NOISE = "orientation"
"""How the noise of a sensor's turns is called after its name."""
_DEPTH, _ROLL = " depth", f" roll {TURN_NOISE}"
"""How the noise along the line of sight, and of turns about it, are called after it."""
PARTS = np.array([0, 0, 1, 2, 2, 3])
"""Which noise of a place or pose each of its numbers has, z along the line of sight."""


def noises_of_places(name: str) -> tuple[str, ...]:
    """Return the names of a sensor's noise of places: across its line of sight, and along it."""
    return name, name + _DEPTH


def noises_of_turns(name: str) -> tuple[str, ...]:
    """Return the names of a sensor's noise of turns: across its line of sight, and about it."""
    return f"{name} {TURN_NOISE}", name + _ROLL


def coarser_noise(name: str) -> str:
    """Return the noise group that a finer one belongs to; a group's own name if it is none."""
    if name.endswith(_ROLL):
        return f"{name.removesuffix(_ROLL)} {TURN_NOISE}"
    return name.removesuffix(_DEPTH)


@dataclass(frozen=True)
class FinerNoise:
    """A noise group whose numbers may be more, or less, sure than others of the same sensor."""

    group: int
    """Its index."""
    of: int
    """The group that it shares a standard deviation with otherwise."""
    less_sure: bool
    """Which of both is less sure: depth than what lies across, tilts than turns about the view."""

    def is_apart(self, sensor: NDArray) -> bool:
        """Whether standard deviations of all groups tell it from the other. Shape (G,)."""
        own, other = sensor[self.group], sensor[self.of]
        return bool(own > other if self.less_sure else own < other)


def finer_noises(groups: Sequence[str]) -> tuple[FinerNoise, ...]:
    """Return the noise groups that share a standard deviation with another one by default."""
    others = [(i, coarser_noise(name)) for i, name in enumerate(groups)]
    return tuple(
        FinerNoise(i, groups.index(other), groups[i].endswith(_DEPTH))
        for i, other in others
        if other != groups[i] and other in groups
    )


def noise_ties(groups: Sequence[str], apart: Collection[int] = ()) -> NDArray:
    """Return which noise groups share a standard deviation: places of a sensor, and its turns.

    Args:
        groups: Their names.
        apart: Those of `finer_noises` that have one of their own.

    Returns:
        Numbers from 0. Shape (G,).
    """
    own = np.arange(len(groups))
    for finer in finer_noises(groups):
        if finer.group not in apart:
            own[finer.group] = finer.of
    return np.unique(own, return_inverse=True)[1].ravel()
