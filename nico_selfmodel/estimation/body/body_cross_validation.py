"""Errors of arm and cameras on poses they have not seen, from the training data alone."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.body.arm_parameters import ArmParameters
from nico_selfmodel.estimation.body.seen_body import SeenBody
from nico_selfmodel.estimation.observations.arm_views import DhArm
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.observations.pixel_observations import seen_points
from nico_selfmodel.estimation.results.folds import FOLDS, fold_of, splits
from nico_selfmodel.estimation.tree.bending_tree import TreeBend
from nico_selfmodel.estimation.tree.tree_errors import without_folds


def cross_validate_body(
    found: TreeBend, seen: SeenBody, outliers: NDArray, pixel_sigma: float
) -> PixelEvaluation | None:
    """Predict each pose by arm and cameras refined without its fold.

    Whole poses are left out, in turn; outliers take no part, boards all of it.

    Args:
        found: The solution of all data.
        seen: The training data.
        outliers: Rows of the hand that are outliers. Boolean, shape (N,).
        pixel_sigma: Standard deviation of a pixel [px].

    Returns:
        Inlier rows beside predictions that never saw them, without those that depend on what their
        own fold alone tells; None with too few poses.
    """
    inliers = seen.pixels.select(~outliers)
    fold = fold_of(inliers.arm.pose)
    fewest = min((int(inliers.seen[rest].sum()) for rest, _ in splits(fold)), default=0)
    if fold.max(initial=0) < FOLDS - 1 or fewest <= len(found.problem.free_names):
        return None
    by_row = np.full(len(outliers) + 1, -1)
    by_row[:-1][~outliers] = fold
    of_scalars = by_row[seen.row][found.problem.observations.row]
    parameters = found.problem.residuals.parameters
    assert isinstance(parameters, ArmParameters)
    pixels = np.full(inliers.pixels.shape, np.nan)
    predicted, points = np.full((2, len(inliers), 3), np.nan)
    folds = without_folds(found.problem, found.solution, of_scalars)
    alone, number = np.zeros(len(inliers), dtype=bool), np.flatnonzero(~outliers)
    for k, (_, values, told) in enumerate(folds):
        rows = fold == k
        left = inliers.select(rows)
        arm = parameters.arm_of(values)
        try:
            rig = parameters.rig_of(values)
        except ValueError:
            return None
        p_LH = DhArm(left.arm, arm).evaluate(arm.values)[0].T
        pixels[rows], predicted[rows] = rig.project(p_LH), p_LH
        points[rows] = seen_points(left, rig, pixel_sigma)
        by_fold = seen.row[found.problem.observations.row[~told]]
        alone |= rows & np.isin(number, by_fold)
    evaluation = PixelEvaluation(inliers, pixels, predicted, points)
    return evaluation.select(np.flatnonzero(~alone)) if alone.any() else evaluation
