"""What the poses of a training say of the noise of new ones: what `monitor` expects.

A solution has fitted some of the noise of its own poses. Each pose is therefore judged as if it had
had no part in the solution: with S what weighed it and M = J C J' what the solution made of it,

    r_without = S^1/2 (I - S^-1/2 M S^-1/2)^-1 S^-1/2 r

(the residual of a pose left out; Cook, Weisberg 1982). Poses that the solver set aside had no part
in it and are as they are: they are the tail of the noise.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.sweeps import find_sweeps
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.noise.hand_noise import noise_covariance
from nico_selfmodel.estimation.noise.hand_observations import covariance_of, hand_observations_of
from nico_selfmodel.estimation.noise.mixture_fit import most_likely_mixture
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.model.noise_mixture import LARGEST_SENSOR, NoiseMixture
from nico_selfmodel.model.self_model import SelfModel

FLOOR = {"points": 1e-4, "pixels": 0.1}
"""Least noise of a measured coordinate where the data state none [m, px]: below it what the model
leaves out, and rounding, would count as a change of the body."""
LEAST = {"points": 1e-6, "pixels": 1e-3}
"""No coordinate is measured better, whatever the data state [m, px]."""
_MOST_POSES = 2000
"""Poses beyond which more tell nothing new of the noise."""
_ENOUGH_FREE = 30
"""Poses besides those of sweeps that tell the noise without them."""
_LEAST_LEFT = 0.2
"""Least eigenvalue of the bracket: a pose that alone tells a parameter cannot be judged without."""


def with_training_noise(
    model: SelfModel,
    dataset: Dataset,
    sensor: str,
    outliers: NDArray,
    joint_sigma: NDArray | None = None,
) -> SelfModel:
    """Return a model that says what noise its training left, in `fit.noise`.

    Args:
        sensor: By which the poses are judged, `points` or `pixels`.
        outliers: Samples that the solver set aside. Shape (k,).
        joint_sigma: Noise of each joint that weighed the poses, where the model was fitted to
            points that were made of the pixels [rad]; what the model says of it if omitted. (n,).
    """
    observations = hand_observations_of(model, _judged(dataset), sensor)
    poses = PoseResiduals.of(observations)
    weighed = observations.noise.covariance(poses.by_angle)
    if joint_sigma is not None:
        weighed = noise_covariance(poses.by_angle, observations.noise.sensor_sigma, joint_sigma)
    fitted = poses.slopes @ covariance_of(model, poses.names) @ np.swapaxes(poses.slopes, 1, 2)
    own = without_itself(poses, fitted, weighed)
    aside = np.isin(poses.sample, outliers)
    own[aside] = poses.residuals[aside]
    limits = (_least_noise(sensor, _stated(dataset, sensor)), LARGEST_SENSOR[sensor])
    spread = max(float(np.std(observations.block.measured, axis=1).mean()), limits[0])
    noise = most_likely_mixture(own, poses.by_angle, poses.seen, fitted, limits, spread)
    known = {**model.fit.get("noise", {}), sensor: noise.as_document(sensor)}
    return replace(model, fit={**model.fit, "noise": known})


def _judged(dataset: Dataset) -> Dataset:
    """Return the poses that stand for new ones: no sweeps, where enough others are left.

    Poses of a sweep are neighbours, and what a model leaves out is alike there: a solution fits it
    better than anywhere else. A joint that sags was off by 0.07 mm on sweeps and 0.6 mm elsewhere.
    """
    samples, first = np.unique(dataset.sample, return_index=True)
    swept = dataset.sweep[first] != ""
    if not swept.any() and len(samples) <= _MOST_POSES:
        for sweep in find_sweeps(dataset.encoders[first]):
            swept[sweep.rows] = True
    if np.sum(~swept) >= _ENOUGH_FREE:
        samples = samples[~swept]
    if len(samples) > _MOST_POSES:
        samples = samples[np.linspace(0, len(samples) - 1, _MOST_POSES).astype(int)]
    return dataset.select(np.isin(dataset.sample, samples))


def expected_noise(model: SelfModel, sensor: str, dataset: Dataset | None = None) -> NoiseMixture:
    """Return the noise to expect of new measurements.

    Joint noise is the body's own, whatever measures it. A sensor that the body was not learned by
    is as good as the data state, or as `FLOOR`; one that is stated to be worse than it was is.

    Args:
        model: With the noise of its training.
        sensor: What measures, `points` or `pixels`.
        dataset: The measurements, for the noise that they state; none if omitted.

    Raises:
        ModelError: If the model does not say what noise its training left.
    """
    known = model.noise_mixtures
    if not known:
        raise ModelError(
            f"self-model {model.name!r} does not say what noise its training left (`fit.noise`): "
            "learn it anew from its data"
        )
    stated = None if dataset is None else _stated(dataset, sensor)
    if sensor in known:
        noise = known[sensor]
        least = LEAST[sensor] if stated is None else stated
    else:
        (noise,) = known.values()
        least = _least_noise(sensor, stated)
        noise = replace(noise, sensor_sigma=least, tail_sensor_sigma=2.0 * least)
    return replace(
        noise,
        sensor_sigma=max(noise.sensor_sigma, least),
        tail_sensor_sigma=max(noise.tail_sensor_sigma, 2.0 * least),
    )


def _stated(dataset: Dataset, sensor: str) -> float | None:
    return dataset.point_sigma_m if sensor == "points" else dataset.pixel_sigma_px


def _least_noise(sensor: str, stated: float | None) -> float:
    """Return the least noise that a measured coordinate may have [m or px]."""
    return max(LEAST[sensor], FLOOR[sensor] if stated is None else stated)


def without_itself(poses: PoseResiduals, fitted: NDArray, weighed: NDArray) -> NDArray:
    """Return each pose's residual had the pose had no part in the solution. Shape (N, K).

    Args:
        poses: At the solution.
        fitted: M, what the solution is uncertain by. Shape (N, K, K).
        weighed: S, what weighed the coordinates. Shape (N, K, K).
    """
    both = poses.seen[:, :, None] & poses.seen[:, None, :]
    s = np.where(both, weighed, np.eye(poses.seen.shape[1]))
    values, vectors = np.linalg.eigh(s)
    values = np.maximum(values, np.finfo(float).eps * values[:, -1:])
    root = (vectors * np.sqrt(values)[:, None]) @ np.swapaxes(vectors, 1, 2)
    inverse = (vectors / np.sqrt(values)[:, None]) @ np.swapaxes(vectors, 1, 2)
    share, turned = np.linalg.eigh(inverse @ np.where(both, fitted, 0.0) @ inverse)
    white = np.swapaxes(turned, 1, 2) @ (inverse @ poses.residuals[:, :, None])
    grown = white / np.maximum(1.0 - share, _LEAST_LEFT)[:, :, None]
    return (root @ (turned @ grown))[:, :, 0] * poses.seen
