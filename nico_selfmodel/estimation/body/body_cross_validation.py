"""Errors of arm and cameras on poses they have not seen, from the training data alone."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.body.arm_parameters import ArmParameters
from nico_selfmodel.estimation.body.seen_body import SeenBody
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations, seen_points
from nico_selfmodel.estimation.results.folds import FOLDS, Fold, cross_validate, fold_of, splits
from nico_selfmodel.estimation.tree.bending_tree import TreeBend
from nico_selfmodel.estimation.tree.tree_errors import WithoutFold
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem


def cross_validate_body(
    found: TreeBend, seen: SeenBody, outliers: NDArray, pixel_sigma: float
) -> PixelEvaluation | None:
    """Predict each pose by arm and cameras refined without its fold.

    Whole poses are left out, in turn; outliers take no part, boards all of it.

    Args:
        found: The solution of all data.
        outliers: Rows of the hand that are outliers. Boolean, shape (N,).
        pixel_sigma: Standard deviation of a pixel [px].

    Returns:
        Inlier rows beside predictions that never saw them, without those that depend on what their
        own fold alone tells; None with too few poses.
    """
    inliers = seen.pixels.select(~outliers)
    fold = fold_of(inliers.arm.pose)
    fewest = min((int(inliers.seen[part.rest].sum()) for part in splits(fold)), default=0)
    if fold.max(initial=0) < FOLDS - 1 or fewest <= len(found.problem.free_names):
        return None
    by_row = np.full(len(outliers) + 1, -1)
    by_row[:-1][~outliers] = fold
    of_scalars = by_row[seen.row][found.problem.observations.row]
    without = WithoutFold(found.problem, found.solution)
    predict = partial(_predicted, found.problem, inliers, pixel_sigma)
    number = np.flatnonzero(~outliers)

    def learn(part: Fold) -> tuple[NDArray, NDArray]:
        values, told = without.learn(Fold(part.number, of_scalars == part.number))
        alone = seen.row[found.problem.observations.row[~told]]
        return values, ~np.isin(number, alone)

    try:
        said = cross_validate(fold, learn, predict)
    except ValueError:  # cameras without a fold that are no cameras
        return None
    evaluation = PixelEvaluation(inliers, said[:, :4], said[:, 4:7], said[:, 7:10])
    told = said[:, 10] > 0.0
    return evaluation if told.all() else evaluation.select(np.flatnonzero(told))


def _predicted(
    problem: TreeProblem,
    inliers: PixelObservations,
    pixel_sigma: float,
    learned: tuple[NDArray, NDArray],
    part: Fold,
) -> NDArray:
    """Return pixels, p_LH and what its cameras rebuild, of a fold, and 1 where others tell it."""
    values, told = learned
    parameters = problem.residuals.parameters
    assert isinstance(parameters, ArmParameters)
    left = inliers.select(part.left)
    arm, rig = parameters.arm_of(values), parameters.rig_of(values)
    p_LH = left.arm.predicted(arm)[0]
    points = seen_points(left, rig, pixel_sigma)
    return np.column_stack([rig.project(p_LH), p_LH, points, told[part.left]])
