"""Readings that a recording has wrongly, told by a body that is known: mended, its poses fit.

A recording of another unit, of columns that are exchanged, or paired with the readings of another
moment looks like a body that changed altogether. No joint is to blame then: of the ways in which
readings are usually taken wrongly, that one is told with which the poses are off by noise again.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.estimation.diagnosis.mistaken_units import OTHER_UNIT
from nico_selfmodel.estimation.diagnosis.suspected_readings import LateReadings
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.estimation.observations.outlier_words import stuck_encoder

ENOUGH = 16
"""Poses by which readings that are mended are judged."""
_GROSS, _FITS = 25.0, 4.0
"""Squared innovation of a coordinate, of the middle pose, from which on readings may be wrong, and
up to which mended ones are right in three of four poses: noise may have become twice as loud."""
_MOST = 0.75
"""Share of the poses that mended readings must fit: where they put a hand far off, before a camera
or behind it, half of the poses may be anywhere, and so far off is no innovation."""
_SHIFTS = (-1, 1, -2, 2)


@dataclass(frozen=True, eq=False)
class ReadPoses:
    """What was read at the poses of a recording, and how far off a body says that they are."""

    joints: Sequence[str]
    """Names, n of them."""
    units: Sequence[str]
    """In which each is said to be read."""
    sample: NDArray
    """Number of each pose. Shape (P,)."""
    readings: NDArray
    """As they were read; nan of a joint that is not. Shape (P, n)."""
    off_by: Callable[[NDArray], NDArray]
    """Squared innovations a coordinate of a few poses, had all been read so: (P, n) -> (K,)."""

    def misread(self, against: NDArray) -> str | None:
        """Say how the readings are wrong; None where they are not, or nothing tried mends them.

        Args:
            against: Numbers of the poses that contradict the body. Shape (Q,).
        """
        if not self._off(self.readings, 0.5) > _GROSS:
            return None
        tried = [(self._off(mended, _MOST), words) for words, mended in self._ways()]
        least, words = min(tried, default=(np.inf, ""))
        if least <= _FITS:
            return f"{words}; then the poses fit"
        return self._stuck(against)

    def _off(self, readings: NDArray, share: float) -> float:
        """Return how far off such a share of the poses is at most; inf where none can be asked."""
        try:
            off = self.off_by(readings)
        except SelfModelError:
            return np.inf
        return float(np.quantile(off, share, method="higher")) if len(off) else np.inf

    def _ways(self) -> Iterator[tuple[str, NDArray]]:
        """Yield what may be wrong with the readings, and these mended."""
        for shift in _SHIFTS:
            yield str(LateReadings((), shift)), np.roll(self.readings, -shift, axis=0)
        read = np.flatnonzero(np.isfinite(self.readings).any(axis=0)).tolist()
        yield from self._other_units(read)
        for i in read:
            words = f"the readings of {self.joints[i]} have the other sign than in training"
            yield words, self._times([i], -1.0)
        for i, j in combinations(read, 2):  # whatever their units are: columns are exchanged
            words = f"the readings of {self.joints[i]} and {self.joints[j]} are exchanged"
            order = np.arange(len(self.joints))
            order[[i, j]] = j, i
            yield words, self.readings[:, order]

    def _other_units(self, read: Sequence[int]) -> Iterator[tuple[str, NDArray]]:
        for unit, (other, factor) in OTHER_UNIT.items():
            own = [i for i in read if self.units[i] == unit]
            for some in ([i] for i in own):
                words = f"{self.joints[some[0]]} is read in {other}, not in {unit} as stated"
                yield f"{words}: correct encoder_unit", self._times(some, factor)
            if len(own) > 1:
                words = f"joints are read in {other}, not in {unit} as stated"
                yield f"{words}: correct encoder_unit", self._times(own, factor)

    def _times(self, joints: Sequence[int], factor: float) -> NDArray:
        mended = self.readings.copy()
        mended[:, joints] *= factor
        return mended

    def _stuck(self, against: NDArray) -> str | None:
        """Say which encoder stands still in the poses that contradict, if one does."""
        off = np.isin(self.sample, against)
        words = stuck_encoder(self.joints, self.units, self.readings, self.sample, off)
        return f"{len(against)} poses contradict the body, {words}" if words else None


def off_by_mended(
    read: Callable[[NDArray], PoseResiduals | None],
    innovations: Callable[[PoseResiduals], NDArray],
    readings: NDArray,
) -> Callable[[NDArray], NDArray]:
    """Return `ReadPoses.off_by`: a pose fits only if it is no further off than any was as read.

    Where mended readings put a hand before a camera or behind it, slopes are so large that nothing
    is an innovation.

    Args:
        read: Residuals of a few poses, had all been read so: (P, n) -> K poses; None if nothing is
            seen then.
        innovations: Their squared innovations a coordinate, of those that show something.
        readings: As they were read. Shape (P, n).
    """

    def far(poses: PoseResiduals) -> NDArray:
        return np.abs(poses.residuals[poses.dof > 0]).max(axis=1, initial=0.0)

    @cache
    def limit() -> float:  # nobody asks of a body that is healthy
        plain = read(readings)
        return np.inf if plain is None else float(far(plain).max(initial=0.0))

    def off_by(mended: NDArray) -> NDArray:
        poses = read(mended)
        if poses is None:
            return np.zeros(0)
        return np.where(far(poses) > limit(), np.inf, innovations(poses))

    return off_by


def some_of(first: int, count: int) -> NDArray:
    """Return a few of so many poses, from the first on, far apart. Boolean, shape (count,)."""
    chosen = np.zeros(count, dtype=bool)
    chosen[np.unique(np.linspace(first, count - 1, ENOUGH).astype(int))] = True
    return chosen
