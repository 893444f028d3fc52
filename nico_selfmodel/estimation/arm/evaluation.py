"""A self-model held against measured points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.observations.matching import check_markers, reading_columns
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.sight_spread import SightSpread
from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.model.arm.dh_parameters import slopes_by_angle
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT

_ROUNDING_M = 1e-9
"""Errors below this are rounding, not noise [m]."""

_PIECE = 4000
"""Rows that are predicted at once: their derivatives take a hundred times as much memory."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A self-model held against measured points."""

    observations: Observations
    """What was measured."""
    p_WH_predicted: NDArray
    """What the model says [m]. Shape (N, 3)."""
    covariance: NDArray | None = None
    """Of each point about its prediction as the model expects it, noise included [m^2]; None where
    it does not know how well it knows itself, as after circle points alone. Shape (N, 3, 3)."""

    @property
    def residuals(self) -> NDArray:
        """Measured minus predicted [m]. Shape (N, 3)."""
        return self.observations.p_WH - self.p_WH_predicted

    @property
    def distances(self) -> NDArray:
        """Euclidean errors [m]. Shape (N,)."""
        return np.linalg.norm(self.residuals, axis=1)

    @property
    def outliers(self) -> NDArray:
        """Points further off than the model's own uncertainty and noise can explain. Shape (N,)."""
        if self.covariance is None:
            return np.zeros(len(self.observations), dtype=bool)
        expected = self.covariance + _ROUNDING_M**2 * np.eye(3)
        solved = np.linalg.solve(expected, self.residuals[:, :, None])[:, :, 0]
        return np.sum(self.residuals * solved, axis=1) > OUTLIER_AT**2

    @property
    def statistics(self) -> ErrorStatistics:
        """Summary of `distances`."""
        return ErrorStatistics.from_distances(self.distances)


def evaluate(model: SelfModel, dataset: Dataset, spread: SightSpread | None = None) -> Evaluation:
    """Hold a self-model against a data set.

    Args:
        dataset: Encoder readings and measured points, of the same joints in any order.
        spread: Of points that cameras reconstructed, as the model was learned from.

    Raises:
        DataError: If joints, units or markers differ, or nothing was measured.
    """
    columns = reading_columns(model, dataset)
    check_markers(model, dataset, dataset.measured)
    observations = Observations.from_dataset(dataset, model.markers)
    readings = dataset.encoders[observations.rows][:, columns]
    approach = dataset.approach[observations.rows][:, columns]
    points, covariances = [], []
    for first in range(0, len(readings), _PIECE):
        piece = slice(first, first + _PIECE)
        own, marker = readings[piece], observations.marker[piece]
        prediction = model.predict(own, marker, approach[piece])
        points.append(prediction.p_WH)
        covariances.append(expected_covariance(model, own, marker, prediction.covariance))
    known = covariances[0] is not None
    expected = np.concatenate(covariances) if known else None
    noise = PoseNoise.of(model)
    if spread is not None and expected is not None and noise is not None:
        beyond = spread.covariances(np.concatenate(points), observations.p_WH) - np.eye(3)
        expected = expected + noise.sensor_sigma**2 * beyond
    return Evaluation(observations, np.concatenate(points), expected)


def expected_covariance(
    model: SelfModel, readings: NDArray, marker: NDArray, known: NDArray | None
) -> NDArray | None:
    """Return the covariance of measured points about their predictions [m^2].

    Args:
        readings: Of its joints, in its units. Shape (N, n).
        marker: Index of each row's marker. Shape (N,).
        known: Covariance of the predictions themselves, if the model has one. Shape (N, 3, 3).

    Returns:
        What is uncertain about the model and the noise that its training showed, shape (N, 3, 3);
        None where it does not know how well it knows itself.
    """
    noise = noise_at(model, readings, marker)
    return None if known is None or noise is None else known + noise


def noise_at(model: SelfModel, readings: NDArray, marker: NDArray) -> NDArray | None:
    """Return the covariance of what sensor and joints add to each point [m^2].

    Args:
        readings: Of its joints, in its units. Shape (N, n).
        marker: Index of each row's marker. Shape (N,).

    Returns:
        Shape (N, 3, 3); None where the model does not say.
    """
    noise = PoseNoise.of(model)
    if noise is None:
        sigma = model.noise_sigma
        return None if sigma is None else np.tile(sigma**2 * np.eye(3), (len(readings), 1, 1))
    parameters = model.parameters
    jacobian = parameters.predict(model.servos.to_radians(readings), marker)[1]
    return noise.covariance(slopes_by_angle(parameters, jacobian))
