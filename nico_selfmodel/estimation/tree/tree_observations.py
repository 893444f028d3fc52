"""The observations of a recording, laid out for one adjustment: rows by sensor, scalars by row."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.link_joint import parents_of
from nico_selfmodel.dataset.body.sensors import (
    CAMERA,
    FIRST_SIGMA,
    FIRST_TURN_SIGMA,
    POINTS,
    POSES,
    SENSOR_COLUMNS,
    SIGHTS,
)
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.tree.noise.finer_noise import (
    PARTS,
    noises_of_places,
    noises_of_turns,
)
from nico_selfmodel.geometry.rotation import turned_to_z
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import FREE, WHOLE_POSES, WORLD_NAME

ENOUGH_TOUCHES = 20
"""Poses of a sensor that sees nothing from which on they tell its standard deviation."""
_IN_SPACE = (POINTS, POSES)
"""What is measured by a frame of which z is the line of sight."""
BEARING = "bearing"
"""A camera whose pixels are taken as directions, which no point behind it can trap."""


@dataclass(frozen=True, eq=False)
class SensorRows:
    """The observations of one sensor, directly or in one mirror."""

    sensor: int
    """Index of the sensor."""
    name: str
    """Its name."""
    kind: str
    """Its kind."""
    rows: NDArray
    """Rows of the table. Shape (N,)."""
    pose: NDArray
    """Samples they are of; the first for what is the same in all. Shape (N,)."""
    marker: NDArray
    """Markers. Shape (N,)."""
    other: NDArray
    """Second markers of distances and contacts. Shape (N,)."""
    measured: NDArray
    """What was measured; of contacts and planes, which tell that nothing is between, 0. (N, k)."""
    first: int
    """Where its scalars begin among all."""
    mirror: str = ""
    """Mirror in which they were seen; empty where directly."""
    apart: bool = False
    """Whether no joint moves them: of what moves freely, by a sensor that stands in the world."""

    @property
    def scalars(self) -> slice:
        """Where its scalars are among all."""
        return slice(self.first, self.first + self.measured.size)

    @property
    def in_sight(self) -> NDArray:
        """What was measured as residuals are, z along the line of sight. Shape (N, k)."""
        if self.kind not in _IN_SPACE:
            return self.measured
        parts = self.measured.reshape(len(self.rows), -1, 3)
        turned = parts @ np.swapaxes(turned_to_z(parts[:, 0]), 1, 2)
        return turned.reshape(self.measured.shape)

    def only(self, own: NDArray, first: int = 0) -> "SensorRows":
        """Return some of its rows, `first` among all scalars. Boolean, shape (N,)."""
        keys = ("rows", "pose", "marker", "other", "measured")
        return replace(self, first=first, **{k: getattr(self, k)[own] for k in keys})


@dataclass(frozen=True, eq=False)
class TreeObservations:
    """All observations of a recording, sensor by sensor."""

    data: BodyDataset
    """The recording."""
    sensors: tuple[SensorRows, ...]
    """Those that measured something."""

    @classmethod
    def of(cls, data: BodyDataset, keep: NDArray | None = None) -> "TreeObservations":
        """Lay out a recording.

        Args:
            keep: Rows of its table that count; all if omitted. Boolean, shape (N,).
        """
        table, found, first = data.observations, [], 0
        chosen = np.ones(len(table), dtype=bool) if keep is None else keep
        alone = _apart(data)
        kinds = product(range(len(data.sensors)), ("", *data.mirrors), (False, True))
        for s, mirror, apart in kinds:
            own = (table.sensor == s) & (table.mirror == mirror) & (alone == apart) & chosen
            rows = np.flatnonzero(own)
            if not len(rows):
                continue
            kind = data.sensors[s].kind
            pose = np.where(table.pose[rows] == ANY_POSE, 0, table.pose[rows])
            seen = pose, table.marker[rows], table.other[rows]
            columns = len(SENSOR_COLUMNS[kind])
            measured = table.values[rows, :columns] if columns else np.zeros((len(rows), 1))
            name = data.sensors[s].name
            found.append(SensorRows(s, name, kind, rows, *seen, measured, first, mirror, apart))
            first += measured.size
        return cls(data, tuple(found))

    def on_free_joints(self) -> "TreeObservations":
        """Return what was seen of what moves freely."""
        found, first = [], 0
        for rows in self.sensors:
            own = np.isin(self.data.seen_on[rows.rows], self.data.free_joints)
            if own.any():
                found.append(rows.only(own, first))
                first += found[-1].measured.size
        return TreeObservations(self.data, tuple(found))

    @cached_property
    def scalars(self) -> int:
        """How many numbers were measured, R."""
        return sum(rows.measured.size for rows in self.sensors)

    @cached_property
    def row(self) -> NDArray:
        """Row of the table of each scalar. Shape (R,)."""
        return np.concatenate([np.repeat(s.rows, s.measured.shape[1]) for s in self.sensors])

    @cached_property
    def visit(self) -> NDArray:
        """Visit of each scalar. Shape (R,).

        What no joint moves is dealt out to visits of its own, last, no larger than others: its rows
        have nothing to do with each other.
        """
        shared, apart = self.sample_visit, self.apart
        most = max(int(np.bincount(shared[~apart], minlength=1).max()), 6)
        dealt = shared.max() + 1 + np.cumsum(apart) // most
        return np.where(apart, dealt, shared)

    @cached_property
    def sample_visit(self) -> NDArray:
        """Visit of each scalar's sample; what is the same in all has its own. Shape (R,)."""
        table = self.data.observations
        of_row = np.append(self.data.visit, ANY_POSE)[table.pose]
        alone = of_row == ANY_POSE
        of_row = np.where(alone, self.data.visit.max() + 1 + np.cumsum(alone), of_row)
        return of_row[self.row]

    @cached_property
    def visits(self) -> int:
        """How many visits of samples there are."""
        return int(self.sample_visit.max()) + 1

    @cached_property
    def pose(self) -> NDArray:
        """Pose of each scalar; what is the same in all has one of its own. Shape (R,)."""
        table = self.data.observations
        of_row = np.append(self.data.pose, ANY_POSE)[table.pose]
        alone = of_row == ANY_POSE
        return np.where(alone, self.data.pose.max() + 1 + np.cumsum(alone), of_row)[self.row]

    def groups(self, outliers: NDArray) -> PoseGroups:
        """Return what belongs to one visit. Outliers by row of the table, boolean, shape (N,)."""
        place = np.where(self.apart, self.pose.max() + 1 + self.visit, self.pose)
        return PoseGroups(self.visit, ~outliers[self.row], 1, place)

    @cached_property
    def noise_groups(self) -> tuple[str, ...]:
        """Names of what has a standard deviation of its own: sensors, and their orientations.

        What no joint moves has one of its own where the sensor sees more: corners of boards are
        found otherwise than markers. What is along the line of sight of a sensor of places or poses
        has one, and turns about it, see `noise.finer_noise`.
        """
        return tuple(self._first_of_noise)

    @cached_property
    def _first_of_noise(self) -> dict[str, tuple[SensorRows, int]]:
        """Rows that have each noise first, and its place among theirs; in mirrors as directly."""
        found: dict[str, tuple[SensorRows, int]] = {}
        for rows in self.sensors:
            for i, name in enumerate(self._noises(rows)):
                found.setdefault(name, (rows, i))
        return found

    def _noises(self, rows: SensorRows) -> tuple[str, ...]:
        """Return the names of what has a standard deviation of its own in some rows."""
        info = self.data.sensors[rows.sensor]
        name = info.noise or info.name
        if rows.apart and not self._all_apart:
            name += " boards"
        if rows.kind not in _IN_SPACE:
            return (name,)
        turns = noises_of_turns(name) if rows.kind == POSES else ()
        return (*noises_of_places(name), *turns)

    @cached_property
    def _all_apart(self) -> bool:
        return all(rows.apart for rows in self.sensors)

    @cached_property
    def noise_group(self) -> NDArray:
        """Index into `noise_groups` of each scalar. Shape (R,)."""
        parts = []
        for rows in self.sensors:
            own = np.array([self.noise_groups.index(name) for name in self._noises(rows)])
            k = rows.measured.shape[1]
            one = own[PARTS[:k]] if rows.kind in _IN_SPACE else np.repeat(own, k)
            parts.append(np.tile(one, len(rows.rows)))
        return np.concatenate(parts)

    @cached_property
    def stated_sigma(self) -> NDArray:
        """Standard deviation of each noise group as stated, or as first taken. Shape (G,)."""
        out = []
        for rows, part in self._first_of_noise.values():
            info = self.data.sensors[rows.sensor]
            turn = info.turn_sigma or FIRST_TURN_SIGMA
            turns = part >= PARTS[3]
            out.append(turn if turns else info.sigma or FIRST_SIGMA[info.kind])
        return np.array(out)

    @cached_property
    def sigma_held(self) -> NDArray:
        """Which noise groups keep what is stated: few distances and touches tell no sigma. (G,)."""
        held = []
        for rows, _ in self._first_of_noise.values():
            stated = self.data.sensors[rows.sensor].sigma is not None
            few = len(np.unique(rows.pose)) < ENOUGH_TOUCHES
            held.append(rows.kind not in SIGHTS and (stated or few))
        return np.array(held)

    @cached_property
    def apart(self) -> NDArray:
        """Which scalars no joint moves, see `SensorRows.apart`. Boolean, shape (R,)."""
        return np.concatenate([np.full(rows.measured.size, rows.apart) for rows in self.sensors])

    @cached_property
    def noisy_joints(self) -> tuple[tuple[int, int], ...]:
        """What is read with noise, or not at all: joint and part, 0 to 5 of a whole pose."""
        return tuple(
            (i, part)
            for i, joint in enumerate(self.data.joints)
            if not joint.follows
            for part in range(6 if joint.motion in WHOLE_POSES else 1)
        )

    @cached_property
    def unread(self) -> NDArray:
        """Which of `noisy_joints` nobody reads: parts of poses that are learned. Shape (m,)."""
        joints = self.data.joints
        return np.array([joints[i].motion == FREE for i, _ in self.noisy_joints], dtype=bool)

    @cached_property
    def moved(self) -> NDArray:
        """How far each of `noisy_joints` was read to move [rad or m]; 0 of whole poses. (m,)."""
        moved = np.ptp(np.asarray(self.data.si_readings), axis=0)
        joints = self.data.joints
        return np.array(
            [0.0 if joints[i].motion in WHOLE_POSES else moved[i] for i, _ in self.noisy_joints]
        )

    def joint_groups(self, apart: Collection[int] = (), *, by_limb: bool = False) -> NDArray:
        """Return which of `noisy_joints` share a standard deviation: joints of one motion.

        A flange's turns do, and its shifts.

        Args:
            apart: Those that share theirs with no other.
            by_limb: Whether only joints of one limb do, on the way to the same ends of the tree.

        Returns:
            Numbers of groups, in their order of appearance. Shape (m,).
        """
        limbs = _limbs(parents_of(self.data.joints)) if by_limb else [()] * len(self.data.joints)
        numbers: dict[tuple[object, ...], int] = {}
        found = []
        for k, (i, part) in enumerate(self.noisy_joints):
            joint = self.data.joints[i]
            whole = joint.motion in WHOLE_POSES or k in apart
            key = (joint.name, part // 3) if whole else (joint.motion, limbs[i])
            numbers.setdefault(key, len(numbers))
            found.append(numbers[key])
        return np.array(found, dtype=int)

    def unread_in(self, visits: int, slipped: NDArray | None = None) -> NDArray | None:
        """Return what says nothing in each visit: what slipped, and what nobody reads.

        Args:
            visits: How many there are.
            slipped: Boolean, shape (visits, m).

        Returns:
            Boolean, shape (visits, m); None where there is no such thing.
        """
        if not self.unread.any():
            return slipped
        unread = np.tile(self.unread, (visits, 1))
        return unread if slipped is None else slipped | unread

    @cached_property
    def sample(self) -> NDArray:
        """Sample of each scalar; the first for what is the same in all. Shape (R,)."""
        return np.concatenate([np.repeat(s.pose, s.measured.shape[1]) for s in self.sensors])

    def as_bearings(self, lenses: Mapping[str, Camera]) -> "TreeObservations":
        """Return the same with unit directions in place of pixels, where a pixel has one.

        Args:
            lenses: Intrinsics of every camera, by name.
        """
        found, first = [], 0
        for rows in self.sensors:
            if rows.kind == CAMERA:
                lens = lenses[rows.name]
                rays = lens.directions(rows.measured)
                # At a fold of its lens a camera may have no ray for a pixel.
                there = np.asarray(np.isfinite(rays).all(axis=1))
                rows = replace(rows.only(there), kind=BEARING, measured=rays[there])
            found.append(replace(rows, first=first))
            first += rows.measured.size
        return TreeObservations(self.data, tuple(found))

    def per_row(self, values: NDArray) -> NDArray:
        """Return sums of values of scalars by row of the table. Shape (R,) -> (N,)."""
        return np.bincount(self.row, values, minlength=len(self.data.observations))


def _limbs(parent: NDArray) -> list[tuple[int, ...]]:
    """Return the ends of the tree, joints that carry no other, that each joint moves."""
    ends = [i for i in range(len(parent)) if i not in parent]
    out: list[tuple[int, ...]] = [()] * len(parent)
    for end in ends:
        joint = end
        while joint >= 0:
            out[joint] = (*out[joint], end)
            joint = int(parent[joint])
    return out


def _apart(data: BodyDataset) -> NDArray:
    """Return which observations no joint moves. Boolean, by row of the table, shape (N,).

    What moves freely is apart in a sample where all that saw it there stand in the world.
    """
    table = data.observations
    stands = np.array([sensor.on == WORLD_NAME for sensor in data.sensors])[table.sensor]
    free = np.isin(data.seen_on, data.free_joints) & (table.other < 0)
    of = table.pose * (len(data.joints) + 1) + data.seen_on
    return np.asarray(free & ~np.isin(of, of[free & ~stands]))
