"""Noise belongs to poses: one draw of joint noise moves all that is seen of a pose.

The residuals of a pose, all its markers stacked, have the covariance S = s^2 I + A D^2 A', with s
of the sensor, A their derivatives by the joint angles and D the joints' standard deviations. With
B = A D / s it is s^2 (I + BB'), which is inverted as it stands where a pose has fewer coordinates
than joints. Elsewhere it is never formed: with G = I + B'B, S^-1 = (I - B G^-1 B') / s^2 (Woodbury
1950), and a root of it, W'W = S^-1, is W = (I - B X B') / s with X of `whitening_core`.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.alike_errors import Decorrelation
from nico_selfmodel.estimation.noise.hand_noise import noise_covariance
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.geometry.small_matrices import inverse_cholesky, whitening_core
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
            by_angle: Derivatives of the rows' coordinates by the joint angles. Shape (N, k, n).
            slipped: Joints that are free in a pose, whatever their noise. Boolean, (visits, n).
        """
        self.groups, self.noise = groups, noise
        self._made_of = by_angle, slipped
        self.shared: Decorrelation | None = None
        """Of errors that poses share, see `sharing`."""
        self.lever = groups.gather(by_angle)
        """Derivatives by the joint angles, by visit. Shape (T, n)."""
        self.joint_sigma = noise.joint_sigma[None]
        """Of each joint, in each visit where it is another. Shape (1 or visits, n)."""
        if slipped is not None:
            self.joint_sigma = np.where(slipped, FREE_SIGMA, noise.joint_sigma)
        each = self.joint_sigma if slipped is None else self.joint_sigma[groups.visit]
        self._B = self.lever * (each / noise.sensor_sigma)

    def quieter(self, part: float | NDArray, slipped: NDArray | None = None) -> "PoseWhitening":
        """Return the same with joint noise of so much of what it is, and more joints free.

        Args:
            part: Of the joints' standard deviations, of all or of each. Shape (n,).
            slipped: Joints that are free in a pose besides. Boolean, shape (poses, n).
        """
        noise = PoseNoise(self.noise.sensor_sigma, part * self.noise.joint_sigma)
        by_angle, free = self._made_of
        both = free if slipped is None else slipped if free is None else free | slipped
        return PoseWhitening(self.groups, by_angle, noise, both)

    @cached_property
    def _factors(self) -> list["_Factors"]:
        return [_Factors.of(B) for _, (B,) in self.groups.stacks(self._B)]

    @cached_property
    def _joints_told(self) -> NDArray:
        """Covariance G^-1 of each visit's joint errors, in their sigmas. Shape (visits, n, n)."""
        out = np.empty((self.groups.poses, *self._B.shape[1:] * 2))
        for bucket, factors in zip(self.groups.buckets, self._factors, strict=True):
            out[bucket.visits] = factors.G_inverse
        return out

    @property
    def taken(self) -> NDArray:
        """What joint noise takes of each coordinate's weight, diagonal of I - s^2 S^-1. (T,).

        It is 0 where only the sensor disturbs.
        """
        return np.concatenate([np.zeros(0), *(own.taken.ravel() for own in self._factors)])

    def root(self, x: NDArray) -> NDArray:
        """Return W x by visit, W'W = S^-1. Shape (T, m) -> the same."""
        return self._mapped(_Factors.root, x)

    def transposed_root(self, x: NDArray) -> NDArray:
        """Return W' x by visit. Shape (T, m) -> the same."""
        return self._mapped(_Factors.transposed_root, x)

    def inverse(self, x: NDArray) -> NDArray:
        """Return S^-1 x by visit. Shape (T, m) -> the same."""
        return self._mapped(_Factors.inverse, x) / self.noise.sensor_sigma

    def _mapped(self, function: Callable[["_Factors", NDArray], NDArray], x: NDArray) -> NDArray:
        """Return a function of each bucket's coordinates, in the sensor's standard deviations."""
        x = x / self.noise.sensor_sigma
        both = zip(self._factors, self.groups.stacks(x), strict=True)
        parts = [function(own, stack).reshape(-1, x.shape[1]) for own, (_, (stack,)) in both]
        return parts[0] if len(parts) == 1 else np.concatenate([x[:0], *parts])

    def joint_errors(self, residuals: NDArray) -> tuple[NDArray, NDArray]:
        """Return what the rows tell of each visit's joint errors, in their standard deviations.

        The mean G^-1 B' u and the covariance G^-1; the last entry is that of a visit of which
        nothing was seen.

        Args:
            residuals: Measured minus predicted. Shape (N, k).

        Returns:
            Shapes (visits + 1, n) and (visits + 1, n, n).
        """
        n = self._B.shape[1]
        u = self.groups.gather(residuals) / self.noise.sensor_sigma
        mean = (self._joints_told @ self.groups.products(self._B, u[:, None]))[:, :, 0]
        spread = np.concatenate([self._joints_told, np.eye(n)[None]])
        return np.vstack([mean, np.zeros((1, n))]), spread

    @cached_property
    def log_determinant(self) -> float:
        """Logarithm of |S| of all coordinates that count."""
        coordinates = len(self.groups.rows) * self.groups.k
        sensor = 2.0 * coordinates * np.log(self.noise.sensor_sigma)
        return float(sensor + sum(factors.log_determinant for factors in self._factors))

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
        """Return whitened and weighed rows by visit. Shape (N, k, m) -> (T, m).

        What poses share with others, where `sharing` said so, is whitened too.
        """
        white = self.counted(self.root(self.groups.gather(x)))
        return white if self.shared is None else self.shared(white)

    def counted(self, white: NDArray) -> NDArray:
        """Return whitened coordinates times the root of what their visit counts. Shape (T, m)."""
        if self.groups.alike:
            return white
        return np.sqrt(self.groups.weight)[self.groups.visit, None] * white

    @property
    def shared_by_row(self) -> Decorrelation | None:
        """Return `shared` in the order of the rows that count. Shape (N k, q)."""
        if self.shared is None:
            return None
        E = self.groups.scatter(self.shared.E)[self.groups.rows]
        return Decorrelation.of(E.reshape(-1, E.shape[2]))

    def sharing(self, columns: NDArray) -> "PoseWhitening":
        """Return the same with errors that poses share.

        Args:
            columns: What errors of N(0, 1) do to the rows. Shape (N, k, q).
        """
        out = copy(self)
        out.shared = Decorrelation.of(self.white(columns))
        return out


@dataclass(frozen=True, eq=False)
class _Factors:
    """S / s^2 = I + BB' of visits that have as many coordinates."""

    B: NDArray
    """Shape (V, K, n)."""
    core: NDArray
    """L^-1 of narrow visits, which have at most as many coordinates as joints; else X."""
    lower: NDArray
    """L^-1, of I + BB' = L L' where visits are narrow, else of G."""
    log_determinant: float

    @classmethod
    def of(cls, B: NDArray) -> "_Factors":
        """Factor, whichever is the smaller one."""
        _, K, n = B.shape
        across = np.swapaxes(B, 1, 2)
        if n >= K:
            lower, logs = inverse_cholesky(B @ across + np.eye(K))
            return cls(B, lower, lower, float(np.sum(logs)))
        core, lower, logs = whitening_core(across @ B + np.eye(n))
        return cls(B, core, lower, float(np.sum(logs)))

    @property
    def _narrow(self) -> bool:
        return self.B.shape[1] <= self.B.shape[2]

    @cached_property
    def _inverse(self) -> NDArray:
        return np.swapaxes(self.lower, 1, 2) @ self.lower

    @property
    def G_inverse(self) -> NDArray:
        """Shape (V, n, n)."""
        if not self._narrow:
            return self._inverse
        told = self.lower @ self.B
        return np.eye(self.B.shape[2]) - np.swapaxes(told, 1, 2) @ told

    @property
    def taken(self) -> NDArray:
        """Diagonal of I - S^-1. Shape (V, K)."""
        if self._narrow:
            return 1.0 - np.einsum("gij,gij->gj", self.lower, self.lower)
        along = self.B @ np.swapaxes(self.lower, 1, 2)
        return np.einsum("gij,gij->gi", along, along)

    def root(self, x: NDArray) -> NDArray:
        """Return W x."""
        return self.core @ x if self._narrow else self._less(self.core, x)

    def transposed_root(self, x: NDArray) -> NDArray:
        """Return W' x."""
        core = np.swapaxes(self.core, 1, 2)
        return core @ x if self._narrow else self._less(core, x)

    def inverse(self, x: NDArray) -> NDArray:
        """Return S^-1 x."""
        return self._inverse @ x if self._narrow else self._less(self._inverse, x)

    def _less(self, middle: NDArray, x: NDArray) -> NDArray:
        """Return x - B middle B' x."""
        return x - self.B @ (middle @ (np.swapaxes(self.B, 1, 2) @ x))
