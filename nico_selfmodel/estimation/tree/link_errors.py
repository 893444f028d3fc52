"""What mechanics leave of a marker's error in images: joints that are not where they are read.

A pixel's covariance by joint noise is S = A D^2 A' + s^2 I, with A its derivatives by the joints, D
their standard deviations, s the camera's. A deviation N(0, S) with standard deviations a, b along
the axes of S is (a r cos t, b r sin t), r of Rayleigh's distribution, whose mean is sqrt(pi / 2),
and t even: its mean length is sqrt(pi / 2) times the mean of |(a cos t, b sin t)| over t.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import TreeErrors
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters

_TURNS = 64
"""Directions over which lengths are averaged."""


@dataclass(frozen=True)
class LinkErrors:
    """How well a body expected the markers of one link in held-out images."""

    n: int
    """Observations."""
    mean_px: float
    """Mean distance from where it was expected [px]."""
    noise_px: float
    """Mean distance that joint noise and the cameras' leave, as the training told them [px]."""


def held_out_links(found: TreeCalibration) -> Mapping[str, LinkErrors]:
    """Return the held-out errors in images of the markers of each link, by its joint.

    Args:
        found: What was learned; nothing if nothing was held out.
    """
    if found.test is None:
        return {}
    distance, left = found.test.by_row(), _expected(found, found.test)
    on = np.array([marker.on for marker in found.tree.markers])
    link, out = on[found.test.observations.data.observations.marker], {}
    for i, joint in enumerate(found.tree.joints):
        own = (link == i) & np.isfinite(distance) & np.isfinite(left)
        if own.any():
            means = (float(np.mean(values[own])) for values in (distance, left))
            out[joint] = LinkErrors(int(own.sum()), *means)
    return out


def _expected(found: TreeCalibration, errors: TreeErrors) -> NDArray:
    """Return the mean error that noise leaves of each row; nan where no camera saw it. (N,)."""
    observations, parameters = errors.observations, TreeParameters(found.tree)
    linear = TreeResiduals(observations, parameters).linear(parameters.values_of(found.tree))
    training, noise = found.train.observations, found.solution.noise
    joints = dict(zip(training.noisy_joints, noise.joint.tolist(), strict=True))
    sensors = dict(zip(training.noise_groups, noise.sensor.tolist(), strict=True))
    sigma = np.array([joints.get(joint, 0.0) for joint in observations.noisy_joints])
    out = np.full(len(observations.data.observations), np.nan)
    for rows in observations.sensors:
        if rows.kind != CAMERA:
            continue
        own = sensors.get(observations.noise_groups[observations.noise_group[rows.first]], 0.0)
        A = linear.by_joint[rows.scalars].reshape(len(rows.rows), 2, -1) * sigma
        S = A @ np.swapaxes(A, 1, 2) + own**2 * np.eye(2)
        out[rows.rows] = mean_length(S)
    return out


def mean_length(S: NDArray) -> NDArray:
    """Return the mean length of deviations N(0, S). Shape (N, 2, 2) -> (N,)."""
    variances = np.maximum(np.linalg.eigvalsh(S), 0.0)
    t = np.linspace(0.0, 2.0 * np.pi, _TURNS, endpoint=False)
    lengths = np.sqrt(variances @ np.stack([np.cos(t) ** 2, np.sin(t) ** 2]))
    return np.asarray(np.sqrt(np.pi / 2.0) * lengths.mean(axis=1))
