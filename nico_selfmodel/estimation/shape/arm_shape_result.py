"""Shapes of links that an arm moves, as a result: as good as the arm tells where these are."""

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.noise.joints_by_hand import JointsByHand
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels
from nico_selfmodel.estimation.results.calibration_result import CalibrationResult, Errors, Terms
from nico_selfmodel.estimation.shape.refinement import MOVING_STEPS
from nico_selfmodel.model.self_model import SelfModel

_TERMS = Terms(
    observed="poses",
    outlier_cause="is the arm another one than the self-model's, or are its joints looser?",
    worse_cause="the poses looked at do not cover where the arm is used",
)


def arm_shape_result(
    model: SelfModel, errors: JointsByHand, train: Dataset, test: Dataset | None
) -> CalibrationResult:
    """Return what a shape is judged by: where the hand was seen, and where the arm expected it.

    Args:
        model: Arm and cameras, which are left as they are.
        errors: Of the poses in which links were looked at.
        train: These poses.
        test: Held-out ones.
    """
    kept = errors.sample[errors.expected]
    return CalibrationResult(
        method="shape",
        parameters={},
        train=_errors(model, train.select(np.isin(train.sample, kept))),
        test=None if test is None else _errors(model, test),
        outliers=~errors.expected,
        outlier_names=tuple(errors.sample[~errors.expected].tolist()),
        converged=True,
        iterations=len(MOVING_STEPS),
        seconds=None,
        findings=(),
        details={},
        terms=_TERMS,
    )


def _errors(model: SelfModel, data: Dataset) -> Errors:
    """Return how far the hand was seen from where it was expected, in pixels and in space."""
    known = data.select(np.isin(data.marker, model.markers))
    seen = evaluate_pixels(model, known)
    compared = seen.pixels_by_pose
    return Errors(
        seen.distances, seen.pixel_distances, poses=len(compared), compared=compared, unit="px"
    )
