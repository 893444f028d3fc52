"""Slips too large for a straight line: a joint's zero that is lost by tens of degrees.

A likelihood ratio of small changes takes the slip of a joint by 40 deg for a point that moved, or a
base: the hand goes round a circle, and they follow its chord.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation.diagnosis import PENALTY, Diagnosis
from nico_selfmodel.estimation.hand_noise import whitening_of
from nico_selfmodel.estimation.sightings import (
    Innovations,
    Sightings,
    covariance_of,
    sightings_of,
    with_values,
)
from nico_selfmodel.model.self_model import SelfModel

_LARGE = 10.0
"""Squared innovations of a coordinate from which on a change is no small one."""
_ALL = 4.0
"""Standard deviations by which what a slip leaves may exceed noise, if it explains all."""
_STEPS = 36
"""Sizes of a slip that are tried, over a whole turn of the joint."""
_ROUNDS = 20


def with_large_slips(
    model: SelfModel,
    dataset: Dataset,
    sensor: str,
    innovations: Innovations,
    start: int,
    found: tuple[Diagnosis, ...],
) -> tuple[Diagnosis, ...]:
    """Judge slips of any size, where no small change explains what was seen.

    Args:
        model: The body as it was.
        dataset: The sightings.
        sensor: As for `sightings_of`.
        innovations: Of all sightings.
        start: First sighting after the change.
        found: What small changes explain, the best first.

    Returns:
        Explanations, the best first. A slip that leaves nothing but noise comes before what needs
        more parameters to say the same.
    """
    after = innovations.select(slice(start, None))
    squares = float(np.sum(after.nis))
    if squares < _LARGE * float(after.dof.sum()):
        return found
    whitening = whitening_of(after.covariance, after.seen)
    again = []
    for diagnosis in found:
        names = diagnosis.hypothesis.names
        if len(names) == 1 and names[0].endswith(".theta_offset"):
            slip = _Slip(model, dataset, sensor, names[0], start, whitening)
            diagnosis = slip.diagnosis(diagnosis, squares)
        again.append(diagnosis)
    return tuple(sorted(again, key=lambda d: -d.score))


class _Slip:
    """The squares that are left when one zero is elsewhere."""

    def __init__(
        self,
        model: SelfModel,
        dataset: Dataset,
        sensor: str,
        name: str,
        start: int,
        whitening: NDArray,
    ) -> None:
        self.model, self.dataset, self.sensor = model, dataset, sensor
        self.whitening, self.start = whitening, start
        self.sightings = sightings_of(model, dataset, sensor)
        self.column = self.sightings.names.index(name)
        joint = model.joints.index(name.rpartition(".")[0])
        self.turn = 2.0 * np.pi * float(model.servos.gear[joint])

    def _moved(self, change: float) -> tuple[NDArray, Sightings]:
        x = self.sightings.x.copy()
        x[self.column] += change
        moved = with_values(self.model, self.sightings.names, x)
        return x, replace(sightings_of(moved, self.dataset, self.sensor), x=x)

    def at(self, change: float) -> tuple[NDArray, NDArray]:
        """Return whitened residuals and their derivatives with the zero changed. (n,), (n,)."""
        x, there = self._moved(change)
        now = there.innovations(np.zeros((len(x), len(x)))).select(slice(self.start, None))
        r = (self.whitening @ now.residuals[:, :, None]).ravel()
        return r, (self.whitening @ now.slopes[:, :, self.column, None]).ravel()

    def explains_all(self, change: float) -> bool:
        """Return whether a slip leaves no more than noise, by what is to be expected then."""
        _, there = self._moved(change)
        covariance = covariance_of(self.model, there.names)
        now = there.innovations(covariance).select(slice(self.start, None))
        dof = float(now.dof.sum())
        return float(now.nis.sum()) < dof + _ALL * np.sqrt(2.0 * dof)

    def diagnosis(self, small: Diagnosis, squares: float) -> Diagnosis:
        """Return what the best slip of any size explains."""
        sizes = self.turn * (np.arange(_STEPS) / _STEPS - 0.5)
        left = [float(np.sum(self.at(size)[0] ** 2)) for size in sizes]
        change = float(sizes[int(np.argmin(left))])
        for _ in range(_ROUNDS):
            r, slope = self.at(change)
            step = float(slope @ r) / max(float(slope @ slope), 1e-300)
            change += step
            if abs(step) < 1e-9 * self.turn:
                break
        r, slope = self.at(change)
        statistic = squares - float(r @ r)
        explained = squares if self.explains_all(change) else statistic
        sigma = float(slope @ slope) ** -0.5
        return replace(
            small,
            statistic=statistic,
            dof=1,
            score=explained - PENALTY,
            change=np.array([change]),
            sigma=np.array([sigma]),
        )
