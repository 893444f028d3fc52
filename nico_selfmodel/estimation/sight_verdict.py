"""PASS, FAIL or NOT_EVALUATED for a self-model held against what its eyes saw."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation.arm_verdict import beside_training
from nico_selfmodel.estimation.error_statistics import Evaluation, expected_covariance
from nico_selfmodel.estimation.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.sightings import JOINT_SIGMA, covariance_of, sightings_of
from nico_selfmodel.estimation.verdict import FEWEST_COMPARED, Verdict, significantly_above
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT


def judge_sight(model: SelfModel, dataset: Dataset, evaluation: PixelEvaluation) -> Verdict:
    """Judge a self-model by new sightings, against the errors that its training lets expect.

    Args:
        model: Arm and eyes.
        dataset: What the eyes saw.
        evaluation: The model, held against it.

    Returns:
        FAIL where an error, in space or in the images, is significantly above what was expected,
        or many rows are further off than model and noise explain; NOT_EVALUATED where the model
        does not say what to expect, or the poses are too few.
    """
    compared = _compared(model, evaluation)
    if not compared:
        return Verdict("NOT_EVALUATED", ("there is too little to compare the error with",))
    found = " and ".join(words for words, _, _ in compared)
    expected = " and ".join(words for _, words, _ in compared)
    wrong = _contradicting(model, dataset, evaluation)
    rows, above = evaluation.observations.arm, any(above for _, _, above in compared)
    medians = f"median {found}, expected {expected}"
    return beside_training(medians, rows, wrong, "sightings", above=above)


def _compared(model: SelfModel, evaluation: PixelEvaluation) -> list[tuple[str, str, bool]]:
    """Return median and expected median of each kind of error in words, and whether it is above."""
    expected = model.fit.get("expected_error") or {}
    both = evaluation.select(np.flatnonzero(np.isfinite(evaluation.p_LH_seen).all(axis=1)))
    compared = []
    for errors, poses, key, scale, unit in (
        (evaluation.distances, both.pose_count, "median_m", 1e3, "mm"),
        (evaluation.pixel_distances, evaluation.pose_count, "median_px", 1.0, "px"),
    ):
        if key not in expected or min(expected["n"], poses, len(errors)) < FEWEST_COMPARED:
            continue
        median = float(expected[key])
        # What a pose shows twice, to both eyes or at two points, is one witness.
        above = significantly_above(errors, median, poses, expected["n"])
        said = [f"{scale * value:.2f} {unit}" for value in (float(np.median(errors)), median)]
        compared.append((said[0], said[1], above))
    return compared


def _contradicting(model: SelfModel, dataset: Dataset, evaluation: PixelEvaluation) -> NDArray:
    """Return the rows that neither model nor noise explains. Boolean, shape (N,).

    Where the model puts the hand out of the view of an eye that saw it, nothing explains that.
    Pixels are whitened with all that is uncertain where the model tells joint play from the
    tracker's noise; points that its eyes rebuild are taken where it has learned from such.
    """
    lost = (evaluation.observations.seen & np.isnan(evaluation.pixels_predicted)).any(axis=1)
    if JOINT_SIGMA in model.fit and model.pixel_sigma is not None:
        sightings = sightings_of(model, dataset, "pixels")
        found = sightings.innovations(covariance_of(model, sightings.names))
        return lost | (np.sqrt(found.nis) > OUTLIER_AT * np.sqrt(found.dof / 3.0))
    rows = evaluation.observations.arm
    readings = rows.angles / model.servos.radians_per_unit
    known = model.predict(readings, rows.marker).covariance
    expected = expected_covariance(model, readings, rows.marker, known)
    rebuilt = replace(rows, p_WH=evaluation.p_LH_seen)
    return lost | Evaluation(rebuilt, evaluation.p_LH_predicted, expected).outliers
