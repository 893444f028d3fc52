"""A self-model held against what its cameras saw of the hand (thesis sections 7.3, 8.3)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.observations.matching import check_markers
from nico_selfmodel.estimation.observations.pixel_observations import (
    PixelObservations,
    columns_of,
    seen_points,
)
from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.model.self_model import SelfModel


@dataclass(frozen=True, eq=False)
class PixelEvaluation:
    """Predicted pixels and points beside those that the cameras found."""

    observations: PixelObservations
    """What was seen."""
    pixels_predicted: NDArray
    """Nan where the model puts the hand out of a camera's view [px]. Shape (N, 4)."""
    p_LH_predicted: NDArray
    """Where the model puts the hand [m]. Shape (N, 3)."""
    p_LH_seen: NDArray
    """Where the model's own cameras reconstruct it; nan without both cameras [m]. Shape (N, 3)."""

    def select(self, keep: NDArray) -> "PixelEvaluation":
        """Return the chosen rows. `keep` is a boolean mask or an index."""
        return PixelEvaluation(
            self.observations.select(keep),
            self.pixels_predicted[keep],
            self.p_LH_predicted[keep],
            self.p_LH_seen[keep],
        )

    @property
    def pose_count(self) -> int:
        """How many poses the rows are of; several markers share one."""
        return len(self.observations.arm.poses)

    @property
    def residuals(self) -> NDArray:
        """Measured minus predicted pixels [px]. Shape (N, 4)."""
        return self.observations.pixels - self.pixels_predicted

    @property
    def pixel_distances(self) -> NDArray:
        """Errors of both cameras' observations, eq. 7.4 against the tracker [px]. Shape (n,)."""
        distances = np.linalg.norm(self.residuals.reshape(-1, 2), axis=1)
        return distances[np.isfinite(distances)]

    @property
    def pixels_by_pose(self) -> NDArray:
        """Mean error of each pose over what both cameras saw there [px]. Shape (poses,)."""
        distances = np.linalg.norm(self.residuals.reshape(-1, 2, 2), axis=2)
        seen = np.isfinite(distances)
        mean = np.where(seen, distances, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
        return self.observations.arm.by_pose(mean, seen.any(axis=1))

    @property
    def distances(self) -> NDArray:
        """Distances of predicted points from the cameras' own [m]. Shape (n,).

        The thesis' 3D error. It is no external truth: cameras and arm that err alike look perfect.
        """
        distances = np.linalg.norm(self.p_LH_predicted - self.p_LH_seen, axis=1)
        return distances[np.isfinite(distances)]

    @property
    def pixel_statistics(self) -> ErrorStatistics | None:
        """Summary of `pixel_distances`; None without any [px]."""
        found = self.pixel_distances
        return ErrorStatistics.from_distances(found) if len(found) else None

    @property
    def statistics(self) -> ErrorStatistics | None:
        """Summary of `distances`; None without any."""
        found = self.distances
        return ErrorStatistics.from_distances(found) if len(found) else None


def evaluate_pixels(model: SelfModel, dataset: Dataset) -> PixelEvaluation:
    """Hold a self-model against what its cameras saw.

    Args:
        model: Arm and cameras, the left one at the world.
        dataset: Encoder readings and pixels, of the same joints in any order.

    Raises:
        DataError: If joints, units or markers differ, or nothing was seen.
        ModelError: If the model lacks arm or cameras.
    """
    rig = model.rig
    dataset = columns_of(model, dataset)
    seen = np.isfinite(dataset.pixels).any(axis=1) & (dataset.mirror == "")
    check_markers(model, dataset, seen)
    observations = PixelObservations.from_dataset(dataset, model.markers)
    index = np.array([model.chain.marker_index(m) for m in observations.arm.markers])
    q = (observations.arm.angles - model.servos.offset) / model.servos.gear
    p_LH = model.points(q, index[observations.arm.marker], observations.arm.approach)
    sigma = model.pixel_sigma or 1.0
    return PixelEvaluation(
        observations, rig.project(p_LH), p_LH, seen_points(observations, rig, sigma)
    )
