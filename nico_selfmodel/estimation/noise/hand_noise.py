"""What the hand's pixels, or its measured points, are uncertain by: the sensor and joint noise.

Play moves the hand itself, so both cameras see it alike: the k coordinates of a pose have the
covariance S = ss^2 I + sq^2 A A', A their derivatives by the joint angles. Unit weights would let
the play, some pixels wide, drown the tenths of a pixel in which the cameras tell depth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_RATIOS = np.logspace(-10.0, 4.0, 57)
"""Grid of (sq / ss)^2 [rad^2 / px^2] on which the likelihood is searched first."""
_FLOOR = 1e-6
"""Least noise of a sensor: exact data must still be weighed [px or m]."""
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class HandNoise:
    """Standard deviations of what disturbs an observation of the hand."""

    sensor_sigma: float
    """Of each coordinate, independent of the others [px, or m for measured points]."""
    joint_sigma: float
    """Of each joint angle about its encoder [rad]."""

    def covariance(self, by_angle: NDArray) -> NDArray:
        """Return the covariance of each observation.

        Args:
            by_angle: Derivatives of its coordinates by the joint angles. Shape (N, k, n).

        Returns:
            In squared units of the sensor. Shape (N, k, k).
        """
        return noise_covariance(by_angle, self.sensor_sigma, self.joint_sigma)

    def whitening(self, by_angle: NDArray, seen: NDArray) -> NDArray:
        """Return W with W S W' = I over the coordinates that were seen; zero for the others.

        Args:
            by_angle: Derivatives of the coordinates by the joint angles. Shape (N, k, n).
            seen: Which coordinates were measured. Shape (N, k).

        Returns:
            Lower triangular matrices. Shape (N, k, k).
        """
        return whitening_of(self.covariance(by_angle), seen)

    @classmethod
    def most_likely(
        cls,
        residuals: NDArray,
        by_angle: NDArray,
        seen: NDArray,
        fitted: NDArray | None = None,
    ) -> "HandNoise":
        """Estimate both standard deviations by maximum likelihood.

        With S / ss^2 = I + t A A' diagonal in the eigenvectors of A A', ss^2 follows in closed
        form from the ratio t = (sq / ss)^2, which alone is searched.

        Args:
            residuals: Measured minus predicted coordinates. Shape (N, k).
            by_angle: Their derivatives by the joint angles. Shape (N, k, n).
            seen: Which coordinates were measured. Shape (N, k).
            fitted: Covariance of what the prediction itself is uncertain by, where it was fitted to
                these residuals and took as much out of them. With it the likelihood is that of what
                no fit could take (Patterson, Thompson 1971). Shape (N, k, k).

        Returns:
            The most likely noise; a joint sigma of zero where the data show no play.

        Raises:
            ValueError: If nothing was seen.
        """
        lever, squared = _principal(residuals, by_angle, seen, fitted)
        if not len(lever):
            raise ValueError("no observation, no noise: at least one row must be seen")
        ratio = _best_ratio(lever, squared)
        sensor_sigma = float(np.sqrt(np.mean(squared / (1.0 + ratio * lever))))
        sensor_sigma = max(sensor_sigma, _FLOOR)
        return cls(sensor_sigma, float(np.sqrt(ratio)) * sensor_sigma)

    def sigmas(self, by_angle: NDArray, seen: NDArray) -> tuple[float, float]:
        """Return how surely observations like these tell both standard deviations (Fisher, Rao).

        Args:
            by_angle: Derivatives of the coordinates by the joint angles. Shape (N, k, n).
            seen: Which coordinates were measured. Shape (N, k).

        Returns:
            Standard deviation of `sensor_sigma` and of `joint_sigma`; inf where nothing tells.
        """
        lever, _ = _principal(np.zeros(seen.shape), by_angle, seen, None)
        variance = self.sensor_sigma**2 + self.joint_sigma**2 * lever
        slopes = 2.0 * np.stack([self.sensor_sigma / variance, self.joint_sigma * lever / variance])
        information = 0.5 * slopes @ slopes.T
        if np.linalg.det(information) <= 1e-12 * information[0, 0] * information[1, 1]:
            alone = information[0, 0]
            return float(alone**-0.5) if alone > 0.0 else np.inf, np.inf
        first, second = np.sqrt(np.diag(np.linalg.inv(information))).tolist()
        return first, second

    def close_to(self, other: "HandNoise", tolerance: float = 0.01) -> bool:
        """Return whether both sigmas agree within a relative tolerance."""
        mine, theirs = (
            np.array([noise.sensor_sigma, noise.joint_sigma]) for noise in (self, other)
        )
        return bool(np.all(np.abs(mine - theirs) <= tolerance * np.maximum(mine, theirs)))


def noise_covariance(
    by_angle: NDArray, sensor_sigma: float, joint_sigma: float | NDArray
) -> NDArray:
    """Return S = ss^2 I + A D^2 A' of observations, D the standard deviations of the joints.

    Args:
        by_angle: A, derivatives of the coordinates by the joint angles. Shape (N, k, n).
        sensor_sigma: ss, of each coordinate.
        joint_sigma: D, of all joints alike, or of each [rad]. Shape (n,).

    Returns:
        In squared units of the sensor. Shape (N, k, k).
    """
    moved = by_angle * joint_sigma
    return moved @ np.swapaxes(moved, 1, 2) + sensor_sigma**2 * np.eye(by_angle.shape[1])


def whitening_of(covariance: NDArray, seen: NDArray) -> NDArray:
    """Return W with W S W' = I over the coordinates that were seen; zero for the others.

    Args:
        covariance: S of each observation. Shape (N, k, k).
        seen: Which coordinates were measured. Shape (N, k).

    Returns:
        Matrices, lower triangular where S is not singular to rounding. Shape (N, k, k).
    """
    # What was not seen gets a variance of its own that nothing is correlated with.
    both = seen[:, :, None] & seen[:, None, :]
    whole = np.where(both, covariance, np.eye(seen.shape[1]))
    try:
        return np.linalg.inv(np.linalg.cholesky(whole)) * both
    except np.linalg.LinAlgError:
        # A hand beside a camera, as wrong readings put it: play drowns the sensor to rounding.
        values, vectors = np.linalg.eigh(whole)
        values = np.maximum(values, np.finfo(float).eps * values[:, -1:])
        return (vectors / np.sqrt(values)[:, None, :]) @ np.swapaxes(vectors, 1, 2) * both


def _principal(
    residuals: NDArray, by_angle: NDArray, seen: NDArray, fitted: NDArray | None
) -> tuple[NDArray, NDArray]:
    """Return eigenvalues of A A' and squared residuals along their eigenvectors, as (k,) each.

    What a fit took out of the squares is put back.
    """
    levers, squares = [], []
    for pattern in np.unique(seen, axis=0):
        rows = (seen == pattern).all(axis=1)
        if not pattern.any():
            continue
        a = by_angle[rows][:, pattern]
        values, vectors = np.linalg.eigh(a @ np.swapaxes(a, 1, 2))
        along = np.einsum("nij,ni->nj", vectors, residuals[rows][:, pattern])
        square = along**2
        if fitted is not None:
            own = fitted[np.ix_(rows, pattern, pattern)]
            square += np.einsum("nij,nik,nkj->nj", vectors, own, vectors)
        levers.append(np.maximum(values, 0.0).ravel())
        squares.append(square.ravel())
    if not levers:
        return np.zeros(0), np.zeros(0)
    return np.concatenate(levers), np.concatenate(squares)


def _best_ratio(lever: NDArray, squared: NDArray) -> float:
    """Return the most likely (sq / ss)^2: a grid, then golden sections of its logarithm."""

    def surprise(ratio: float) -> float:
        spread = 1.0 + ratio * lever
        return float(len(lever) * np.log(np.mean(squared / spread)) + np.log(spread).sum())

    values = np.array([surprise(ratio) for ratio in _RATIOS])
    best = int(np.argmin(values))
    if best == 0:
        return 0.0
    low, high = np.log(_RATIOS[best - 1]), np.log(_RATIOS[min(best + 1, len(_RATIOS) - 1)])
    while high - low > 1e-4:
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if surprise(float(np.exp(left))) < surprise(float(np.exp(right))):
            high = right
        else:
            low = left
    return float(np.exp(0.5 * (low + high)))
