"""Poses that contradict a body, and whether they are more than false detections explain.

A pose contradicts where r' (S1 + M)^-1 r, by the tail of the noise and what the model is uncertain
by, is as rare as `OUTLIER_AT` standard deviations of a point. A body lets expect a share g of such
poses, false detections. More than k of N are no accident where

    P(X > k) < 1e-3,  X ~ Binomial(N, g)
"""

from dataclasses import dataclass
from math import exp, lgamma, log, log1p

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.noise.hand_observations import HandObservations, covariance_of
from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.noise.training_noise import expected_noise
from nico_selfmodel.estimation.observations.outlier_words import name_samples
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.chi_square import as_rare_as
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT

LEAST_SHARE = 0.005
"""Share of false detections that any sensor has: a training that showed none excludes no more."""
WHERE_TO_LOOK = (
    "look for labels exchanged, wrong detections, an encoder that was not read, and measurements "
    "and readings of different moments"
)
"""What poses that contradict here and there may come of."""
_ACCIDENT = 1e-3
"""Chance below which so many contradicting poses are no accident."""


@dataclass(frozen=True, eq=False)
class Contradictions:
    """Poses held against a body, and which of them it cannot explain."""

    sample: NDArray
    """Number of each pose. Shape (N,)."""
    found: NDArray
    """Whether it is further off than the tail of the noise explains. Boolean, shape (N,)."""
    most: int
    """So many are to be expected at most."""

    def __post_init__(self) -> None:
        """Keep read-only copies."""
        object.__setattr__(self, "sample", read_only(self.sample))
        object.__setattr__(self, "found", read_only(self.found, bool))

    @classmethod
    def of(
        cls, poses: PoseResiduals, density: MixtureDensity, share: float | None = None
    ) -> "Contradictions":
        """Look for them.

        Args:
            poses: N poses held against a body.
            density: Of these poses.
            share: Of poses with false detections that is to be expected; the density's if omitted.
        """
        squares = np.sum(density.whiten(poses.residuals)[1] ** 2, axis=1)
        kinds, which = np.unique(poses.dof, return_inverse=True)
        limits = np.array([as_rare_as(OUTLIER_AT**2, 3, k) if k else np.inf for k in kinds])
        expected = max(density.outlier_share if share is None else share, LEAST_SHARE)
        return cls(poses.sample, squares > limits[which], most_expected(len(poses), expected))

    @property
    def count(self) -> int:
        """How many poses contradict."""
        return int(self.found.sum())

    @property
    def too_many(self) -> bool:
        """Whether they are more than false detections explain."""
        return self.count > self.most

    @property
    def words(self) -> str:
        """What was found, for a verdict."""
        words = "pose is" if self.count == 1 else "poses are"
        return (
            f"{self.count} of {len(self.found)} {words} further off than noise explains, where "
            f"false detections let expect {self.most} at most ("
            f"{name_samples(self.sample[self.found])})"
        )


def contradictions(
    poses: PoseResiduals, noise: NoiseMixture, covariance: NDArray, share: float | None = None
) -> Contradictions:
    """Return which poses contradict a body.

    Args:
        poses: N poses held against it.
        noise: What is expected to disturb them.
        covariance: Of the poses' parameters. Shape (P, P).
        share: Of poses with false detections that is to be expected; the noise's if omitted.
    """
    return Contradictions.of(poses, MixtureDensity(poses, noise, covariance), share)


def hand_contradictions(
    model: SelfModel, observations: HandObservations, dataset: Dataset | None = None
) -> Contradictions | None:
    """Return which poses contradict an arm, or an arm and two cameras.

    Args:
        observations: What is held against it, where its parameters are.
        dataset: The measurements, for the noise that they state; none if omitted.

    Returns:
        None where the model does not say what noise its sensor has.
    """
    if observations.sensor not in model.noise_mixtures:
        return None
    poses = PoseResiduals.of(observations)
    noise = expected_noise(model, observations.sensor, dataset)
    return contradictions(poses, noise, covariance_of(model, poses.names))


def most_expected(poses: int, share: float) -> int:
    """Return the least k with P(X > k) < 1e-3, X ~ Binomial(poses, share).

    Args:
        share: g, between 0 and 1, ends excluded.
    """
    left = 1.0
    for k in range(poses + 1):
        ways = lgamma(poses + 1) - lgamma(k + 1) - lgamma(poses - k + 1)
        left -= exp(ways + k * log(share) + (poses - k) * log1p(-share))
        if left < _ACCIDENT:
            return k
    return poses
