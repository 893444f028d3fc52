"""Encoder jumps too large for a straight line: a joint's zero that is lost by tens of degrees.

A likelihood ratio of small changes takes a jump of 40 deg for a point that moved, or a base: the
hand goes round a circle, and they follow its chord.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.monitoring.change_likelihood import ChangeEstimate, ChangeLikelihood
from nico_selfmodel.estimation.monitoring.diagnosis import Diagnosis, Hypothesis, diagnosed, ranked
from nico_selfmodel.estimation.noise.hand_observations import (
    covariance_of,
    hand_observations_of,
    with_values,
)
from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.geometry.angles import nearest_turn
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.model.self_model import SelfModel

_LARGE = 10.0
"""Squared innovations of a coordinate from which on a change is no small one."""
_SIZES = 36
"""Sizes of a jump that are tried, over a whole turn of the joint."""
_ENOUGH = 30
"""Poses after the change by which the sizes are tried."""
_ROUNDS, _SETTLED = 20, 0.1
"""Most steps to the best size, and the step in standard deviations at which they end."""


def with_large_slips(
    model: SelfModel,
    dataset: Dataset,
    sensor: str,
    noise: NoiseMixture,
    since: int,
    found: tuple[Diagnosis, ...],
) -> tuple[Diagnosis, ...]:
    """Judge encoder jumps of any size, where what was measured is no small change.

    Args:
        model: The body as it was.
        dataset: All poses.
        sensor: As for `hand_observations_of`.
        since: First pose after the change.
        found: What small changes explain, the best first.

    Returns:
        Explanations, the best first.
    """
    jump = _Jump(model, dataset, sensor, noise, since)
    if not jump.large:
        return found
    again = []
    for diagnosis in found:
        names = diagnosis.hypothesis.names
        if len(names) == 1 and names[0].endswith(".theta_offset"):
            diagnosis = jump.diagnosis(diagnosis.hypothesis)
        again.append(diagnosis)
    return ranked(again)


class _Jump:
    """Poses as they are likely when one zero is elsewhere since a change."""

    def __init__(
        self, model: SelfModel, dataset: Dataset, sensor: str, noise: NoiseMixture, since: int
    ) -> None:
        self.model, self.sensor, self.noise, self.since = model, sensor, noise, since
        observations = hand_observations_of(model, dataset, sensor)
        self.x, self.names = observations.x, observations.names
        self.covariance = covariance_of(model, self.names)
        poses = PoseResiduals.of(observations)
        self.before = poses.select(slice(None, since))
        self.after = poses.select(slice(since, None))
        self.rows = _from(dataset, self.after.sample)

    @property
    def large(self) -> bool:
        """Whether the poses after the change are further off than small changes put them."""
        density = MixtureDensity(self.after, self.noise, self.covariance)
        return bool(density.nis(self.after.residuals).sum() > _LARGE * self.after.dof.sum())

    def moved(self, column: int, change: float, rows: Dataset | None = None) -> PoseResiduals:
        """Return poses after the change, all or those of some rows, with the zero changed.

        Their noise stays that of the poses as they were: where a wrong zero puts the hand beside a
        camera, anything would be noise.
        """
        x = self.x.copy()
        x[column] += change
        body = with_values(self.model, self.names, x)
        there = PoseResiduals.of(hand_observations_of(body, rows or self.rows, self.sensor))
        kept = self.after.select(slice(len(there)))
        slopes = kept.slopes.copy()
        slopes[:, :, column] = there.slopes[:, :, column]
        return replace(kept, residuals=there.residuals, slopes=slopes)

    def most_likely(self, column: int, sizes: NDArray) -> float:
        """Return the size of a jump with which the first poses after the change are likeliest."""
        first = _from(self.rows, self.after.sample[:_ENOUGH], whole=False)
        density = MixtureDensity(self.after.select(slice(_ENOUGH)), self.noise, self.covariance)
        logs = [density.log(self.moved(column, size, first).residuals).sum() for size in sizes]
        return float(sizes[int(np.argmax(np.nan_to_num(logs, nan=-np.inf, neginf=-np.inf)))])

    def estimate(self, column: int, change: float) -> ChangeEstimate:
        """Return how a further small change explains all poses, with the zero changed."""
        poses = PoseResiduals.together((self.before, self.moved(column, change)))
        basis = np.eye(len(self.names))[:, [column]]
        return ChangeLikelihood(poses, self.noise, self.covariance).of(basis, self.since)

    def diagnosis(self, hypothesis: Hypothesis) -> Diagnosis:
        """Return what the best jump of any size explains."""
        column = self.names.index(hypothesis.names[0])
        poses, nothing = (
            PoseResiduals.together((self.before, self.after)),
            np.zeros((len(self.x), 0)),
        )
        unchanged = ChangeLikelihood(poses, self.noise, self.covariance).of(nothing, self.since)
        joint = self.model.joints.index(hypothesis.names[0].rpartition(".")[0])
        turn = 2.0 * np.pi * float(self.model.servos.gear[joint])
        sizes = turn * (np.arange(_SIZES) / _SIZES - 0.5)
        change = self.most_likely(column, sizes)
        found = self.estimate(column, change)
        for _ in range(_ROUNDS):
            change += float(found.change[0])
            found = self.estimate(column, change)
            if abs(found.change[0]) < _SETTLED * found.sigma[0]:
                break
        found = replace(found, change=nearest_turn(found.change + change, 0.0, turn))
        return diagnosed(hypothesis, found, unchanged.log_likelihood)


def _from(dataset: Dataset, samples: NDArray, *, whole: bool = True) -> Dataset:
    """Return the rows from the first of some samples on, to the data's end or to their last."""
    own, first = np.unique(dataset.sample, return_index=True)
    place = dict(zip(own.tolist(), first.tolist(), strict=True))
    low = place[int(samples[0])]
    high = len(dataset) if whole else place[int(samples[-1])]
    return dataset.select(np.isin(dataset.sample, own[(first >= low) & (first <= high)]))
