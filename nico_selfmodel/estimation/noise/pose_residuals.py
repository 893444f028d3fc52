"""Residuals of whole poses: every marker and every camera that measured the hand there, stacked.

A pose has one draw of joint noise for all of them, so it is one vote however many there are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_observations import HandObservations
from nico_selfmodel.estimation.observations.observations import Observations

_BY_POSE = ("residuals", "by_angle", "by_side", "slopes", "seen", "sample")


@dataclass(frozen=True, eq=False)
class PoseResiduals:
    """Measured minus predicted coordinates of N poses, K for each, zero where not measured."""

    sensor: str
    """What measured the poses: `points` or `pixels`."""
    names: tuple[str, ...]
    """Parameters of the prediction. Length P."""
    residuals: NDArray
    """In the sensor's unit [m or px]. Shape (N, K)."""
    by_angle: NDArray
    """Derivatives of the prediction by the joint angles. Shape (N, K, n)."""
    by_side: NDArray
    """What backlash does where nobody tells its side, `HandObservations.by_side`. (N, K, n)."""
    slopes: NDArray
    """Derivatives of the prediction by the named parameters. Shape (N, K, P)."""
    seen: NDArray
    """Which coordinates were measured. Boolean, shape (N, K)."""
    sample: NDArray
    """Number of each pose, the first where a standing robot was measured often. Shape (N,)."""

    @classmethod
    def of(cls, observations: HandObservations) -> "PoseResiduals":
        """Stack the rows of a data set by pose, in their order.

        Samples that follow each other with equal readings are one pose: the robot stood still, and
        its frames share their joint noise. They are averaged.

        Args:
            observations: Rows of measurements held against a model.
        """
        arm, seen = observations.arm, observations.seen
        predicted, jacobian = observations.block.project(observations.x)
        pose, sample = _poses_of(arm)
        slot = pose * len(arm.markers) + arm.marker
        by_angle = observations.block.by_angle(observations.x)
        stack = _Stack(slot, seen, len(sample), len(arm.markers))
        return cls(
            observations.sensor,
            observations.names,
            stack.mean((observations.block.measured - predicted).T[:, :, None])[:, :, 0],
            stack.mean(by_angle),
            stack.mean(observations.by_side(by_angle)),
            stack.mean(jacobian.transpose(2, 1, 0)),
            stack.seen,
            sample,
        )

    def __len__(self) -> int:
        """Return the number of poses N."""
        return len(self.sample)

    @property
    def dof(self) -> NDArray:
        """How many coordinates of each pose were measured. Shape (N,)."""
        return self.seen.sum(axis=1)

    def select(self, rows: slice | NDArray) -> "PoseResiduals":
        """Return the chosen poses."""
        parts = (getattr(self, name)[rows] for name in _BY_POSE)
        return PoseResiduals(self.sensor, self.names, *parts)

    @classmethod
    def together(cls, parts: tuple["PoseResiduals", ...]) -> "PoseResiduals":
        """Return the poses of several, all of the same shape, one after the other."""
        arrays = (np.concatenate([getattr(part, name) for part in parts]) for name in _BY_POSE)
        return cls(parts[0].sensor, parts[0].names, *arrays)


def _poses_of(arm: Observations) -> tuple[NDArray, NDArray]:
    """Return the number of the pose of each row, shape (R,), and each pose's sample, shape (N,)."""
    _, first, of_row = np.unique(arm.sample, return_index=True, return_inverse=True)
    order = np.argsort(first)
    readings = arm.angles[first[order]]
    moved = np.ones(len(order), dtype=bool)
    sides = arm.approach[first[order]]
    moved[1:] = ((readings[1:] != readings[:-1]) | (sides[1:] != sides[:-1])).any(axis=1)
    pose_of_sample = np.empty(len(order), dtype=int)
    pose_of_sample[order] = np.cumsum(moved) - 1
    return pose_of_sample[of_row], arm.sample[first[order][moved]]


class _Stack:
    """Rows laid into the places of their pose and marker, averaged where several share one."""

    def __init__(self, slot: NDArray, seen: NDArray, poses: int, markers: int) -> None:
        self._slot, self._row_seen = slot, seen
        self._shape = (poses, markers * seen.shape[1])
        self._places = poses * markers
        self._single = len(np.unique(slot)) == len(slot)
        self._count = self._sum(np.ones((*seen.shape, 1)))
        self.seen = self._count.reshape(self._shape) > 0.0

    def _sum(self, rows: NDArray) -> NDArray:
        total = np.zeros((self._places, *rows.shape[1:]))
        masked = rows * self._row_seen[:, :, None]
        if self._single:
            total[self._slot] = masked
        else:
            np.add.at(total, self._slot, masked)
        return total

    def mean(self, rows: NDArray) -> NDArray:
        """Return rows of shape (R, k, m) as poses of shape (N, K, m)."""
        mean = self._sum(rows) / np.maximum(self._count, 1.0)
        return mean.reshape(*self._shape, rows.shape[2])
