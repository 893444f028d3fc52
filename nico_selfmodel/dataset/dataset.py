"""What a body sensed: encoder readings and, beside them, where its hand was seen."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.columns import (
    DEFAULT_MARKER,
    JOINT_COLUMNS,
    PIXEL_COLUMNS,
    POINT_COLUMNS,
    SIDES_OF_APPROACH,
)
from nico_selfmodel.dataset.joint_info import HOME, JointInfo
from nico_selfmodel.dataset.poses import pose_numbers
from nico_selfmodel.dataset.row_checks import check_rows, row_place
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import LARGEST
from nico_selfmodel.names import check_name, shown

SIGMA_RANGES = {"point_sigma_m": (1e-9, 1.0), "pixel_sigma_px": (1e-9, 100.0)}
"""What a sensor's noise can be: from an interferometer's nanometre to satellite positioning, and
from the rounding of exact pixels to a hand that points at a picture."""
_TABLE_COLUMNS = ("sample", "sweep", "marker", "mirror", *POINT_COLUMNS, *PIXEL_COLUMNS)
# A default that type checkers take for an array; the constructor fills it in.
_NOT_GIVEN: Any = None


@dataclass(frozen=True, eq=False)
class Dataset:
    """One row per pose and tracked point: encoder readings, and what was seen of the point.

    Arrays are read-only copies. `dataclasses.replace` makes a changed copy, checked again.

    Raises:
        ValueError: If a shape or type is wrong.
        DataError: If the rows contradict each other (see `row_checks.check_rows`).
    """

    name: str
    """Name of the data set."""
    joints: tuple[JointInfo, ...]
    """The n joints, from the base to the hand."""
    sample: npt.NDArray[np.int64]
    """Number of the pose; rows of one pose (several markers or mirrors) share it. Shape (N,)."""
    encoders: npt.NDArray[np.float64]
    """Raw encoder readings [unit of each joint]. Shape (N, n)."""
    p_WH_measured: npt.NDArray[np.float64] = _NOT_GIVEN
    """Measured point on the hand [m]; nan where not measured. Shape (N, 3)."""
    sweep: npt.NDArray[np.str_] = _NOT_GIVEN
    """Joint whose circle the row belongs to, `home` for the shared home pose, or empty for a
    free pose. Shape (N,)."""
    marker: npt.NDArray[np.str_] = _NOT_GIVEN
    """Name of the tracked point; `hand` unless given. Shape (N,)."""
    pixels: npt.NDArray[np.float64] = _NOT_GIVEN
    """Left u, v and right u, v of the point [px]; nan where not seen. Shape (N, 4)."""
    mirror: npt.NDArray[np.str_] = _NOT_GIVEN
    """Name of the mirror that the pixels are a reflection in, or empty. Shape (N,)."""
    approach: npt.NDArray[np.int8] = _NOT_GIVEN
    """How each reading changed when the joint last moved: -1 or 1; 0 where it is not known, as all
    are unless given, and in a changed copy with other rows. Shape (N, n)."""
    point_sigma_m: float | None = None
    """Standard deviation of each measured coordinate [m], if known."""
    pixel_sigma_px: float | None = None
    """Standard deviation of each pixel coordinate [px], if known."""
    image_size: tuple[int, int] | None = None
    """Width and height of the images [px], if there are pixels."""
    cameras: dict[str, Any] | None = None
    """Plain data about the cameras, if images were kept."""
    source: str = ""
    """Where the data come from, in free text."""
    seed: int | None = None
    """Seed of the simulation, if simulated."""
    extra: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Other columns of the table: name to N texts. Kept and not used."""

    def __post_init__(self) -> None:
        """Fill in defaults, copy the arrays and check everything."""
        self._set("joints", tuple(self.joints))
        self._check_metadata()
        count = self._set_sample()
        self._set("encoders", _floats(self.encoders, count, len(self.joints), "encoders"))
        if np.isnan(self.encoders).any():
            row, joint = (int(i) for i in np.argwhere(np.isnan(self.encoders))[0])
            raise DataError(
                f"{row_place(row)}: the reading of joint {self.joint_names[joint]!r} is"
                f" {self.encoders[row, joint]}; expected a finite number"
            )
        self._set("approach", _sides(self.approach, self.encoders.shape))
        self._set("p_WH_measured", _floats(self.p_WH_measured, count, 3, "p_WH_measured"))
        self._set("pixels", _floats(self.pixels, count, 4, "pixels"))
        self._set("sweep", _texts(self.sweep, count, "", "sweep"))
        self._set("marker", _texts(self.marker, count, DEFAULT_MARKER, "marker"))
        self._set("mirror", _texts(self.mirror, count, "", "mirror"))
        self._set("cameras", copy.deepcopy(self.cameras))
        self._set("extra", self._checked_extra(count))
        check_rows(vars(self), self.joint_names, row_place)

    def _set(self, key: str, value: Any) -> None:
        object.__setattr__(self, key, value)

    def _set_sample(self) -> int:
        sample = np.asarray(self.sample)
        if sample.ndim != 1 or not (sample.size == 0 or np.issubdtype(sample.dtype, np.integer)):
            raise ValueError(
                "sample must hold whole numbers and have shape (N,), got"
                f" {sample.dtype} of shape {sample.shape}"
            )
        if sample.size == 0:
            raise DataError("the data set has no rows; expected at least one")
        self._set("sample", read_only(sample, np.int64))
        return sample.size

    def _check_metadata(self) -> None:
        check_name(self.name, "the name of a data set")
        if not self.joints or not all(isinstance(joint, JointInfo) for joint in self.joints):
            raise ValueError(f"joints must be one or more JointInfo, got {self.joints!r}")
        names = self.joint_names
        repeated = [name for name in names if names.count(name) > 1]
        if repeated:
            raise DataError(f"joint {repeated[0]!r} appears more than once; names must differ")
        for key, (least, most) in SIGMA_RANGES.items():
            value = getattr(self, key)
            if value is not None:
                if not least <= value <= most:
                    raise ValueError(
                        f"{key} must be positive, between {least:g} and {most:g}, got {value:g}; "
                        "leave it out where it is not known"
                    )
                self._set(key, float(value))
        if self.seed is not None and not abs(self.seed) < 2**128:
            raise ValueError(f"seed must have at most 128 bits, got {shown(self.seed)}")
        if self.image_size is not None:
            size = tuple(int(side) for side in self.image_size)
            if len(size) != 2 or min(size) <= 0:
                raise ValueError(
                    f"image_size must be a positive width and height, got {self.image_size}"
                )
            self._set("image_size", size)

    def _checked_extra(self, count: int) -> dict[str, tuple[str, ...]]:
        names = self.joint_names
        used = {*_TABLE_COLUMNS, *(f"{kind}.{name}" for kind in JOINT_COLUMNS for name in names)}
        extra = {}
        for name, cells in self.extra.items():
            check_name(name, "the name of an extra column")
            if name in used or len(cells) != count or not all(isinstance(c, str) for c in cells):
                raise ValueError(
                    f"extra column {name!r} must have a name of its own and {count} texts,"
                    f" got {len(cells)} cells"
                )
            if "\0" in "".join(cells):
                raise ValueError(f"extra column {name!r} holds a NUL byte, which no table can")
            extra[name] = tuple(cells)
        return extra

    def __len__(self) -> int:
        """Return the number of rows N."""
        return len(self.sample)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, from the base to the hand."""
        return tuple(joint.name for joint in self.joints)

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points, in the order of their first row."""
        return tuple(dict.fromkeys(self.marker.tolist()))

    @property
    def samples(self) -> npt.NDArray[np.int64]:
        """Numbers of the poses, each once, ascending."""
        return np.unique(self.sample)

    @cached_property
    def pose(self) -> npt.NDArray[np.int64]:
        """Number of each row's pose: rows with equal readings are one (see `poses`). Shape (N,)."""
        return pose_numbers(self.sample, self.encoders)[0]

    @cached_property
    def visit(self) -> npt.NDArray[np.int64]:
        """Number of each row's visit: each time the robot came to a pose is one. Shape (N,)."""
        return pose_numbers(self.sample, self.encoders, self.approach)[1]

    @property
    def measured(self) -> npt.NDArray[np.bool_]:
        """Rows in which the point itself was measured (x, y, z). Shape (N,)."""
        return ~np.isnan(self.p_WH_measured[:, 0])

    @property
    def encoder_span(self) -> npt.NDArray[np.float64]:
        """Largest minus smallest reading of each joint [encoder unit]. Shape (n,)."""
        return np.ptp(self.encoders, axis=0)

    def select(self, rows: npt.ArrayLike) -> "Dataset":
        """Return a data set of some of the rows.

        Args:
            rows: Boolean mask of shape (N,), or indices of rows.

        Returns:
            The rows, in the order asked for.

        Raises:
            ValueError: If `rows` is neither.
            DataError: If no row is left, or one is asked for twice.
        """
        index = self._row_index(rows)
        arrays = ("sample", "encoders", "approach", "p_WH_measured", "sweep", "marker", "pixels")
        arrays = (*arrays, "mirror")
        extra = {key: tuple(cells[i] for i in index) for key, cells in self.extra.items()}
        return replace(self, extra=extra, **{key: getattr(self, key)[index] for key in arrays})

    def _row_index(self, rows: npt.ArrayLike) -> npt.NDArray[np.int64]:
        rows = np.asarray(rows)
        if rows.dtype == np.bool_ and rows.shape == (len(self),):
            return np.flatnonzero(rows)
        valid = rows.ndim == 1 and (rows.size == 0 or np.issubdtype(rows.dtype, np.integer))
        if valid and (rows.size == 0 or -len(self) <= rows.min() <= rows.max() < len(self)):
            return rows.astype(np.int64)
        raise ValueError(
            f"rows must be a mask of shape ({len(self)},) or indices below {len(self)}, got"
            f" {rows.dtype} of shape {rows.shape}"
        )

    def split(
        self, fraction: float, seed: "int | np.random.Generator"
    ) -> tuple["Dataset", "Dataset"]:
        """Split into training and test data by pose, never rows of one pose apart.

        Samples with equal readings are one pose. The test part is drawn from the free poses (empty
        `sweep`), so that circles stay whole; only where there are none, from all poses but `home`.
        Poses of which nothing was seen stay in the training part.

        Args:
            fraction: Share of the poses drawn from that goes into the test part, 0 to 1
                exclusive; rounded, at least one pose.
            seed: Seed, or a generator.

        Returns:
            Training and test data, rows in their old order.

        Raises:
            ValueError: If `fraction` is not between 0 and 1.
            DataError: If there are too few poses to hold one out.
        """
        if not 0.0 < fraction < 1.0:
            raise ValueError(f"fraction must be between 0 and 1, exclusive, got {fraction}")
        seen = self.measured | np.isfinite(self.pixels).any(axis=1)
        poses = self.pose
        swept = np.unique(poses[self.sweep != ""])
        pool = np.setdiff1d(poses[seen], swept)
        if pool.size == 0:
            pool = np.setdiff1d(poses[seen], poses[self.sweep == HOME])
        count_of_all = int(poses.max()) + 1
        largest = min(pool.size, count_of_all - 1)
        if largest < 1:
            raise DataError(
                f"cannot split: {count_of_all} poses, {pool.size} of them measured and not"
                f" '{HOME}'; a test part needs one of these, and the training part one more pose"
            )
        count = min(max(round(fraction * pool.size), 1), largest)
        test = np.isin(poses, np.random.default_rng(seed).permutation(pool)[:count])
        return self.select(~test), self.select(test)


def _floats(values: Any, count: int, width: int, name: str) -> npt.NDArray[np.float64]:
    if values is None:
        return read_only(np.full((count, width), np.nan))
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (count, width):
        raise ValueError(f"{name} must have shape ({count}, {width}), got {array.shape}")
    largest = float(np.nanmax(np.abs(array), initial=0.0))
    if largest > LARGEST:
        raise DataError(
            f"{name} must be finite (nan where not measured) and at most {LARGEST:g}, got"
            f" {largest:g}"
        )
    return read_only(array)


def _sides(values: Any, shape: tuple[int, ...]) -> npt.NDArray[np.int8]:
    array = np.zeros(shape) if values is None else np.asarray(values)
    # A changed copy may have other rows: from which sides they came nobody said.
    if array.shape != shape and array.dtype == np.int8 and not array.flags.writeable:
        array = np.zeros(shape)
    if array.shape != shape or not np.isin(array, SIDES_OF_APPROACH).all():
        raise ValueError(f"approach must be -1, 0 or 1, of shape {shape}, got {shown(values)}")
    return read_only(array, np.int8)


def _texts(
    values: Sequence[str] | npt.NDArray[np.str_] | None, count: int, default: str, name: str
) -> npt.NDArray[np.str_]:
    array = np.full(count, default) if values is None else np.asarray(values)
    if array.shape != (count,) or array.dtype.kind not in "UO":
        raise ValueError(
            f"{name} must hold text and have shape ({count},), got {array.dtype} of shape"
            f" {array.shape}"
        )
    return read_only(array, np.str_)
