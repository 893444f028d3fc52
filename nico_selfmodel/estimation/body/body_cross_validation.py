"""Errors of arm and cameras on poses they have not seen, from the training data alone."""

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.body.body_problem import BodyProblem, BodySolution
from nico_selfmodel.estimation.noise.arm_solution import Priors
from nico_selfmodel.estimation.observations.arm_views import DhArm
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.observations.pixel_observations import (
    PixelObservations,
    seen_points,
)
from nico_selfmodel.estimation.results.folds import FOLDS, fold_of, splits
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.cameras.stereo_rig import StereoRig


def cross_validate_body(
    observations: PixelObservations,
    parameters: DhParameters,
    solved: BodySolution,
    free: frozenset[str],
    boards: BoardViews | None,
    whitened: bool,
    priors: Priors | None = None,
) -> PixelEvaluation | None:
    """Predict each pose by arm and cameras refined without its fold.

    Whole poses are left out, in turn; outliers take no part. Each fold starts from the solution of
    all data, with its variances.

    Args:
        observations: The training data.
        parameters: The arm.
        solved: Cameras, variances and outliers.
        free: Parameters that were estimated.
        boards: Corners in the same problem, if any.
        whitened: Whether the pixels are weighed by the variances.
        priors: Of numbers that bend.

    Returns:
        Inlier rows beside predictions that never saw them; None with too few poses.
    """
    inliers = observations.select(~solved.outliers)
    fold = fold_of(inliers.arm.pose)
    fewest = min((int(inliers.seen[rest].sum()) for rest, _ in splits(fold)), default=0)
    if fold.max(initial=0) < FOLDS - 1 or fewest <= len(free):
        return None
    pixels = np.full(inliers.pixels.shape, np.nan)
    predicted, seen = np.full((2, len(inliers), 3), np.nan)
    for rest, rows in splits(fold):
        kept, left = inliers.select(rest), inliers.select(rows)
        view = DhArm(kept.arm, parameters)
        problem = BodyProblem(kept, view, solved.rig, boards, {}, solved.X_LG)
        for name in problem.hand.names:
            if name not in free:
                problem.program.fix(name)
        for name, known in (priors or {}).items():
            problem.program.add_prior(name, *known)
        x = problem.solve_weighed(solved.noise if whitened else None)
        split = len(view.names)
        p_LH = DhArm(left.arm, parameters).evaluate(x[:split])[0].T
        try:
            of_cameras, size = x[split : split + len(solved.rig.names)], solved.rig.left.image_size
            rig = StereoRig.from_values(of_cameras, size, solved.rig.lens)
        except ValueError:
            return None
        pixels[rows], predicted[rows] = rig.project(p_LH), p_LH
        seen[rows] = seen_points(left, rig, solved.noise.sensor_sigma)
    return PixelEvaluation(inliers, pixels, predicted, seen)
