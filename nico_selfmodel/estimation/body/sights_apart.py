"""Sights of two cameras that do not meet: what they show is not what these cameras saw.

The sights of both cameras to one point meet but for noise (Hartley and Zisserman, 12.5): how far
they miss each other needs no arm to be told from.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.diagnosis.changes_in_time import FEWEST_VISITS
from nico_selfmodel.estimation.observations.outlier_words import name_samples
from nico_selfmodel.estimation.results.calibration_result import (
    CAUSE,
    FAILURE,
    WARNING,
    Finding,
    findings,
)
from nico_selfmodel.estimation.results.verdict import outliers_are_many
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_MOST_APART = 5.0
"""Distance of pixels from those of the point that fits both best, above which no noise is [px]."""
_MOST_OF_VARIANCE, _LEAST_STEP = 0.75, 1.0
"""Share of the scatter that a step in time explains, and its size [px], from which it is one."""
_EXCHANGED = [2, 3, 0, 1]


@dataclass(frozen=True, eq=False)
class SightsApart:
    """How far the sights of both cameras miss each other in the rows that both saw."""

    row: NDArray
    """These rows of the data set. Shape (N,)."""
    sample: NDArray
    """Numbers of their samples, ascending. Shape (N,)."""
    miss: NDArray
    """With its sign; nan where the sights meet nowhere before both cameras [px]. Shape (N,)."""
    exchanged: NDArray
    """Rows apart that fit once left and right are exchanged. Boolean, shape (N,)."""

    @classmethod
    def of(cls, dataset: Dataset, rig: StereoRig) -> "SightsApart":
        """Hold pixels against the cameras that are said to have seen them.

        Args:
            dataset: Data with pixels; rows with reflections and of one camera alone tell nothing.
        """
        both = np.isfinite(dataset.pixels).all(axis=1) & (dataset.mirror == "")
        rows = np.flatnonzero(both)[np.argsort(dataset.sample[both], kind="stable")]
        pixels = dataset.pixels[rows]
        miss = _miss(rig, pixels)
        exchanged = _apart(miss) & ~_apart(_miss(rig, pixels[:, _EXCHANGED]))
        return cls(rows, dataset.sample[rows], miss, exchanged)

    @property
    def apart(self) -> NDArray:
        """Rows in which they miss each other by more than noise can. Boolean, shape (N,)."""
        return _apart(self.miss)

    def without(self, dataset: Dataset) -> Dataset:
        """Return the data without rows whose sights do not meet.

        Raises:
            DataError: If these are most of those that both cameras saw.
        """
        apart = self.apart
        if 2 * apart.sum() > len(apart):
            raise DataError(f"data set {dataset.name!r}: {self.words}")
        return dataset.select(np.delete(np.arange(len(dataset)), self.row[apart]))

    def findings(self) -> list[Finding]:
        """Say what the sights tell against the cameras, or against the data."""
        apart, many = self.apart, outliers_are_many(self.apart)
        if many is not None:
            return [Finding(CAUSE, self.words)]
        told = findings(FAILURE, [self._step_words()])
        if apart.any():
            told.append(Finding(WARNING, f"{self.words}: these are left out"))
        return told

    @property
    def words(self) -> str:
        """In how many rows they miss each other, and what that hints at."""
        apart = self.apart
        where = (
            f"{apart.sum()} of {len(apart)} times ({name_samples(np.unique(self.sample[apart]))})"
        )
        if 2 * self.exchanged.sum() > apart.sum():
            return f"left and right are exchanged in the pixels {where}"
        told = self.miss[apart & np.isfinite(self.miss)]
        far = f", by {np.median(np.abs(told)):.3g} px in the median" if len(told) else ""
        return (
            f"the sights of both cameras miss each other, or meet behind them, {where}{far}: were "
            "these pixels seen by these cameras, in images of this size, u before v, at one moment?"
        )

    def _step_words(self) -> str | None:
        """Say that the cameras moved against each other, if a step in time explains the misses."""
        sound = ~self.apart
        miss, sample = self.miss[sound], self.sample[sound]
        n, margin = len(miss), FEWEST_VISITS // 2
        if n < 2 * margin:
            return None
        # Between the means before and after t of n lies t (n - t) / n of the sum of squares.
        t = np.arange(1, n)
        before, whole = np.cumsum(miss)[:-1], miss.sum()
        step = (whole - before) / (n - t) - before / t
        share = step**2 * t * (n - t) / n / max(n * miss.var(), np.finfo(float).tiny)
        share[: margin - 1] = share[n - margin :] = 0.0
        at = int(share.argmax())
        if share[at] < _MOST_OF_VARIANCE or abs(step[at]) < _LEAST_STEP:
            return None
        return (
            f"the cameras moved against each other after sample {sample[at]}: from there on their "
            f"sights miss each other by {abs(step[at]):.2g} px more than before; "
            "learn from one part alone, or record again"
        )


def _apart(miss: NDArray) -> NDArray:
    return ~(np.abs(miss) <= _MOST_APART)


def _miss(rig: StereoRig, pixels: NDArray) -> NDArray:
    """Return how far each row's pixels are from one point's, with a sign. Shape (N,)."""
    miss = np.full(len(pixels), np.nan)
    usable = rig.left.has_rays(pixels[:, :2]) & rig.right.has_rays(pixels[:, 2:])
    if not usable.any():
        return miss
    found = rig.triangulate(pixels[usable])
    residuals = np.where(np.isfinite(found.residuals), found.residuals, 0.0)
    # Residuals lie across epipolar lines, which hardly turn over the image.
    across = np.linalg.svd(residuals, full_matrices=False)[2][0]
    signed = np.linalg.norm(residuals, axis=1) * np.sign(residuals @ across)
    met = found.in_front & np.isfinite(found.residuals).all(axis=1)
    miss[usable] = np.where(met, signed, np.nan)
    return miss
