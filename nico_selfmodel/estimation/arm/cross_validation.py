"""Errors on poses that a model has not seen, from the training data alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised, information_of
from nico_selfmodel.estimation.noise.pose_refinement import PoseWhitened, arm_program
from nico_selfmodel.estimation.noise.pose_sums import PoseSums
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.folds import FOLDS, Fold, cross_validate, splits, told_step
from nico_selfmodel.model.arm.dh_parameters import DhParameters

_LARGEST_STEP = 0.3
"""Change of the other poses' residuals, in their standard deviations, up to which one step does."""
_SHIFT, _NO_PART = 1e-4, 1e-2
"""How far what a fold alone tells is moved [rad or m], and the share of it that counts as none."""


def cross_validate_arm(
    observations: Observations, solved: ArmSolution, sums: PoseSums | None = None
) -> NDArray:
    """Predict each pose by a model refined without its fold.

    Whole poses are left out, in turn; outliers take no part. The minimum without a fold is one
    Gauss-Newton step from that of all: dx = -(H - H_f)^-1 U_f' u_f, whitened by pose.

    Args:
        sums: What the inlier rows say at it; worked out if omitted.

    Returns:
        Errors of the inlier rows [m], nan where they depend on what their own fold alone tells;
        empty where a fold would leave too few equations.
    """
    if solved.noise is None:
        return np.zeros(0)
    if sums is None:
        known = (solved.parameters, solved.free, ~solved.outliers, solved.noise)
        sums = PoseSums.of(observations, *known, FOLDS)
    inliers, fold = observations.select(~solved.outliers), sums.fold
    fewest = min((int(part.rest.sum()) for part in splits(fold)), default=0)
    if fold.max(initial=0) < FOLDS - 1 or 3 * fewest <= len(solved.free):
        return np.zeros(0)
    without = _WithoutFold(inliers, solved, sums)
    return cross_validate(fold, without.learn, without.errors)


@dataclass(frozen=True, eq=False)
class _WithoutFold:
    """Arms refined without a fold, and what they say of it."""

    inliers: Observations
    solved: ArmSolution
    sums: PoseSums

    def learn(self, part: Fold) -> tuple[DhParameters, NDArray]:
        """Return the arm that the other folds tell, and the directions that they do not. (p, e)."""
        sums, chosen, solved = self.sums, self._chosen, self.solved
        known = np.diag(information_of(solved.parameters, chosen, solved.priors))
        size = np.sqrt(np.diag(sums.H.sum(axis=0) + known))
        others = np.arange(len(sums.H)) != part.number
        rest = sums.H[others].sum(axis=0) + known
        # At the minimum of all, the gradient of the rest, -U'u, is the fold's own U'u.
        step, open_ways = told_step(rest, sums.g[part.number], size)
        parameters = self._moved(solved.parameters, step)
        if step @ rest @ step > _LARGEST_STEP**2 * sums.coordinates[others].sum():
            parameters = _refit(self.inliers.select(part.rest), parameters, solved)
        return parameters, open_ways

    def errors(self, learned: tuple[DhParameters, NDArray], part: Fold) -> NDArray:
        """Return the errors of a fold [m], nan where they hang on what it alone tells. (n,)."""
        parameters, open_ways = learned
        left = self.inliers.select(part.left)
        predicted = parameters.points(left.angles, left.marker, left.approach)
        errors = np.linalg.norm(predicted - left.p_WH, axis=1)
        for way in open_ways.T:
            moved = self._moved(parameters, _SHIFT * way / np.abs(way).max())
            there = moved.points(left.angles, left.marker, left.approach)
            errors[np.linalg.norm(there - predicted, axis=1) > _NO_PART * _SHIFT] = np.nan
        return np.asarray(errors)

    @property
    def _chosen(self) -> list[int]:
        names = self.solved.parameters.names
        return [i for i, name in enumerate(names) if name in self.solved.free]

    def _moved(self, parameters: DhParameters, step: NDArray) -> DhParameters:
        values = parameters.values.copy()
        values[self._chosen] += step
        return parameters.with_values(values)


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
