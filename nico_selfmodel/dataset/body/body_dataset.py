"""What any sensors measured of any body, at which poses."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.body.link_joint import LinkJoint, coupling_of, parents_of
from nico_selfmodel.dataset.body.sensors import (
    CAMERA,
    PAIRS,
    SENSOR_COLUMNS,
    MarkerInfo,
    SensorInfo,
    check_free_joints,
)
from nico_selfmodel.dataset.poses import mean_of_visits, pose_numbers
from nico_selfmodel.errors import DataError
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vectors_of
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import FLANGE, FREE, WORLD, WORLD_NAME
from nico_selfmodel.names import check_name, listed

WIDTH = 6
"""Columns of `Observations.values`."""
ANY_POSE = -1
"""Pose of an observation that is the same in all: the distance of two markers of one link."""
COLUMNS = ("pose", "sensor", "marker", "other", "values", "mirror")
"""Arrays of an `ObservationTable`, in its order."""


@dataclass(frozen=True, eq=False)
class ObservationTable:
    """Who saw what, when: one row an observation."""

    pose: NDArray
    """Index of the sample; `ANY_POSE` for what does not depend on it. Shape (N,)."""
    sensor: NDArray
    """Index of the sensor. Shape (N,)."""
    marker: NDArray
    """Index of the marker. Shape (N,)."""
    other: NDArray
    """Index of the second marker of a distance or contact, -1 else. Shape (N,)."""
    values: NDArray
    """What was measured, in the columns of the sensor's kind, then nan. Shape (N, 6)."""
    mirror: NDArray = field(default_factory=lambda: np.zeros(0, dtype=str))
    """Mirror in which a camera saw the marker, empty where directly, as all if omitted. Text, shape
    (N,)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for key in ("pose", "sensor", "marker", "other"):
            object.__setattr__(self, key, read_only(getattr(self, key), np.int64))
        object.__setattr__(self, "values", read_only(self.values, float))
        mirror = self.mirror if np.size(self.mirror) else np.full(len(self.pose), "")
        object.__setattr__(self, "mirror", read_only(mirror, str))

    def __len__(self) -> int:
        """Return the number of observations."""
        return len(self.pose)

    def select(self, keep: NDArray) -> "ObservationTable":
        """Return some of the rows. `keep` is a boolean mask or an index."""
        return ObservationTable(*(getattr(self, key)[keep] for key in COLUMNS))


@dataclass(frozen=True, eq=False)
class BodyDataset:
    """A recording: joints, markers, sensors, readings by sample, observations.

    Raises:
        DataError: If its parts contradict each other.
    """

    name: str
    """Name of the data set."""
    joints: tuple[LinkJoint, ...]
    """The n joints; a parent stands before its children."""
    markers: tuple[MarkerInfo, ...]
    """What is seen."""
    sensors: tuple[SensorInfo, ...]
    """What sees."""
    sample: NDArray
    """Numbers of the P samples. Shape (P,)."""
    readings: NDArray
    """Readings in each joint's own unit; nan where a joint has no encoder. Shape (P, n)."""
    observations: ObservationTable
    """What was measured."""
    flanges: NDArray | None = None
    """Poses that controllers read, by joint: x, y, z [m] and rotation vector [rad]; nan where a
    joint is none. Shape (P, n, 6)."""
    approach: NDArray | None = None
    """How each reading last changed, -1 or 1; 0 where it is not known, as all are if omitted.
    Shape (P, n)."""
    source: str = ""
    """Where the data come from, in free text."""
    seed: int | None = None
    """Seed of the simulation, if simulated."""

    def __post_init__(self) -> None:
        """Check everything and make the arrays read-only."""
        check_name(self.name, "the name of a data set")
        n, count = len(self.joints), len(self.sample)
        check_names(self.joints, self.markers, self.sensors)
        parents_of(self.joints)
        coupling_of(self.joints)
        check_free_joints(self.joints, self.markers, self.sensors)
        object.__setattr__(self, "sample", read_only(self.sample, np.int64))
        object.__setattr__(self, "readings", read_only(self.readings, float))
        flanges = np.broadcast_to(np.nan, (count, n, 6))
        flanges = flanges if self.flanges is None else read_only(self.flanges, float)
        object.__setattr__(self, "flanges", flanges)
        if self.readings.shape != (count, n) or np.shape(flanges) != (count, n, 6):
            raise ValueError(f"readings must have shape ({count}, {n}), got {self.readings.shape}")
        approach = np.zeros((count, n)) if self.approach is None else self.approach
        object.__setattr__(self, "approach", read_only(approach, np.int8))
        if np.shape(approach) != (count, n) or not np.isin(approach, (-1, 0, 1)).all():
            raise ValueError(f"approach must be -1, 0 or 1, of shape ({count}, {n})")
        if not count:
            raise DataError("there must be one sample or more")
        numbers, times = np.unique(self.sample, return_counts=True)
        if times.max() > 1:
            twice = listed(numbers[times > 1].tolist())
            raise DataError(
                f"each sample must have its own number; more than once there is {twice}"
            )
        _check_readings(self)
        _check_observations(self)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Names of the mirrors in which something was seen."""
        return tuple(sorted(set(self.observations.mirror.tolist()) - {""}))

    @cached_property
    def si_readings(self) -> NDArray:
        """Readings in rad and m, of a visit their mean, 0 of a joint without encoder. (P, n)."""
        return mean_of_visits(self.si_as_read, self.visit)

    @cached_property
    def si_as_read(self) -> NDArray:
        """`si_readings` as they were read. Shape (P, n)."""
        return np.nan_to_num(self.readings * [joint.si_per_unit for joint in self.joints])

    @cached_property
    def si_approach(self) -> NDArray:
        """How each joint last moved, in the sense of `si_readings`. Shape (P, n)."""
        return np.asarray(self.approach) * np.sign([joint.si_per_unit for joint in self.joints])

    @cached_property
    def X_flange(self) -> NDArray:
        """Poses that controllers read; the identity where there is none. Shape (P, n, 4, 4)."""
        told = self._flange_joints
        still = np.broadcast_to(np.eye(4), (*self.readings.shape, 4, 4))
        if not len(told):
            return still
        values = np.nan_to_num(np.asarray(self.flanges)[:, told])
        out = still.copy()
        out[:, told] = transform(rotation_from_vector(values[..., 3:]), values[..., :3])
        return out

    @property
    def _flange_joints(self) -> NDArray:
        """Joints whose poses were told at some sample. Shape (K,)."""
        return np.flatnonzero(np.isfinite(np.asarray(self.flanges)[..., 0]).any(axis=0))

    @cached_property
    def pose(self) -> NDArray:
        """Number of each sample's pose: samples with equal readings are one. Shape (P,)."""
        return self._numbers[0]

    @cached_property
    def visit(self) -> NDArray:
        """Number of each sample's visit: each time it came to a pose is one. Shape (P,)."""
        return self._numbers[1]

    @cached_property
    def _numbers(self) -> tuple[NDArray, NDArray]:
        flanges = self.X_flange[:, self._flange_joints].reshape(len(self.sample), -1)
        all_read, every = np.hstack([self.si_as_read, flanges]), np.arange(len(self.sample))
        if self.free_joints:  # nobody read whether what moves freely stayed where it was
            seen = self.observations.pose[np.isin(self.seen_on, self.free_joints)]
            own = np.where(np.isin(every, seen), every + 1, 0)
            all_read = np.hstack([all_read, own[:, None]])
        return pose_numbers(self.sample, all_read, self.approach)

    @property
    def free_joints(self) -> tuple[int, ...]:
        """Which joints move freely: their pose is learned in each sample. They stand last."""
        return tuple(i for i, joint in enumerate(self.joints) if joint.motion == FREE)

    @cached_property
    def seen_on(self) -> NDArray:
        """Joint whose link carries the marker of each observation, `WORLD` for none. Shape (N,)."""
        return np.array([self.on_link(m.on) for m in self.markers])[self.observations.marker]

    def on_link(self, on: str) -> int:
        """Return the index of the joint whose link a marker or sensor is on, or `WORLD`."""
        return WORLD if on == WORLD_NAME else self.joint_names.index(on)

    def width(self, sensor: int) -> int:
        """Return how many numbers an observation of a sensor has."""
        return len(SENSOR_COLUMNS[self.sensors[sensor].kind])

    def select(self, samples: ArrayLike) -> "BodyDataset":
        """Return some samples with what was seen at them, and what belongs to none.

        Args:
            samples: Boolean mask over the samples. Shape (P,).

        Raises:
            DataError: If none is left.
        """
        keep = np.asarray(samples, dtype=bool)
        table = self.observations
        new = np.append(np.cumsum(keep) - 1, ANY_POSE)
        rows = np.append(keep, True)[table.pose]
        chosen = table.select(rows)
        return replace(
            self,
            sample=self.sample[keep],
            readings=self.readings[keep],
            flanges=np.asarray(self.flanges)[keep],
            approach=np.asarray(self.approach)[keep],
            observations=replace(chosen, pose=new[chosen.pose]),
        )

    def of_rows(self, rows: NDArray) -> "BodyDataset":
        """Return the same poses with some of what was seen. Boolean mask or index.

        Raises:
            DataError: If nothing is left.
        """
        return replace(self, observations=self.observations.select(rows))

    def like(self, other: "BodyDataset") -> "BodyDataset":
        """Return this recording with another's markers and sensors, of the same joints.

        Args:
            other: A recording of the same body.

        Raises:
            DataError: If it has other joints, or knows not all markers and sensors of this one.
        """
        if self.joint_names != other.joint_names:
            raise DataError(
                f"data set {self.name!r} has the joints {listed(self.joint_names)}, "
                f"{other.name!r} has {listed(other.joint_names)}: both must be of one body"
            )
        table, moved = self.observations, {}
        for key in ("markers", "sensors"):
            names = [item.name for item in getattr(other, key)]
            unknown = sorted({item.name for item in getattr(self, key)} - set(names))
            if unknown:
                raise DataError(
                    f"{key} {listed(unknown)} of data set {self.name!r} are not in "
                    f"{other.name!r}, which has {listed(names)}"
                )
            moved[key] = np.array([names.index(i.name) for i in getattr(self, key)] + [-1])
        new = replace(
            table,
            marker=moved["markers"][table.marker],
            other=moved["markers"][table.other],
            sensor=moved["sensors"][table.sensor],
        )
        return replace(self, markers=other.markers, sensors=other.sensors, observations=new)

    def with_whole_poses(self, X: NDArray) -> "BodyDataset":
        """Return the recording with other poses of flanges and of what moves freely.

        Args:
            X: By sample and joint. Shape (P, n, 4, 4).
        """
        values = np.concatenate([X[..., :3, 3], rotation_vectors_of(X[..., :3, :3])], axis=-1)
        return replace(self, flanges=values)

    def split(self, fraction: float, seed: int) -> tuple["BodyDataset", "BodyDataset"]:
        """Split into training and test data by pose.

        Args:
            fraction: Share of the poses that goes into the test part, 0 to 1 exclusive.

        Raises:
            ValueError: If `fraction` is not between 0 and 1.
            DataError: If there are fewer than two poses.
        """
        if not 0.0 < fraction < 1.0:
            raise ValueError(f"fraction must be between 0 and 1, exclusive, got {fraction}")
        seen = np.isin(np.arange(len(self.sample)), self.observations.pose)
        pool = np.unique(self.pose[seen])
        if len(pool) < 2:
            raise DataError(f"cannot split {len(pool)} poses: record more")
        count = min(max(round(fraction * len(pool)), 1), len(pool) - 1)
        test = np.isin(self.pose, np.random.default_rng(seed).permutation(pool)[:count])
        held = self.select(test)
        own = held.observations.pose != ANY_POSE
        return self.select(~test), replace(held, observations=held.observations.select(own))


def check_names(
    joints: Sequence[LinkJoint], markers: Sequence[MarkerInfo], sensors: Sequence[SensorInfo]
) -> None:
    """Refuse names that stand twice, and what is on no link.

    Raises:
        DataError: If there are such.
    """
    links = (WORLD_NAME, *(joint.name for joint in joints))
    names = [*links[1:], *(m.name for m in markers), *(s.name for s in sensors)]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DataError(
            f"{listed(twice)} stands more than once among joints, markers and sensors: an id on "
            "two links cannot be told apart, give each its own name"
        )
    for item in (*markers, *sensors):
        if item.on not in links:
            raise DataError(
                f"{item.name!r} is on {item.on!r}, which is no link; there are "
                f"{listed(links, item.on)}"
            )


def _check_readings(data: BodyDataset) -> None:
    for i, joint in enumerate(data.joints):
        if joint.motion == FLANGE:
            bad = ~np.isfinite(np.asarray(data.flanges)[:, i]).all(axis=1)
            what = "the pose"
        elif not joint.is_read:
            continue
        else:
            bad, what = ~np.isfinite(data.readings[:, i]), "the reading"
        if bad.any():
            where = f"sample {data.sample[np.argmax(bad)]}: {what} of joint {joint.name!r}"
            raise DataError(f"{where} is missing or not finite")


def _check_observations(data: BodyDataset) -> None:
    table, count = data.observations, len(data.sample)
    if not len(table):
        raise DataError("the data set has no observations; expected at least one")
    if (table.pose < ANY_POSE).any() or (table.pose >= count).any():
        raise DataError(f"an observation is of a pose that is none of the {count}")
    if not ((table.marker >= 0) & (table.marker < len(data.markers))).all():
        raise DataError("an observation is of a marker that is not listed")
    if not ((table.sensor >= 0) & (table.sensor < len(data.sensors))).all():
        raise DataError("an observation is of a sensor that is not listed")
    _check_mirrors(data)
    widths = np.array([data.width(i) for i in range(len(data.sensors))])[table.sensor]
    given = np.isfinite(table.values)
    bad = (given != (np.arange(WIDTH) < widths[:, None])).any(axis=1)
    if bad.any():
        row = int(np.argmax(bad))
        sensor = data.sensors[table.sensor[row]]
        raise DataError(
            f"observation {row} of sensor {sensor.name!r} ({sensor.kind}) needs "
            f"{', '.join(SENSOR_COLUMNS[sensor.kind]) or 'no number'}, all of them and nothing else"
        )
    pairs = np.array([s.kind in PAIRS for s in data.sensors])[table.sensor]
    wrong = pairs != (table.other >= 0)
    if wrong.any():
        raise DataError(
            f"observation {int(np.argmax(wrong))}: a distance or contact, and nothing else, has a "
            "second marker ('other')"
        )
    on = np.array([data.on_link(m.on) for m in data.markers])
    loose = (table.pose == ANY_POSE) & (~pairs | (on[table.marker] != on[table.other]))
    if loose.any():
        row = int(np.argmax(loose))
        both = [data.markers[i] for i in (table.marker[row], table.other[row]) if i >= 0]
        raise DataError(
            f"observation {row} ({listed([f'{m.name} on {m.on}' for m in both])}) has no sample: "
            "only the distance of two markers of one link is the same in all of them"
        )


def _check_mirrors(data: BodyDataset) -> None:
    table = data.observations
    if table.mirror.shape != table.pose.shape:
        raise ValueError(f"mirror must have shape {table.pose.shape}, got {table.mirror.shape}")
    for mirror in data.mirrors:
        check_name(mirror, "a mirror")
    others = np.array([s.kind != CAMERA for s in data.sensors])[table.sensor]
    wrong = others & (table.mirror != "")
    if wrong.any():
        row = int(np.argmax(wrong))
        sensor = data.sensors[table.sensor[row]]
        raise DataError(
            f"observation {row} of sensor {sensor.name!r} ({sensor.kind}) names mirror "
            f"{str(table.mirror[row])!r}: only a camera sees markers in a mirror"
        )
