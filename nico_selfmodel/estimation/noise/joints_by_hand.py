"""What the joints of an arm were off from their encoders, told by where its hand was seen."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.noise.hand_observations import (
    JOINT_SIGMA,
    covariance_of,
    hand_observations_of,
)
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.model.self_model import SelfModel

_RARE = 3.090232
"""A standard normal deviate exceeds this once in a thousand times."""


@dataclass(frozen=True, eq=False)
class JointsByHand:
    """What joints were off from their encoders in N poses in which the hand was seen."""

    sample: NDArray
    """Number of each pose. Shape (N,)."""
    off: NDArray
    """Likeliest, to be added to the angles that encoders tell [rad]. Shape (N, n)."""
    covariance: NDArray
    """Of that [rad^2]. Shape (N, n, n)."""
    expected: NDArray
    """Whether the hand was where all noise together lets expect it. Boolean, shape (N,)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("sample", "off", "covariance", "expected"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def joints_by_hand(model: SelfModel, data: Dataset) -> JointsByHand:
    """Tell what joints were off by.

    With r what the hand was seen off by, A its derivatives by the joints, their noise N(0, D^2) and
    R the sensor's noise and what arm and cameras are known to (linear Gaussian, Bayes)

        q = D^2 A' S^-1 r,    cov q = D^2 - D^2 A' S^-1 A D^2,    S = A D^2 A' + R

    A hand that is farther off than once in a thousand times, r' S^-1 r, is not expected there.

    Args:
        model: The arm, and where the hand is seen by pixels, its cameras.
        data: Poses; rows in which nothing was seen count for nothing.

    Raises:
        DataError: If joints, units or markers differ, or nothing was seen.
        ModelError: If the model does not say what noise to expect.
    """
    observed = hand_observations_of(model, data)
    poses, noise = PoseResiduals.of(observed), PoseNoise.of(model)
    same = np.full(len(model.joints), float(model.fit.get(JOINT_SIGMA, 0.0)))
    D2 = np.diag(np.square(same if noise is None else noise.joint_sigma))
    A, C = poses.by_angle, covariance_of(model, poses.names)
    R = observed.noise.sensor_sigma**2 * np.eye(A.shape[1])
    R = R + poses.slopes @ C @ np.swapaxes(poses.slopes, 1, 2)
    S = A @ D2 @ np.swapaxes(A, 1, 2) + R
    gain = np.swapaxes(np.linalg.solve(S, A @ D2), 1, 2)
    r = poses.residuals[:, :, None]
    chi_square = (np.swapaxes(r, 1, 2) @ np.linalg.solve(S, r))[:, 0, 0]
    return JointsByHand(
        poses.sample,
        (gain @ r)[:, :, 0],
        D2 - gain @ A @ D2,
        chi_square < _rare(poses.dof),
    )


def _rare(dof: NDArray) -> NDArray:
    """Return what chi-squares exceed once in a thousand times (Wilson, Hilferty 1931)."""
    share = 2.0 / (9.0 * np.maximum(dof, 1))
    return dof * (1.0 - share + _RARE * np.sqrt(share)) ** 3
