"""The self-model that a solution makes, with what it remembers of its training."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.noise.arm_solution import ArmSolution
from nico_selfmodel.estimation.noise.pose_noise import POSE_NOISE
from nico_selfmodel.estimation.noise.training_noise import with_training_noise
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.provenance import data_named, package_versions
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel


def learned_model(
    solved: ArmSolution,
    dataset: Dataset,
    name: str,
    nominal: NominalArm | None,
    fit: dict[str, Any],
) -> SelfModel:
    """Assemble the self-model with covariance, noise and provenance.

    Args:
        nominal: The robot, if one was given.
    """
    covariance = None
    if solved.uncertainty is not None:
        uncertainty = solved.uncertainty
        covariance = ParameterCovariance(uncertainty.names, uncertainty.covariance)
    model = SelfModel(
        name,
        solved.parameters.table,
        solved.parameters.servos,
        covariance,
        solved.noise_sigma,
        dict(nominal.source) if nominal else {},
        fit,
        {**data_named(dataset), **package_versions("drake")},
        bending=solved.parameters.bending,
    )
    rows = Observations.from_dataset(dataset, model.markers)
    return with_training_noise(model, dataset, "points", rows.sample[solved.outliers])


def training_of(
    dataset: Dataset, observations: Observations, solved: ArmSolution, unseen: NDArray
) -> dict[str, Any]:
    """Return what tells later whether a model is used beyond what it was trained for.

    Args:
        unseen: Errors in cross-validation [m]; those of the training are taken where there are
            none. Shape (K,).

    Returns:
        Rows, the noise, the median error of a pose to expect with the number of poses behind it,
        and the range of every encoder's readings.
    """
    inliers = observations.select(~solved.outliers)
    if not len(unseen):
        predicted = solved.parameters.points(inliers.angles, inliers.marker, inliers.approach)
        unseen = np.linalg.norm(predicted - inliers.p_WH, axis=1)
    swept = dataset.sweep[inliers.rows] != ""
    errors = inliers.by_pose(unseen, swept if swept.all() else ~swept)
    readings = dataset.encoders[observations.rows]
    ranges = np.stack([readings.min(axis=0), readings.max(axis=0)], axis=1).tolist()
    return {
        "rows": len(observations),
        "expected_error": {"n": len(errors), "median_m": float(np.median(errors))},
        "readings": dict(zip(dataset.joint_names, ranges, strict=True)),
        **({} if solved.noise is None else {POSE_NOISE: solved.noise.as_plain()}),
    }
