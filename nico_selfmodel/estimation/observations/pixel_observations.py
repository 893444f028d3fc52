"""Pixels of the hand in a data set, in the form that estimators of the whole body work on."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.observations.matching import reading_columns
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed


@dataclass(frozen=True, eq=False)
class PixelObservations:
    """Rows in which one camera or both saw a tracked point directly, not in a mirror."""

    arm: Observations
    """Encoder angles, tracked points and samples of the rows. Its positions are all zero, so that
    residuals of positions are the predicted positions themselves."""
    pixels: NDArray
    """Left u, v and right u, v; nan where a camera did not see the point [px]. Shape (N, 4)."""

    @classmethod
    def from_dataset(
        cls, dataset: Dataset, markers: tuple[str, ...] | None = None
    ) -> "PixelObservations":
        """Take the rows in which a camera saw a point.

        Args:
            markers: Only these tracked points, in this order; all by default.

        Raises:
            DataError: If no row has pixels.
        """
        finite = np.asarray(np.isfinite(dataset.pixels).reshape(-1, 2, 2).all(axis=2))
        direct = finite.any(axis=1) & (dataset.mirror == "")
        known = markers or tuple(m for m in dataset.markers if (direct & _of(dataset, m)).any())
        rows = np.flatnonzero(direct & np.isin(dataset.marker, known))
        if not rows.size:
            raise DataError(
                f"data set {dataset.name!r} has no pixels (left_u, left_v, right_u, right_v) of "
                f"{listed(known) or 'any marker'}: record it with cameras that track the hand"
            )
        arm = Observations.of_rows(dataset, known, rows, np.zeros((len(rows), 3)))
        hidden = ~np.repeat(finite[rows], 2, axis=1)
        return cls(arm, np.where(hidden, np.nan, dataset.pixels[rows]))

    def __len__(self) -> int:
        """Return the number of rows N."""
        return len(self.pixels)

    @property
    def seen(self) -> NDArray:
        """Which coordinates were measured. Boolean, shape (N, 4)."""
        return np.asarray(np.isfinite(self.pixels))

    @property
    def by_both(self) -> NDArray:
        """Which rows both cameras saw. Boolean, shape (N,)."""
        return np.asarray(self.seen.all(axis=1))

    def select(self, keep: NDArray) -> "PixelObservations":
        """Return the chosen rows. `keep` is a boolean mask or an index."""
        return replace(self, arm=self.arm.select(keep), pixels=self.pixels[keep])

    def require_both_cameras(self, fewest: int, name: str, unknown: tuple[str, ...] = ()) -> None:
        """Refuse data in which too few poses were seen by both cameras.

        Args:
            fewest: Poses that are needed.
            unknown: Parameters that so few poses leave open.

        Raises:
            DataError: If so; it names the camera that saw less, and what cannot be observed.
        """
        both = int(self.by_both.sum())
        if both >= fewest:
            return
        poses = self.arm.select(self.by_both).pose_words
        words = f"in data set {name!r} both cameras saw the hand in {poses}, at least {fewest} are"
        words += " needed"
        if unknown:
            words += f", or these cannot be observed, wholly or in part: {listed(unknown)}"
        if both == len(self):
            raise DataError(f"{words}: record more")
        counts = {camera: int(self.seen[:, 2 * i].sum()) for i, camera in enumerate(SIDES)}
        fewer = min(counts, key=lambda camera: counts[camera])
        raise DataError(
            f"{words}: the {fewer} camera saw it in {counts[fewer]} of {len(self)}; record poses "
            "in view of both cameras"
        )


def seen_points(observations: PixelObservations, rig: StereoRig, sigma: float) -> NDArray:
    """Reconstruct the points that both cameras saw.

    Args:
        sigma: Standard deviation of a pixel coordinate [px].

    Returns:
        p_WH, nan where a camera did not see the point or its pixels allow none [m]. Shape (N, 3).
    """
    p = np.full((len(observations), 3), np.nan)
    pixels = observations.pixels
    usable = observations.by_both
    usable &= rig.left.has_rays(pixels[:, :2]) & rig.right.has_rays(pixels[:, 2:])
    if usable.any():
        found = rig.triangulate(pixels[usable], sigma)
        p[usable] = np.where(found.in_front[:, None], found.p_WQ, np.nan)
    return p


def columns_of(model: SelfModel, dataset: Dataset) -> Dataset:
    """Return the data with its joints in the order of a model's.

    Raises:
        DataError: If the joints, their units or the tracked points are others.
    """
    columns = reading_columns(model, dataset)
    if columns == list(range(len(columns))):
        return dataset
    joints = tuple(dataset.joints[i] for i in columns)
    encoders, approach = dataset.encoders[:, columns], dataset.approach[:, columns]
    return replace(dataset, joints=joints, encoders=encoders, approach=approach)


def _of(dataset: Dataset, marker: str) -> NDArray:
    return np.asarray(dataset.marker == marker)
