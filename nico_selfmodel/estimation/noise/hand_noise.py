"""What the hand's pixels, or its measured points, are uncertain by: the sensor and joint noise.

Play moves the hand itself, so both cameras see it alike: the k coordinates of a pose have the
covariance S = ss^2 I + sq^2 A A', A their derivatives by the joint angles. Unit weights would let
the play, some pixels wide, drown the tenths of a pixel in which the cameras tell depth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LARGEST_NOISE = 0.05
"""Residuals above this share of the size of what was seen explain nothing."""
LARGEST_JOINT_NOISE = np.radians(5.0)
"""A joint that is this uncertain about its encoder is not noisy but wrong: that is no play."""


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

    def sigmas(self, by_angle: NDArray, seen: NDArray) -> tuple[float, float]:
        """Return how surely observations like these tell both standard deviations (Fisher, Rao).

        Args:
            by_angle: Derivatives of the coordinates by the joint angles. Shape (N, k, n).
            seen: Which coordinates were measured. Shape (N, k).

        Returns:
            Standard deviation of `sensor_sigma` and of `joint_sigma`; inf where nothing tells.
        """
        there = by_angle * seen[:, :, None]
        values = np.linalg.eigvalsh(there @ np.swapaxes(there, 1, 2))
        # As many as were seen: coordinates that were not have eigenvalues of zero, the least.
        told = np.arange(seen.shape[1]) >= (~seen).sum(axis=1)[:, None]
        lever = np.maximum(values[told], 0.0)
        variance = self.sensor_sigma**2 + self.joint_sigma**2 * lever
        slopes = 2.0 * np.stack([self.sensor_sigma / variance, self.joint_sigma * lever / variance])
        information = 0.5 * slopes @ slopes.T
        if np.linalg.det(information) <= 1e-12 * information[0, 0] * information[1, 1]:
            alone = information[0, 0]
            return float(alone**-0.5) if alone > 0.0 else np.inf, np.inf
        first, second = np.sqrt(np.diag(np.linalg.inv(information))).tolist()
        return first, second


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
