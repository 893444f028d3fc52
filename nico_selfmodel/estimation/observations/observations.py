"""Measured points of a data set, in the form that the estimators of the arm work on."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.poses import mean_of_visits
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.names import listed


@dataclass(frozen=True, eq=False)
class Observations:
    """Rows with a measured point: encoder angles in, position out."""

    joints: tuple[str, ...]
    """Names from the base outwards. Length n."""
    markers: tuple[str, ...]
    """Names of the tracked points. Length m."""
    angles: NDArray
    """Encoder angles [rad], with the wiring's sign. Shape (N, n)."""
    marker: NDArray
    """Index of each row's tracked point. Shape (N,)."""
    p_WH: NDArray
    """Measured points [m]. Shape (N, 3)."""
    sample: NDArray
    """Number of the sample of each row. Shape (N,)."""
    pose: NDArray
    """Number of the pose of each row: samples with equal readings are one pose. Shape (N,)."""
    visit: NDArray
    """Number of the visit of each row: each time the robot came to a pose. Shape (N,)."""
    rows: NDArray
    """Row of the data set behind each row here. Shape (N,)."""
    approach: NDArray
    """How each encoder angle last moved, -1 or 1; 0 where it is not known. Shape (N, n)."""
    units: ServoMap
    """Units of the encoders, as the data set states them; offset 0 and gear 1."""
    stretch: NDArray | None = field(default=None, kw_only=True)
    """L of each row, LL' what its point is uncertain by over the variance of a typical coordinate;
    None where all coordinates are alike, as a tracker measures them. Shape (N, 3, 3)."""

    @classmethod
    def from_dataset(
        cls, dataset: Dataset, markers: tuple[str, ...] | None = None
    ) -> "Observations":
        """Take the rows in which the point itself was measured.

        Args:
            markers: Only these tracked points, in this order; all by default.

        Raises:
            DataError: If no row has a measured point.
        """
        known = markers or tuple(
            m for m in dataset.markers if (dataset.measured & (dataset.marker == m)).any()
        )
        direct = dataset.measured & np.isin(dataset.marker, known)
        rows = np.flatnonzero(direct)
        if not rows.size:
            raise DataError(
                f"data set {dataset.name!r} has no measured point (x_m, y_m, z_m) of "
                f"{listed(known) or 'any marker'}: record them, or learn from pixels with known "
                "cameras (--cameras)"
            )
        return cls.of_rows(dataset, known, rows, dataset.p_WH_measured[rows])

    @classmethod
    def of_rows(
        cls, dataset: Dataset, markers: tuple[str, ...], rows: NDArray, p_WH: NDArray
    ) -> "Observations":
        """Take chosen rows, with what is said to have been measured in them.

        Args:
            rows: Rows of these.
            p_WH: What was measured [m]. Shape (N, 3).
        """
        units = _servo_units(dataset)
        return cls(
            dataset.joint_names,
            tuple(markers),
            units.to_radians(mean_of_visits(dataset.encoders, dataset.visit)[rows]),
            np.array([markers.index(name) for name in dataset.marker[rows].tolist()]),
            p_WH,
            dataset.sample[rows],
            dataset.pose[rows],
            dataset.visit[rows],
            rows,
            units.sign * dataset.approach[rows],
            units,
        )

    @property
    def pose_words(self) -> str:
        """How many poses the rows are of, and how many rows where these are more."""
        count = len(self.poses)
        words = "1 pose" if count == 1 else f"{count} poses"
        return words if len(self) == count else f"{len(self)} observations in {words}"

    def __len__(self) -> int:
        """Return the number of rows N."""
        return len(self.rows)

    @property
    def size(self) -> float:
        """Size of the workspace: rms distance of the points from their mean [m]."""
        return float(np.sqrt(np.sum(np.var(self.p_WH, axis=0))))

    def select(self, keep: NDArray) -> "Observations":
        """Return the chosen rows. `keep` is a boolean mask or an index."""
        arrays = ["angles", "marker", "p_WH", "sample", "pose", "visit", "rows", "approach"]
        if self.stretch is not None:
            arrays.append("stretch")
        return replace(self, **{name: getattr(self, name)[keep] for name in arrays})

    def with_spread(self, covariances: NDArray) -> "Observations":
        """Return the same of a sensor that is not alike in all directions.

        Args:
            covariances: Of each point, over the variance of a typical coordinate. (N, 3, 3).
        """
        return replace(self, stretch=np.linalg.cholesky(covariances))

    def alike(self, columns: NDArray) -> NDArray:
        """Return columns of the rows' points in coordinates in which the sensor errs alike.

        Args:
            columns: In space [m, or m by some parameter]. Shape (N, 3, m).
        """
        return columns if self.stretch is None else np.linalg.solve(self.stretch, columns)

    def predicted(self, arm: DhParameters) -> tuple[NDArray, NDArray]:
        """Return where an arm has the tracked points, as `DhParameters.predict`."""
        return arm.predict(self.angles, self.marker, self.approach)

    @property
    def poses(self) -> NDArray:
        """Numbers of the poses, each once, ascending."""
        return np.unique(self.pose)

    def by_pose(self, errors: NDArray, chosen: NDArray | None = None) -> NDArray:
        """Return the mean error of each pose over its chosen rows.

        Args:
            errors: Of all rows. Shape (N,).
            chosen: Boolean, shape (N,); all if omitted.

        Returns:
            Shape (poses with a chosen row,).
        """
        pose = self.pose if chosen is None else self.pose[chosen]
        errors = errors if chosen is None else errors[chosen]
        of = np.unique(pose, return_inverse=True)[1]
        return np.bincount(of, errors) / np.maximum(np.bincount(of), 1)

    def thinned(self, rows: int, rng: np.random.Generator) -> "Observations":
        """Return whole poses drawn at random, about so many rows of them in all."""
        if len(self) <= rows:
            return self
        poses = self.poses
        count = max(round(rows * len(poses) / len(self)), 1)
        return self.select(np.isin(self.pose, rng.permutation(poses)[:count]))


def _servo_units(dataset: Dataset) -> ServoMap:
    """Return servos with the units that the data set states, offset 0 and gear 1."""
    joints = dataset.joints
    return ServoMap(
        dataset.joint_names,
        offset=np.zeros(len(joints)),
        gear=np.ones(len(joints)),
        unit=tuple(joint.encoder_unit for joint in joints),
        counts_per_turn=np.array([joint.counts_per_turn or np.nan for joint in joints]),
        sign=np.array([float(joint.sign) for joint in joints]),
    )


def gears_known(units: ServoMap) -> NDArray:
    """Return which joints are read in rad or deg, whose gear is 1 unless freed. Shape (n,)."""
    return np.array([unit != "counts" for unit in units.unit])
