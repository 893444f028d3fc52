"""Errors on poses that a model has not seen, from the training data alone."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised
from nico_selfmodel.estimation.noise.pose_refinement import PoseWhitened, arm_program
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.folds import FOLDS, fold_of, splits
from nico_selfmodel.model.arm.dh_parameters import DhParameters

_LARGEST_STEP = 0.3
"""Change of the other poses' residuals, in their standard deviations, up to which one step does."""


def cross_validate(observations: Observations, solved: ArmSolution, folds: int = FOLDS) -> NDArray:
    """Predict each pose by a model refined without its fold.

    Whole poses are left out, in turn; outliers take no part. The minimum without a fold is one
    Gauss-Newton step from that of all: dx = -(H - H_f)^-1 U_f' u_f, whitened by pose.

    Args:
        observations: The training data.
        solved: The solution of all of it.
        folds: Number of folds.

    Returns:
        Errors of the inlier rows [m]; empty where a fold would leave too few equations.
    """
    if solved.noise is None:
        return np.zeros(0)
    linear = Linearised.at(observations, solved.parameters, ~solved.outliers, solved.noise)
    groups = linear.whitening.groups
    U = linear.weights * linear.columns(solved.free)
    u = linear.weights[:, 0] * linear.whitened_residuals
    size = np.linalg.norm(U, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    fold_of_visit = fold_of(groups.place, folds)
    fold_of_row = fold_of_visit[groups.pose]
    fewest = min((int(rest.sum()) for rest, _ in splits(fold_of_row)), default=0)
    if fold_of_visit.max(initial=0) < folds - 1 or 3 * fewest <= len(solved.free):
        return np.zeros(0)
    fold = np.repeat(fold_of_visit, len(u) // groups.poses)
    inliers = observations.select(groups.rows)
    chosen = [i for i, name in enumerate(linear.names) if name in solved.free]
    errors = np.zeros(len(inliers))
    for k in range(folds):
        rest = U[fold != k] / size
        step = -np.linalg.lstsq(rest.T @ rest, (U[fold == k] / size).T @ u[fold == k], 1e-10)[0]
        values = solved.parameters.values.copy()
        values[chosen] += step / size
        parameters = solved.parameters.with_values(values)
        if np.sqrt(np.mean((rest @ step) ** 2)) > _LARGEST_STEP:
            parameters = _refit(inliers.select(fold_of_row != k), parameters, solved)
        left = inliers.select(fold_of_row == k)
        predicted = parameters.predict(left.angles, left.marker)[0]
        errors[fold_of_row == k] = np.linalg.norm(predicted - left.p_WH, axis=1)
    return errors


def _refit(rest: Observations, start: DhParameters, solved: ArmSolution) -> DhParameters:
    """Return the arm refined without a fold, where one step goes too far to be straight."""
    assert solved.noise is not None
    everything = np.ones(len(rest), dtype=bool)
    linear = Linearised.at(rest, solved.parameters, everything, solved.noise)
    block = PoseWhitened(DhResiduals(rest, solved.parameters, 1.0), linear.whitening)
    program = arm_program(block, solved.parameters, solved.free)
    far = program.normal_equations(start.values)[0] > program.normal_equations(program.start)[0]
    if not far:
        program.move_start(start.values)
    return start.with_values(program.solve(max_iterations=20, tolerance=1e-6).x)
