"""Starting and stopping at random, so that one's own motion is like nobody else's."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only

_PAUSE, _GAP = 0.1, 0.25
"""Least time between two commands, and the mean of what is added to it [s]."""
_WAY = 0.06
"""Mean length of a way, as a share of the range of that joint which goes farthest."""
_STILL = 1e-9
"""Range of a joint, as a share of its readings, that is nothing but rounding."""


@dataclass(frozen=True, eq=False)
class MotorProgram:
    """Commands, and when they are given."""

    times: NDArray
    """From the beginning, increasing [s]. Shape (K,)."""
    commands: NDArray
    """Readings to go to [encoder units]. Shape (K, n)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only, and check that there is a command for each time."""
        object.__setattr__(self, "times", read_only(self.times, float))
        object.__setattr__(self, "commands", read_only(self.commands, float))
        if self.commands.ndim != 2 or self.times.shape != self.commands.shape[:1]:
            raise ValueError(
                "a motor program has a command for each time, got shapes "
                f"{self.times.shape} and {self.commands.shape}"
            )

    @classmethod
    def random(cls, poses: NDArray, seconds: float, rng: np.random.Generator) -> "MotorProgram":
        """Draw one in which starts and stops say nothing of when the next ones come.

        Lengths of ways and what is added to the pauses are exponentially distributed, which has no
        memory: whether something moves is then nearly a Markov chain, and whoever started at the
        same time by chance stops at the same time only by another chance.

        Args:
            poses: Between which to move [encoder units]. Shape (P, n).
            seconds: How long it shall last.

        Raises:
            ValueError: If there are fewer than two poses, or no time.
        """
        if len(poses) < 2:
            raise ValueError(f"a motor program needs two poses at least, got {len(poses)}")
        if not 0.0 < seconds < np.inf:
            raise ValueError(f"a motor program lasts for more than 0 s, got {seconds:g} s")
        gaps = _PAUSE + rng.exponential(_GAP, int(np.ceil(seconds / _PAUSE)))
        times = np.concatenate([[0.0], np.cumsum(gaps)])
        times = times[times < seconds]
        span = np.ptp(poses, axis=0)
        still = span <= _STILL * np.abs(poses).max(axis=0)
        span = np.where(still, np.inf, span)
        commands = [poses[rng.integers(len(poses))]]
        for length in rng.exponential(_WAY, len(times) - 1):
            way = poses[rng.integers(len(poses))] - commands[-1]
            whole = np.abs(way / span).max()
            commands.append(commands[-1] + way * min(1.0, length / max(whole, 1e-9)))
        return cls(times, np.array(commands))

    def later(self, seconds: float) -> "MotorProgram":
        """Return the same program, begun later."""
        return replace(self, times=self.times + seconds)

    def due(self, after: float, until: float) -> list[tuple[float, NDArray]]:
        """Return times and commands of an interval, its end included, its beginning not."""
        inside = (self.times > after) & (self.times <= until)
        return list(zip(self.times[inside].tolist(), self.commands[inside], strict=True))
