"""PASS, FAIL or NOT_EVALUATED for a self-model held against new data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.arm_findings import WHAT_CHANGED
from nico_selfmodel.estimation.arm.evaluation import Evaluation, expected_covariance
from nico_selfmodel.estimation.noise.contradictions import (
    WHERE_TO_LOOK,
    Contradictions,
    hand_contradictions,
)
from nico_selfmodel.estimation.noise.hand_observations import (
    JOINT_SIGMA,
    covariance_of,
    hand_observations_of,
)
from nico_selfmodel.estimation.observations.outlier_words import describe_outliers
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.estimation.results.calibration_result import Errors
from nico_selfmodel.estimation.results.verdict import (
    FEWEST_COMPARED,
    MOST_OUTLIERS,
    SIGNIFICANT,
    Verdict,
    significantly_above,
)
from nico_selfmodel.estimation.tree.compared_errors import RELATIVE, RELATIVE_TAIL
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT

_IN_TEN, _OFTEN = 0.1, 0.25
"""Share of the poses that were so far off in training, and from which on it is worth a failure."""

_OF_ANOTHER = 20.0
"""Times the expected error from which on a body cannot have changed by so much."""
_WHOSE = (
    "do data and model belong to one robot, with rows, joints and units as they were in training? "
    "`nico-selfmodel monitor` says which readings were taken wrongly, if it is that"
)


def judge_evaluation(
    model: SelfModel, dataset: Dataset, evaluation: Evaluation | PixelEvaluation
) -> Verdict:
    """Judge a self-model by new data, against the errors that its training lets expect.

    Args:
        dataset: What was measured, or what its cameras saw.
        evaluation: The model, held against it.

    Returns:
        FAIL where an error is significantly above what was expected, or more poses are further off
        than model, noise and false detections explain; NOT_EVALUATED where the model does not say
        what to expect, or the poses are too few.
    """
    if isinstance(evaluation, PixelEvaluation):
        rows, things = evaluation.observations.arm, "detections"
        compared = _in_images(model, evaluation)
        wrong = _contradicting(model, dataset, evaluation) if compared else np.zeros(0)
    else:
        rows, things = evaluation.observations, "points"
        compared, wrong = _in_space(model, evaluation), evaluation.outliers
    if not compared:
        return Verdict("NOT_EVALUATED", ("there is too little to compare the error with",))
    named, many = "", False
    if wrong.any():
        named = (
            f"{wrong.sum()} of {len(wrong)} {things} are further off than model and noise explain "
            f"({describe_outliers(rows, wrong)})"
        )
        many = bool(wrong.mean() > MOST_OUTLIERS)
    return _beside_training(compared, _against(model, dataset, evaluation), named, many=many)


def _against(
    model: SelfModel, dataset: Dataset, evaluation: Evaluation | PixelEvaluation
) -> Contradictions | None:
    """Return which poses contradict; None where the model does not say the sensor's noise."""
    sensor = "pixels" if isinstance(evaluation, PixelEvaluation) else "points"
    if sensor not in model.noise_mixtures:
        return None  # and what it saw may not be held against it at all
    return hand_contradictions(model, hand_observations_of(model, dataset, sensor), dataset)


def judge_body_errors(
    model: BodyModel,
    errors: Errors,
    against: Contradictions | None = None,
    others: Sequence[Errors] = (),
) -> Verdict:
    """Judge a body by new data, against the errors that its training lets expect.

    Args:
        errors: What it leaves of a recording.
        against: Poses of it that contradict the body, where that is known.
        others: What it leaves by other kinds, as pixels beside places.

    Returns:
        FAIL where the errors are significantly above what was expected, or more poses contradict
        than false detections explain; NOT_EVALUATED where the body does not say what to expect, or
        the poses are too few.
    """
    each = [(one, model.expected.get(one.compared_by)) for one in (errors, *others)]
    told = [
        (one, expected)
        for one, expected in each
        if expected is not None and min(expected["n"], len(one.compared)) >= FEWEST_COMPARED
    ]
    if not told:
        return Verdict("NOT_EVALUATED", ("there is too little to compare the error with",))
    compared = [
        _Compared.of(
            one.compared,
            float(expected["median" if one.relative_to is None else RELATIVE]),
            len(one.compared),
            int(expected["n"]),
            one.compared_size,
            one.unit,
        )
        for one, expected in told
    ]
    named = against.words if against is not None and against.count else ""
    often = next(filter(None, (_often_above(*one) for one in told)), "")
    return _beside_training(compared, against, named, often=often)


def _often_above(errors: Errors, expected: Mapping[str, float]) -> str:
    """Say that poses are more often far off than those of training were; empty where not.

    Half of the poses may be as they were, and hide in the median what the others show.
    """
    if errors.relative_to is None or RELATIVE_TAIL not in expected:
        return ""
    count, n = int(np.sum(errors.compared > expected[RELATIVE_TAIL])), len(errors.compared)
    spread = np.sqrt(_IN_TEN * (1.0 - _IN_TEN) * (1.0 / n + 1.0 / expected["n"]))
    if count / n < _OFTEN or (count / n - _IN_TEN) / spread < SIGNIFICANT:
        return ""
    limit = f"{errors.compared_size * expected[RELATIVE_TAIL]:.2f} {errors.unit}"
    return f"{count} of {n} poses are further off than {limit}, as one in ten was in training"


@dataclass(frozen=True)
class _Compared:
    """The median of one kind of error, found and expected, in words."""

    found: str
    expected: str
    above: bool
    """Whether it is significantly above."""
    another: bool
    """Whether it is that of another body."""

    @classmethod
    def of(
        cls, errors: NDArray, median: float, n: int, known_from: int, scale: float, unit: str
    ) -> "_Compared":
        """Compare errors of n independent poses."""
        above = significantly_above(errors, median, n, known_from)
        found = scale * float(np.median(errors))
        another = above and found > _OF_ANOTHER * scale * median
        return cls(f"{found:.2f} {unit}", f"{scale * median:.2f} {unit}", above, another)


def _in_space(model: SelfModel, evaluation: Evaluation) -> list[_Compared]:
    """Compare errors in space, one a pose."""
    expected = model.fit.get("expected_error")
    found = evaluation.observations.by_pose(evaluation.distances)
    if not expected or min(expected["n"], len(found)) < FEWEST_COMPARED:
        return []
    median = float(expected["median_m"])
    return [_Compared.of(found, median, len(found), expected["n"], 1e3, "mm")]


def _in_images(model: SelfModel, evaluation: PixelEvaluation) -> list[_Compared]:
    """Compare errors in space and in the images.

    What a pose shows twice, to both cameras or at two points, is one witness.
    """
    expected = model.fit.get("expected_error") or {}
    both = evaluation.select(np.flatnonzero(np.isfinite(evaluation.p_LH_seen).all(axis=1)))
    return [
        _Compared.of(errors, float(expected[key]), poses, expected["n"], scale, unit)
        for errors, poses, key, scale, unit in (
            (evaluation.distances, both.pose_count, "median_m", 1e3, "mm"),
            (evaluation.pixel_distances, evaluation.pose_count, "median_px", 1.0, "px"),
        )
        if key in expected and min(expected["n"], poses, len(errors)) >= FEWEST_COMPARED
    ]


def _beside_training(
    compared: list[_Compared],
    against: Contradictions | None,
    named: str = "",
    *,
    often: str = "",
    many: bool = False,
) -> Verdict:
    """Return the verdict on new errors beside those of the training.

    Args:
        compared: Kinds of errors.
        against: Poses that contradict the model, where that is known.
        named: What is further off than it should be, in words.
        often: Why it is too often, in words; empty where it is not.
        many: Whether it is too much.
    """
    found = " and ".join(one.found for one in compared)
    expected = " and ".join(one.expected for one in compared)
    medians = f"median {found}, expected {expected}"
    if any(one.above for one in compared):
        words = f"the error ({medians}) is significantly above that of the training poses"
        another = any(one.another for one in compared)
        return Verdict("FAIL", (f"{words}: {_WHOSE if another else WHAT_CHANGED}",))
    if often:
        return Verdict("FAIL", (f"{often}: {WHAT_CHANGED}",))
    within = f"the error ({medians}) is that of the training poses"
    if against is not None and against.too_many:
        return Verdict("FAIL", (f"{against.words}: {WHERE_TO_LOOK}",))
    if many:
        return Verdict("FAIL", (f"{named}: {WHAT_CHANGED}",))
    return Verdict("PASS", (f"{within}; {named}" if named else within,))


def _contradicting(model: SelfModel, dataset: Dataset, evaluation: PixelEvaluation) -> NDArray:
    """Return the rows that neither model nor noise explains. Boolean, shape (N,).

    Where the model puts the hand out of the view of a camera that saw it, nothing explains that.
    Pixels are whitened with all that is uncertain where the model tells joint noise from the
    tracker's noise; points that its cameras rebuild are taken where it has learned from such.
    """
    lost = (evaluation.observations.seen & np.isnan(evaluation.pixels_predicted)).any(axis=1)
    if JOINT_SIGMA in model.fit and model.pixel_sigma is not None:
        observations = hand_observations_of(model, dataset, "pixels")
        found = observations.innovations(covariance_of(model, observations.names))
        return lost | (np.sqrt(found.nis) > OUTLIER_AT * np.sqrt(found.dof / 3.0))
    rows = evaluation.observations.arm
    readings = rows.angles / model.servos.radians_per_unit
    known = model.predict(readings, rows.marker, rows.approach * model.servos.sign).covariance
    expected = expected_covariance(model, readings, rows.marker, known)
    rebuilt = replace(rows, p_WH=evaluation.p_LH_seen)
    return lost | Evaluation(rebuilt, evaluation.p_LH_predicted, expected).outliers
