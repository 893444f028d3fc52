"""What learning a few parameters anew was worth: errors before and after, on poses left out too."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError, NotIdentifiableError
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.monitoring.block_update import (
    BlockUpdate,
    learn_block,
    learn_with_prior,
)
from nico_selfmodel.estimation.noise.hand_observations import hand_observations_of
from nico_selfmodel.estimation.observations.parameter_scales import parameter_scales_of
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels
from nico_selfmodel.estimation.observations.pixel_observations import columns_of
from nico_selfmodel.estimation.results.folds import Fold, by_fold, fold_of
from nico_selfmodel.model.self_model import SelfModel


@dataclass(frozen=True, eq=False)
class HeldAgainst:
    """A body held against observations."""

    errors: NDArray
    """In each camera's image [px], or in space [m]. Shape (n,)."""
    p_WH_predicted: NDArray
    """Where it puts the hand [m]. Shape (N, 3)."""
    p_WH_seen: NDArray
    """Where its cameras, or the tracker, put it; nan where they cannot tell [m]. Shape (N, 3)."""

    @classmethod
    def of(cls, model: SelfModel, dataset: Dataset, sensor: str) -> "HeldAgainst":
        """Hold a body against observations by one sensor, `pixels` or `points`."""
        if sensor == "pixels":
            found = evaluate_pixels(model, dataset)
            return cls(found.pixel_distances, found.p_LH_predicted, found.p_LH_seen)
        measured = evaluate(model, columns_of(model, dataset))
        return cls(measured.distances, measured.p_WH_predicted, measured.observations.p_WH)


@dataclass(frozen=True, eq=False)
class UpdateEvaluation:
    """A body before and after a few of its parameters were learned anew."""

    before: SelfModel
    """The body as it was, with all points that were tracked."""
    update: BlockUpdate
    """What was learned."""
    train: Dataset
    """Observations that it was learned from."""
    test: Dataset | None
    """Observations that were held out."""
    sensor: str
    """`pixels` or `points`."""
    cross_validation: NDArray | None
    """Errors of inlier poses, each by a body learned without it; None with too few. (n,)."""

    @property
    def after(self) -> SelfModel:
        """The body as it is now."""
        return self.update.model

    @cached_property
    def held(self) -> dict[str, tuple[HeldAgainst, HeldAgainst]]:
        """`train` and `test`, where there is one: the body before and after."""
        sets = {"train": self.train} | ({} if self.test is None else {"test": self.test})
        both = (self.before, self.after)
        return {
            name: (
                HeldAgainst.of(both[0], data, self.sensor),
                HeldAgainst.of(both[1], data, self.sensor),
            )
            for name, data in sets.items()
        }


def evaluate_update(
    before: SelfModel,
    update: BlockUpdate,
    train: Dataset,
    sensor: str = "auto",
    test: Dataset | None = None,
    *,
    with_prior: bool = False,
) -> UpdateEvaluation:
    """Hold a body before and after an update against its observations, whole poses cross-validated.

    Args:
        before: The body as it was, with all points that were tracked.
        train: What it was learned from.
        sensor: As it was learned.
        with_prior: Whether the rest of the body was free under its posterior.
    """
    observations = hand_observations_of(before, train, sensor)
    kind = "pixels" if observations.seen.shape[1] == 4 else "points"
    inliers = np.unique(observations.sample[~update.outliers])
    crossed = _cross_validate(before, update.learned, train, kind, inliers, with_prior)
    return UpdateEvaluation(before, update, train, test, kind, crossed)


def _cross_validate(
    before: SelfModel,
    names: tuple[str, ...],
    train: Dataset,
    sensor: str,
    poses: NDArray,
    with_prior: bool,
) -> NDArray | None:
    """Return the errors of poses, each by a body learned without it; None with too few of them."""
    learn = learn_with_prior if with_prior else learn_block
    scales = parameter_scales_of(before, names)

    def of(chosen: NDArray) -> Dataset:
        return train.select(np.isin(train.sample, poses[chosen]))

    def learned_without(part: Fold) -> SelfModel:
        rest = hand_observations_of(before, of(part.rest), sensor)
        return learn(before, rest, names, scales=scales, loss="none").model

    def errors(model: SelfModel, part: Fold) -> NDArray:
        return HeldAgainst.of(model, of(part.left), sensor).errors

    try:
        found = [own for _, own in by_fold(fold_of(poses), learned_without, errors)]
    except (DataError, NotIdentifiableError):
        return None
    return np.concatenate(found) if found else None
