"""Encoder jumps too large for a straight line: a joint's zero that is lost by tens of degrees.

A likelihood ratio of small changes takes a jump of 40 deg for a point that moved, or a base: the
hand goes round a circle, and they follow its chord.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

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


Moved = Callable[[int, float, int], NDArray]
"""What is told of the first so many poses after the change, with one parameter changed by so much,
from its number, the change, and how many. Shape (N, K)."""


@dataclass(frozen=True, eq=False)
class SlipSearch:
    """Poses as they are likely when one zero is elsewhere since a change, of a body of any kind."""

    poses: PoseResiduals
    """All poses, held against the body as it was."""
    noise: NoiseMixture
    """Of them."""
    covariance: NDArray
    """Of their parameters. Shape (P, P)."""
    since: int
    """First pose after the change."""
    turns: Mapping[str, float]
    """Zeros, each with what a whole turn of its joint is."""
    residuals: Moved
    """What poses are off by with a zero elsewhere."""
    slope: Moved
    """How that depends on this zero."""

    @property
    def large(self) -> bool:
        """Whether the poses after the change are further off than small changes put them."""
        density = MixtureDensity(self._after, self.noise, self.covariance)
        after = self._after
        return bool(density.nis(after.residuals).sum() > _LARGE * after.dof.sum())

    def ranked(self, found: tuple[Diagnosis, ...]) -> tuple[Diagnosis, ...]:
        """Judge encoder jumps of any size, where what was measured is no small change.

        Args:
            found: What small changes explain, the best first.

        Returns:
            Explanations, the best first.
        """
        if not self.large:
            return found
        zeros = (d.hypothesis for d in found if d.hypothesis.names[0] in self.turns)
        jumps = {h.cause: self._diagnosis(h) for h in zeros if len(h.names) == 1}
        return ranked(jumps.get(one.hypothesis.cause, one) for one in found)

    @property
    def _before(self) -> PoseResiduals:
        return self.poses.select(slice(None, self.since))

    @property
    def _after(self) -> PoseResiduals:
        return self.poses.select(slice(self.since, None))

    def _most_likely(self, column: int, sizes: NDArray) -> float:
        """Return the size of a jump with which the first poses after the change are likeliest."""
        first = self._after.select(slice(_ENOUGH))
        density = MixtureDensity(first, self.noise, self.covariance)
        logs = [density.log(self.residuals(column, size, len(first))).sum() for size in sizes]
        return float(sizes[int(np.argmax(np.nan_to_num(logs, nan=-np.inf, neginf=-np.inf)))])

    def _estimate(self, column: int, change: float) -> ChangeEstimate:
        """Return how a further small change explains all poses, with the zero changed.

        Their noise stays that of the poses as they were: where a wrong zero puts the hand beside a
        camera, anything would be noise.
        """
        after, whole = self._after, (column, change, len(self._after))
        slopes = after.slopes.copy()
        slopes[:, :, column] = self.slope(*whole)
        moved = replace(after, residuals=self.residuals(*whole), slopes=slopes)
        poses = PoseResiduals.together((self._before, moved))
        basis = np.eye(len(self.poses.names))[:, [column]]
        return ChangeLikelihood(poses, self.noise, self.covariance).of(basis, self.since)

    def _diagnosis(self, hypothesis: Hypothesis) -> Diagnosis:
        """Return what the best jump of any size explains."""
        name = hypothesis.names[0]
        column, turn = self.poses.names.index(name), self.turns[name]
        nothing = np.zeros((len(self.poses.names), 0))
        likelihood = ChangeLikelihood(self.poses, self.noise, self.covariance)
        unchanged = likelihood.of(nothing, self.since)
        change = self._most_likely(column, turn * (np.arange(_SIZES) / _SIZES - 0.5))
        found = self._estimate(column, change)
        for _ in range(_ROUNDS):
            change += float(found.change[0])
            found = self._estimate(column, change)
            if abs(found.change[0]) < _SETTLED * found.sigma[0]:
                break
        found = replace(found, change=nearest_turn(found.change + change, 0.0, turn))
        return diagnosed(hypothesis, found, unchanged.log_likelihood)


def slips_of_arm(
    model: SelfModel, dataset: Dataset, sensor: str, noise: NoiseMixture, since: int
) -> SlipSearch:
    """Return the search for slips of any size of an arm.

    Args:
        model: The body as it was.
        dataset: All poses.
        sensor: As for `hand_observations_of`.
        since: First pose after the change.
    """
    observations = hand_observations_of(model, dataset, sensor)
    poses, x = PoseResiduals.of(observations), observations.x
    samples = poses.sample[since:]
    gears = zip(model.joints, model.servos.gear.tolist(), strict=True)
    turns = {f"{joint}.theta_offset": 2.0 * np.pi * gear for joint, gear in gears}

    def moved(column: int, change: float, count: int) -> PoseResiduals:
        elsewhere = x.copy()
        elsewhere[column] += change
        body = with_values(model, observations.names, elsewhere)
        rows = _from(dataset, samples[:count], whole=count == len(samples))
        return PoseResiduals.of(hand_observations_of(body, rows, sensor))

    return SlipSearch(
        poses,
        noise,
        covariance_of(model, poses.names),
        since,
        turns,
        residuals=lambda *where: moved(*where).residuals,
        slope=lambda column, *where: moved(column, *where).slopes[:, :, column],
    )


def _from(dataset: Dataset, samples: NDArray, *, whole: bool) -> Dataset:
    """Return the rows from the first of some samples on, to the data's end or to their last."""
    own, first = np.unique(dataset.sample, return_index=True)
    place = dict(zip(own.tolist(), first.tolist(), strict=True))
    low = place[int(samples[0])]
    high = len(dataset) if whole else place[int(samples[-1])]
    return dataset.select(np.isin(dataset.sample, own[(first >= low) & (first <= high)]))
