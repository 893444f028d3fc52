"""Errors on poses that a model has not seen, from the training data alone."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised, information_of
from nico_selfmodel.estimation.noise.pose_refinement import PoseWhitened, arm_program
from nico_selfmodel.estimation.noise.pose_sums import PoseSums
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.folds import FOLDS, splits, told_step
from nico_selfmodel.model.arm.dh_parameters import DhParameters

_LARGEST_STEP = 0.3
"""Change of the other poses' residuals, in their standard deviations, up to which one step does."""
_SHIFT, _NO_PART = 1e-4, 1e-2
"""How far what a fold alone tells is moved [rad or m], and the share of it that counts as none."""


def cross_validate(observations: Observations, solved: ArmSolution, folds: int = FOLDS) -> NDArray:
    """Predict each pose by a model refined without its fold.

    Whole poses are left out, in turn; outliers take no part. The minimum without a fold is one
    Gauss-Newton step from that of all: dx = -(H - H_f)^-1 U_f' u_f, whitened by pose.

    Args:
        observations: The training data.
        solved: The solution of all of it.
        folds: Number of folds.

    Returns:
        Errors of the inlier rows [m], nan where they depend on what their own fold alone tells;
        empty where a fold would leave too few equations.
    """
    if solved.noise is None:
        return np.zeros(0)
    sums = PoseSums.of(
        observations, solved.parameters, solved.free, ~solved.outliers, solved.noise, folds
    )
    inliers, fold = observations.select(~solved.outliers), sums.fold
    fewest = min((int(rest.sum()) for rest, _ in splits(fold)), default=0)
    if fold.max(initial=0) < folds - 1 or 3 * fewest <= len(solved.free):
        return np.zeros(0)
    chosen = [i for i, name in enumerate(solved.parameters.names) if name in solved.free]
    known = np.diag(information_of(solved.parameters, chosen, solved.priors))
    size = np.sqrt(np.diag(sums.H.sum(axis=0) + known))
    errors = np.zeros(len(inliers))
    for k in range(folds):
        rest = sums.H[:k].sum(axis=0) + sums.H[k + 1 :].sum(axis=0) + known
        # At the minimum of all, the gradient of the rest, -U'u, is the fold's own U'u.
        step, open_ways = told_step(rest, sums.g[k], size)
        values = solved.parameters.values.copy()
        values[chosen] += step
        parameters = solved.parameters.with_values(values)
        if step @ rest @ step > _LARGEST_STEP**2 * sums.coordinates[np.arange(folds) != k].sum():
            parameters = _refit(inliers.select(fold != k), parameters, solved)
        left = inliers.select(fold == k)
        predicted = parameters.points(left.angles, left.marker, left.approach)
        errors[fold == k] = np.linalg.norm(predicted - left.p_WH, axis=1)
        for way in open_ways.T:
            moved = parameters.values.copy()
            moved[chosen] += _SHIFT * way / np.abs(way).max()
            there = parameters.with_values(moved).points(left.angles, left.marker, left.approach)
            off = np.linalg.norm(there - predicted, axis=1) > _NO_PART * _SHIFT
            errors[np.flatnonzero(fold == k)[off]] = np.nan
    return errors


def _refit(rest: Observations, start: DhParameters, solved: ArmSolution) -> DhParameters:
    """Return the arm refined without a fold, where one step goes too far to be straight."""
    assert solved.noise is not None
    everything = np.ones(len(rest), dtype=bool)
    linear = Linearised.at(rest, solved.parameters, everything, solved.noise)
    block = PoseWhitened(DhResiduals(rest, solved.parameters, 1.0), linear.whitening)
    program = arm_program(block, solved.parameters, solved.free)
    for name, (mean, sigma) in solved.priors.items():
        program.add_prior(name, mean, sigma)
    far = program.normal_equations(start.values)[0] > program.normal_equations(program.start)[0]
    if not far:
        program.move_start(start.values)
    return start.with_values(program.solve(max_iterations=20, tolerance=1e-6).x)
