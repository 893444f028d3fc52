"""Noise belongs to poses: one draw of joint noise moves all that is seen of a pose.

The residuals of a pose, all its markers stacked, have the covariance S = s^2 I + A D^2 A', with s
of the sensor, A their derivatives by the joint angles and D the joints' standard deviations. With
B = A D / s it is s^2 (I + BB'), which is inverted as it stands where a pose has fewer coordinates
than joints. Elsewhere it is never formed: with G = I + B'B, S^-1 = (I - B G^-1 B') / s^2 (Woodbury
1950), and a root of it, W'W = S^-1, is W = (I - B X B') / s with X of `whitening_core`.
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.alike_errors import Decorrelation
from nico_selfmodel.estimation.noise.hand_noise import noise_covariance
from nico_selfmodel.geometry.small_matrices import (
    inverse_and_log_determinant,
    inverse_cholesky,
    whitening_core,
)
from nico_selfmodel.model.self_model import SelfModel

POSE_NOISE = "pose_noise"
"""Key of `SelfModel.fit`: the noise that the data an arm was learned from showed."""

FREE_SIGMA = 10.0
"""Standard deviation of a joint that says nothing in a pose [rad or m]."""


@dataclass(frozen=True, eq=False)
class PoseNoise:
    """What disturbs measurements: the sensor, each coordinate alone, and the joints, each pose."""

    sensor_sigma: float
    """Standard deviation of a coordinate, independent of all others [unit of the sensor]."""
    joint_sigma: NDArray
    """Standard deviation of each joint angle about its encoder [rad]. Shape (n,)."""

    def covariance(self, by_angle: NDArray) -> NDArray:
        """Return S of single observations.

        Args:
            by_angle: Derivatives of the coordinates by the joint angles. Shape (N, k, n).

        Returns:
            Shape (N, k, k).
        """
        return noise_covariance(by_angle, self.sensor_sigma, self.joint_sigma)

    def as_plain(self) -> dict[str, Any]:
        """Return it as `SelfModel.fit` holds it."""
        return {"sensor_sigma": self.sensor_sigma, "joint_sigma_rad": self.joint_sigma.tolist()}

    @classmethod
    def of(cls, model: SelfModel) -> "PoseNoise | None":
        """Return the noise that a model's training data showed; None where it does not say."""
        plain = model.fit.get(POSE_NOISE)
        if plain is None:
            return None
        return cls(float(plain["sensor_sigma"]), np.asarray(plain["joint_sigma_rad"], dtype=float))


class PoseGroups:
    """Which observations belong to one visit of a pose: rows <-> (visits, coordinates), padded.

    A visit has one draw of joint noise. Visits of one pose share besides what only that pose has
    (play, bending), so that all of them together count as one: `weight`.
    """

    def __init__(
        self, visit: NDArray, keep: NDArray, coordinates: int, pose: NDArray | None = None
    ) -> None:
        """Group rows.

        Args:
            visit: Number of each row's visit. Shape (N,).
            keep: Rows that count; the others become zeros. Boolean, shape (N,).
            coordinates: How many coordinates a row has, k.
            pose: Number of each row's pose; every visit a pose of its own if omitted. Shape (N,).
        """
        self.rows, self.k = np.flatnonzero(keep), coordinates
        self.numbers, lead, of = np.unique(visit[self.rows], return_index=True, return_inverse=True)
        """Number of each visit that counts, ascending. Shape (visits,)."""
        self._all = visit
        self.place = np.arange(len(lead)) if pose is None else pose[self.rows][lead]
        """Number of each visit's pose. Shape (visits,)."""
        _, same, visits = np.unique(self.place, return_inverse=True, return_counts=True)
        self.weight = 1.0 / visits[same]
        """What each visit counts. Shape (visits,)."""
        self.alike = bool((self.weight == 1.0).all())
        """Whether each visit is a pose of its own."""
        order = np.argsort(of, kind="stable")
        counts = np.bincount(of)
        place = np.arange(len(of)) - np.repeat(np.cumsum(counts) - counts, counts)
        self.pose = of
        """Index among the visits that count, of each row that counts. Shape (K,)."""
        self._slot = np.empty(len(of), dtype=int)
        self._slot[order] = place
        self.poses, self._most = len(counts), int(counts.max(initial=0))
        self.count = len(visit)
        self._full: NDArray | None = None
        """Rows by visit, where all have as many of them. Shape (visits, most)."""
        if (counts == self._most).all():
            self._full = self.rows[order].reshape(self.poses, self._most)
        self._alone = self._most == 1 and bool((of == np.arange(len(of))).all())

    def of(self, rows: NDArray) -> NDArray:
        """Return the index of the pose of any rows; the number of poses where none counts.

        Args:
            rows: Boolean, shape (N,).
        """
        wanted = self._all[rows]
        at = np.minimum(np.searchsorted(self.numbers, wanted), len(self.numbers) - 1)
        return np.where(self.numbers[at] == wanted, at, len(self.numbers))

    def gather(self, values: NDArray) -> NDArray:
        """Return values of rows by pose. Shape (N, k, ...) -> (poses, K, ...), zero where none."""
        if self._alone:
            return values[self.rows]
        if self._full is not None:
            grouped = values[self._full]
            return grouped.reshape(self.poses, self._most * self.k, *values.shape[2:])
        out = np.zeros((self.poses, self._most, *values.shape[1:]))
        out[self.pose, self._slot] = values[self.rows]
        return out.reshape(self.poses, self._most * self.k, *values.shape[2:])

    def scatter(self, grouped: NDArray) -> NDArray:
        """Return values by row. Shape (poses, K, ...) -> (N, k, ...), zero for rows left out."""
        parts = grouped.reshape(self.poses, self._most, self.k, *grouped.shape[2:])
        out = np.zeros((self.count, self.k, *grouped.shape[2:]))
        out[self.rows] = parts[self.pose, self._slot]
        return out


class PoseWhitening:
    """S^-1 of all poses and a root W of it, frozen at one state of the arm and one noise."""

    def __init__(
        self,
        groups: PoseGroups,
        by_angle: NDArray,
        noise: PoseNoise,
        slipped: NDArray | None = None,
    ) -> None:
        """Prepare the factors.

        Args:
            groups: Which rows belong together.
            by_angle: Derivatives of the rows' coordinates by the joint angles. Shape (N, k, n).
            noise: What disturbs them.
            slipped: Joints that are free in a pose, whatever their noise. Boolean, (poses, n).
        """
        self.groups, self.noise = groups, noise
        self._made_of = by_angle, slipped
        self.shared: Decorrelation | None = None
        """Of errors that poses share, see `sharing`."""
        self.lever = groups.gather(by_angle)
        """Derivatives by the joint angles, by pose. Shape (poses, K, n)."""
        joint_sigma = noise.joint_sigma
        if slipped is not None:
            joint_sigma = np.where(slipped, FREE_SIGMA, joint_sigma)[:, None]
        self.B = self.lever * (joint_sigma / noise.sensor_sigma)
        self._across = np.swapaxes(self.B, 1, 2)
        self._narrow = self.B.shape[1] <= self.B.shape[2]
        one, other = (self.B, self._across) if self._narrow else (self._across, self.B)
        self._square = one @ other + np.eye(one.shape[1])
        """I + BB' where that is the smaller one, else G. Shape (poses, K, K) or (poses, n, n)."""

    def quieter(self, part: float, slipped: NDArray | None = None) -> "PoseWhitening":
        """Return the same with joint noise of so much of what it is, and more joints free.

        Args:
            part: Of the joints' standard deviations.
            slipped: Joints that are free in a pose besides. Boolean, shape (poses, n).
        """
        noise = PoseNoise(self.noise.sensor_sigma, part * self.noise.joint_sigma)
        by_angle, free = self._made_of
        both = free if slipped is None else slipped if free is None else free | slipped
        return PoseWhitening(self.groups, by_angle, noise, both)

    @cached_property
    def G_inverse(self) -> NDArray:
        """Covariance of each pose's joint errors in their standard deviations, given its rows."""
        if not self._narrow:
            return self._inverted[0]
        return np.eye(self.B.shape[2]) - self._across @ (self._inverted[0] @ self.B)

    @cached_property
    def _inverted(self) -> tuple[NDArray, NDArray]:
        return inverse_and_log_determinant(self._square)

    @cached_property
    def _root(self) -> NDArray:
        return inverse_cholesky(self._square) if self._narrow else whitening_core(self._square)

    @property
    def taken(self) -> NDArray:
        """What joint noise takes of each coordinate's weight, diagonal of I - s^2 S^-1. (poses, K).

        It is 0 where only the sensor disturbs.
        """
        if self._narrow:
            return 1.0 - np.diagonal(self._inverted[0], axis1=1, axis2=2)
        return np.asarray(np.sum((self.B @ self.G_inverse) * self.B, axis=2))

    def root(self, x: NDArray) -> NDArray:
        """Return W x by pose, W'W = S^-1. Shape (poses, K, m) -> the same."""
        if self._narrow:
            return (self._root / self.noise.sensor_sigma) @ x
        return (x - self.B @ (self._root @ (self._across @ x))) / self.noise.sensor_sigma

    def inverse(self, x: NDArray) -> NDArray:
        """Return S^-1 x by pose. Shape (poses, K, m) -> the same."""
        if self._narrow:
            return (self._inverted[0] / self.noise.sensor_sigma**2) @ x
        less = self.B @ (self.G_inverse @ (self._across @ x))
        return (x - less) / self.noise.sensor_sigma**2

    def joint_errors(self, residuals: NDArray) -> tuple[NDArray, NDArray]:
        """Return what the rows tell of each pose's joint errors, in their standard deviations.

        The mean G^-1 B' u and the covariance G^-1; the last entry is that of a pose of which
        nothing was seen.

        Args:
            residuals: Measured minus predicted. Shape (N, k).

        Returns:
            Shapes (poses + 1, n) and (poses + 1, n, n).
        """
        n = self.B.shape[2]
        u = self.groups.gather(residuals[:, :, None]) / self.noise.sensor_sigma
        mean = (self.G_inverse @ (self._across @ u))[:, :, 0]
        return np.vstack([mean, np.zeros((1, n))]), np.concatenate(
            [self.G_inverse, np.eye(n)[None]]
        )

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of |S| of all coordinates that count."""
        coordinates = len(self.groups.rows) * self.groups.k
        sensor = 2.0 * coordinates * np.log(self.noise.sensor_sigma)
        return float(sensor + np.sum(self._inverted[1]))

    def whiten(self, residuals: NDArray, jacobian: NDArray) -> tuple[NDArray, NDArray]:
        """Whiten and weigh what a residual block returns.

        Args:
            residuals: Shape (k, N).
            jacobian: Shape (P, k, N).

        Returns:
            The same shapes; rows that do not count are zero.
        """
        both = np.concatenate([residuals[None], jacobian]).transpose(2, 1, 0)
        white = self.groups.scatter(self.white(both)).transpose(2, 1, 0)
        return np.ascontiguousarray(white[0]), np.ascontiguousarray(white[1:])

    def white(self, x: NDArray) -> NDArray:
        """Return whitened and weighed rows by pose. Shape (N, k, m) -> (poses, K, m).

        What poses share with others, where `sharing` said so, is whitened too.
        """
        white = self.root(self.groups.gather(x))
        if not self.groups.alike:
            white = np.sqrt(self.groups.weight)[:, None, None] * white
        if self.shared is None:
            return white
        return self.shared(white.reshape(-1, white.shape[2])).reshape(white.shape)

    @property
    def shared_by_row(self) -> Decorrelation | None:
        """Return `shared` in the order of the rows that count. Shape (N k, q)."""
        if self.shared is None:
            return None
        E = self.shared.E.reshape(self.groups.poses, -1, self.shared.E.shape[1])
        return Decorrelation.of(self.groups.scatter(E)[self.groups.rows].reshape(-1, E.shape[2]))

    def sharing(self, columns: NDArray) -> "PoseWhitening":
        """Return the same with errors that poses share.

        Args:
            columns: What errors of N(0, 1) do to the rows. Shape (N, k, q).
        """
        out = copy(self)
        out.shared = Decorrelation.of(self.white(columns).reshape(-1, columns.shape[2]))
        return out
