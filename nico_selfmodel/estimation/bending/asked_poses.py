"""Which poses are asked what bends, and what may be the vertical."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.optimization.losses import robust_scale

MOST_ROWS = 500
"""Rows that are asked; all of them then tell the arm."""
ENOUGH_POSES = 150
"""Poses that are asked where they have more rows: noise of joints is that of a pose, so that many
rows of few poses tell little."""
FEWEST_POSES = 15
"""Poses, in twice as many coordinates as rigid parameters, below which nothing is asked."""
_APART = np.cos(np.radians(15.0))
"""Directions nearer than this are one vertical: as much of error costs nothing."""


def certain_outliers(observations: Observations, solved: ArmSolution, sure: float) -> NDArray:
    """Return the outliers of a rigid arm that are so many of its scales off. Boolean, (N,)."""
    p = solved.parameters.points(observations.angles, observations.marker, observations.approach)
    missed = np.linalg.norm(p - observations.p_WH, axis=1)
    scale = robust_scale(missed[~solved.outliers], 3)
    return np.asarray(solved.outliers & (missed > sure * scale))


def thinned(
    observations: Observations, solved: ArmSolution, outliers: NDArray, seed: int
) -> tuple[Observations, ArmSolution, NDArray]:
    """Return as many whole poses, drawn at random, as tell an effect, the arm, and what counts."""
    if len(observations) <= MOST_ROWS:
        return observations, solved, ~outliers
    chosen = np.isin(observations.pose, drawn_poses(observations.pose, seed))
    arm = replace(solved, outliers=solved.outliers[chosen])
    return observations.select(chosen), arm, ~outliers[chosen]


def drawn_poses(pose: NDArray, seed: int) -> NDArray:
    """Return the poses that are asked, drawn at random; all where they are few.

    Args:
        pose: Pose of each row. Shape (N,).
    """
    poses = np.unique(pose)
    if len(pose) <= MOST_ROWS:
        return poses
    count = max(int(MOST_ROWS / len(pose) * len(poses)), ENOUGH_POSES)
    return np.random.default_rng((seed, 5)).permutation(poses)[:count]


def mean_by_pose(errors: NDArray, pose: NDArray) -> NDArray:
    """Return the mean error of each pose, with a floor that no logarithm runs away at. (P,)."""
    of = np.unique(pose, return_inverse=True)[1]
    mean = np.bincount(of, errors) / np.bincount(of)
    return np.maximum(mean, 0.05 * float(np.median(mean)) + 1e-12)


def verticals(first: NDArray) -> tuple[tuple[NDArray, bool], ...]:
    """Return what may be the vertical, its sense not certain.

    The first axis, and where that is not z the axes of W: z, then those of trackers with y or x up.

    Args:
        first: Direction of the first axis. Shape (3,).
    """
    x, y, z = np.eye(3)
    found = [first * (1.0 if first @ z >= 0.0 else -1.0)]
    if found[0] @ z <= _APART:
        found += [axis for axis in (z, y, x) if abs(first @ axis) <= _APART]
    return tuple((up, False) for up in found)
