"""Whether a body still is what it was, pose by pose: the statistic of Shiryaev and Roberts.

For each change j that is looked for, with l_j what a pose says for it (Pollak 1985; the head start:
Moustakides, Polunchenko, Tartakovsky 2011):

    R_j = 20,  ln R_j <- ln(1 + R_j) + l_j,  R = sum_j w_j R_j,  alarm at ln R > 10

While nothing changed, R less the number of poses is a martingale, and R is never negative. So the
chance of an alarm within n poses is at most (n + 20) e^-10 (Doob): the threshold is theory, and
rests on the noise alone.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

THRESHOLD = 10.0
"""Logarithm of the statistic that raises the alarm: a false one in at most one of 180 recordings of
100 poses."""
HEAD_START = 20.0
"""A body is handled while nobody watches: that it changed before the first pose is as likely as in
the course of so many."""


def chance_of_false_alarm(poses: int) -> float:
    """Return the largest probability of an alarm within so many poses if nothing changed."""
    return min(1.0, (poses + HEAD_START) * float(np.exp(-THRESHOLD)))


@dataclass(frozen=True, eq=False)
class Monitor:
    """What is remembered of the poses so far; each new one makes a new monitor."""

    weights: NDArray
    """How likely each change is beforehand; sum 1. Shape (m,)."""
    log_ratios: NDArray
    """ln R_j of each change. Shape (m,)."""
    sums: NDArray
    """Of what the poses said for each change since it began to be likely. Shape (m,)."""
    since: NDArray
    """The first pose of each sum. Shape (m,)."""
    poses: int = 0
    """Poses so far."""

    @classmethod
    def of(cls, weights: NDArray) -> "Monitor":
        """Return one that has seen nothing.

        Args:
            weights: Of the changes to look for; sum 1. Shape (m,).
        """
        m = len(weights)
        start = np.full(m, np.log(HEAD_START))
        return cls(weights, start, np.zeros(m), np.zeros(m, dtype=int))

    @property
    def log_ratio(self) -> float:
        """The statistic's logarithm, ln R."""
        return float(np.logaddexp.reduce(np.log(self.weights) + self.log_ratios))

    @property
    def alarm(self) -> bool:
        """Whether the statistic has passed its threshold."""
        return self.log_ratio > THRESHOLD

    @property
    def changed_at(self) -> int:
        """The most likely first pose after the change, if there was one."""
        return int(self.since[np.argmax(np.log(self.weights) + self.log_ratios)])

    def after(self, steps: NDArray) -> "Monitor":
        """Return the monitor after one more pose.

        Args:
            steps: What the pose says for each change. Shape (m,).
        """
        fresh = self.sums <= 0.0
        return Monitor(
            self.weights,
            np.logaddexp(0.0, self.log_ratios) + steps,
            np.where(fresh, 0.0, self.sums) + steps,
            np.where(fresh, self.poses, self.since),
            self.poses + 1,
        )
