"""The noise of one tracker and of the joints, from the residuals of an arm."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.noise.variance_components import (
    LEAST_OF_ALL,
    LinearResiduals,
    VarianceSearch,
)

_LEAST_SHARE = 0.02
"""Part of the residuals below which a standard deviation counts as none."""
_INSEPARABLE = 60
"""Poses of a single point below which sensor and joints can hardly be told apart ..."""
_LEAST_SENSOR_SHARE = 0.1
"""... and the part of the residuals that the sensor then has at least."""


def most_likely_noise(
    residuals: LinearResiduals,
    start: PoseNoise,
    known: NDArray,
    *,
    apart: bool = False,
) -> PoseNoise:
    """Estimate the standard deviations of the sensor and of the joints.

    Args:
        start: Where the search begins.
        known: Variance of each joint angle that is known beforehand, as of counting [rad^2]. (n,).
        apart: Take one standard deviation for each joint where they are likelier than one for all
            by more than their number explains (BIC).

    Returns:
        The noise; the joints' standard deviations include what is known.
    """
    n = len(known)
    sensor, free = np.array([start.sensor_sigma]), np.zeros(1, dtype=bool)
    floors = np.array(_floors(residuals, sensor, start.joint_sigma))

    def search(group: NDArray) -> VarianceSearch:
        floor = floors[[0, *np.ones(group.max() + 1, dtype=int)]]
        return VarianceSearch(residuals, known, group, floor, free)

    together = search(np.zeros(n, dtype=int)).run(sensor, start.joint_sigma)
    chosen = together
    if n > 1 and apart:
        each = search(np.arange(n)).run(together.sensor, together.joint)
        worth = (n - 1) * np.log(residuals.groups.poses)
        chosen = each if 2.0 * (each.likelihood - together.likelihood) > worth else together
    return PoseNoise(float(chosen.sensor[0]), chosen.joint)


def _floors(residuals: LinearResiduals, sensor: NDArray, joint: NDArray) -> tuple[float, float]:
    """Return the least standard deviations of a coordinate and of a joint [rad]."""
    groups = residuals.groups
    left = residuals.left(sensor, joint)[groups.rows]
    lever = np.sqrt(np.mean(np.sum(residuals.by_angle[groups.rows] ** 2, axis=1)))
    single = len(groups.rows) == groups.poses < _INSEPARABLE
    share = _LEAST_SENSOR_SHARE if single else _LEAST_SHARE
    # Where most is exact, outliers would take all noise with them, and the floor with it.
    least = max(LEAST_OF_ALL * float(np.sqrt(np.mean(residuals.by_row[groups.rows] ** 2))), 1e-12)
    floor = float(np.sqrt(np.mean(left**2)))
    joint_floor = max(_LEAST_SHARE * floor, least) / max(float(lever), 1e-12)
    return max(share * floor, least), joint_floor
