"""Patterns that noise does not make: residuals that depend on the pose, or step with time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.model import DhParameters

_FEWEST = 20
"""Poses below which no pattern is looked for."""
_SURE_STEP = 30.0
"""Chi square of three coordinates: chance makes it once in 1000 recordings of 1000 poses."""
_NOTABLE_STEP = 1.1
"""And the ratio of the residuals without and with it."""
_ORDERED = 0.4
"""Correlation of successive readings above which place and time cannot be told apart."""


@dataclass(frozen=True, eq=False)
class Step:
    """A sudden shift of all measured points between two samples."""

    after: int
    """Last sample before it."""
    shift: NDArray
    """Mean residual after it less that before [m]. Shape (3,)."""


def pose_dependence(
    observations: Observations, residuals: NDArray, parameters: DhParameters
) -> float:
    """Return how surely residuals depend on the readings of some joint.

    Residuals, as angles of a joint, are ordered by its reading: noise makes neighbours independent
    (von Neumann 1941), a reading that jumps or a wrong gear makes them alike.

    Args:
        observations: Believed rows.
        residuals: Measured minus predicted [m]. Shape (N, 3).
        parameters: The arm.

    Returns:
        The largest standard score of all joints; -inf with too few rows.
    """
    if len(observations) < _FEWEST:
        return -np.inf
    jacobian = parameters.predict(observations.angles, observations.marker)[1]
    scores = []
    for i, joint in enumerate(observations.joints):
        arm = jacobian[:, :, parameters.names.index(f"{joint}.theta_offset")]
        length = np.linalg.norm(arm, axis=1)
        if length.max() <= 0.0:
            continue
        e = _ranks(np.sum(arm * residuals, axis=1) / np.maximum(length, 1e-3 * length.max()))
        e = e[np.argsort(observations.angles[:, i], kind="stable")]
        scores.append(np.sqrt(len(e)) * float(e[1:] @ e[:-1]) / float(e @ e))
    return max(scores, default=-np.inf)


def _ranks(values: NDArray) -> NDArray:
    """Return centred ranks: no single value can make a pattern."""
    return np.argsort(np.argsort(values, kind="stable"), kind="stable") - 0.5 * (len(values) - 1)


def step_in_time(observations: Observations, residuals: NDArray, free: NDArray) -> Step | None:
    """Find the sample after which all points are shifted, as when a tracker or a base was pushed.

    Only poses in no order are looked at: where poses follow each other along a path, an error
    that depends on the place looks the same.

    Args:
        observations: Believed rows; samples are numbered in the order of time.
        residuals: Measured minus predicted [m]. Shape (N, 3).
        free: Rows that belong to no sweep. Boolean, shape (N,).

    Returns:
        The step, or None where there is none that is sure and notable.
    """
    rows = np.flatnonzero(free)
    samples, first, of = np.unique(
        observations.sample[rows], return_index=True, return_inverse=True
    )
    n = len(samples)
    if n < _FEWEST or _in_order(observations.angles[rows][first]):
        return None
    count = np.bincount(of)
    mean = np.stack([np.bincount(of, residuals[rows, k]) / count for k in range(3)], axis=1)
    mean -= mean.mean(axis=0)
    before = np.arange(5, n - 4)
    sums = np.cumsum(mean, axis=0)[before - 1]
    explained = np.sum(sums**2, axis=1) * n / (before * (n - before))
    best = int(np.argmax(explained))
    total, k = float(np.sum(mean**2)), int(before[best])
    left = max(total - float(explained[best]), 1e-300)
    chi2 = float(explained[best]) / left * (3 * n - 6)
    if chi2 < _SURE_STEP or total < _NOTABLE_STEP**2 * left:
        return None
    return Step(int(samples[k - 1]), mean[k:].mean(axis=0) - mean[:k].mean(axis=0))


def _in_order(angles: NDArray) -> bool:
    """Return whether successive poses are alike in some joint."""
    centred = angles - angles.mean(axis=0)
    power = np.sum(centred**2, axis=0)
    alike = np.sum(centred[1:] * centred[:-1], axis=0) / np.where(power > 0.0, power, 1.0)
    return bool((alike > _ORDERED).any())
