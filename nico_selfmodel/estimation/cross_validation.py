"""Errors on poses that a model has not seen, from the training data alone."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.pinned_refinement import PinnedSolution, dh_program
from nico_selfmodel.model import DhParameters

FOLDS = 5


def cross_validate(
    observations: Observations, solved: PinnedSolution, sigma: float, folds: int = FOLDS
) -> NDArray:
    """Predict each pose by a model refined without its fold.

    Whole poses are left out, in turn; outliers take no part. Each fold starts from the solution of
    all data, whose minimum it shares.

    Args:
        observations: The training data.
        solved: The solution of all of it.
        sigma: Whitening of the residuals [m].
        folds: Number of folds.

    Returns:
        Errors of the believed rows [m]; empty where a fold would leave too few equations.
    """
    believed = observations.select(~solved.outliers)
    poses = np.unique(believed.sample)
    fold_of = dict(zip(poses.tolist(), (np.arange(len(poses)) % folds).tolist(), strict=True))
    fold = np.array([fold_of[int(pose)] for pose in believed.sample])
    fewest = min((int(np.sum(fold != k)) for k in range(folds)), default=0)
    if len(poses) < folds or 3 * fewest <= len(solved.free):
        return np.zeros(0)
    errors = np.zeros(len(believed))
    for k in range(folds):
        kept, left = believed.select(fold != k), believed.select(fold == k)
        parameters = _refit(kept, solved, sigma)
        predicted = parameters.predict(left.angles, left.marker)[0]
        errors[fold == k] = np.linalg.norm(predicted - left.p_WH, axis=1)
    return errors


def _refit(observations: Observations, solved: PinnedSolution, sigma: float) -> DhParameters:
    program = dh_program(observations, solved.parameters, solved.free, sigma)
    return solved.parameters.with_values(program.solve(max_iterations=30, tolerance=1e-6).x)
