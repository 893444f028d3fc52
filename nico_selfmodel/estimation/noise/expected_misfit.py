"""What a sum of squared residuals is to be expected to be, tails of the noise and all.

Squares whitened by an assumed covariance S0 have, under a mixture of components S_k with shares p_k
(Magnus 1978, moments of quadratic forms), for each pose

    mean = sum_k p_k tr T_k,  variance = sum_k p_k (2 tr T_k^2 + (tr T_k)^2) - mean^2,
    T_k = S0^-1 S_k

A rare loose pose counts more in the scatter of the sum than in its mean: taken for normal, the
noise of a healthy body is called a misfit.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_noise import whitening_of
from nico_selfmodel.estimation.noise.hand_observations import HandObservations
from nico_selfmodel.estimation.noise.mixture_density import core_and_tail
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.noise.training_noise import expected_noise
from nico_selfmodel.model.self_model import SelfModel


def expected_misfit(
    model: SelfModel, observations: HandObservations, inliers: NDArray, learned: int
) -> tuple[float, float]:
    """Return the mean of the sum of squares of inlier rows, and its standard deviation.

    Args:
        model: With the noise of its training; without it the assumed noise is taken as it is.
        observations: All rows, with the noise that is assumed.
        inliers: Rows that count. Boolean, shape (N,).
        learned: How many parameters were fitted to them.
    """
    count, whole = int(observations.seen[inliers].sum()), int(observations.seen.sum())
    redundancy = max(count - learned, 0)
    if not model.noise_mixtures or not redundancy:
        return float(redundancy), float(np.sqrt(2.0 * redundancy))
    poses = PoseResiduals.of(observations)
    markers = poses.seen.shape[1] // observations.seen.shape[1]
    # Rows are whitened one by one, whatever else was measured at their pose.
    alone = np.kron(np.eye(markers), np.ones((observations.seen.shape[1],) * 2))
    assumed = observations.noise.covariance(poses.by_angle) * alone
    white = whitening_of(assumed, poses.seen)
    noise = expected_noise(model, observations.sensor)
    mean, square = np.zeros(len(poses)), np.zeros(len(poses))
    shares = (1.0 - noise.tail_share, noise.tail_share)
    for share, part in zip(shares, core_and_tail(noise), strict=True):
        t = white @ part.covariance(poses.by_angle) @ np.swapaxes(white, 1, 2)
        trace = np.trace(t, axis1=1, axis2=2)
        mean += share * trace
        square += share * (2.0 * np.sum(t * t, axis=(1, 2)) + trace**2)
    part = count / whole
    # What was learned took its share of the mean.
    expected = part * float(mean.sum()) * redundancy / count
    return expected, float(np.sqrt(part * np.sum(square - mean**2)))
