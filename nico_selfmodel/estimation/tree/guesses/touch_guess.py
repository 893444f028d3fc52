"""Where what is touched is: planes and distances of contacts, and markers that only touch.

All of it is told by a body that is nearly known, and nothing of it tells a first body.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import CONTACT, DISTANCE, PLANE, SIGHTS
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.meeting_places import meeting_places
from nico_selfmodel.estimation.tree.tree_parameters import APART
from nico_selfmodel.estimation.tree.tree_setup import parts_of
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed

_TRIMMED = 4.0
"""Robust standard deviations beyond which a point does not tell where a plane is."""
_TRIED = (0.4, 0.2, 0.2, 0.1, 0.1, 0.05, 0.05, 0.02)
"""How far a marker that only touches is looked for from its link's frame, and from there on, in
parts of the reach."""


@dataclass(frozen=True, eq=False)
class Touches:
    """What of a recording waits until a body is nearly known."""

    data: BodyDataset
    """The recording."""
    rows: NDArray
    """Rows of its table. Boolean, shape (N,)."""
    markers: NDArray
    """Markers of unknown place that nothing sees. Shape (K,)."""

    @classmethod
    def of(cls, data: BodyDataset) -> "Touches":
        """Find them."""
        table = data.observations
        kinds = np.array([sensor.kind for sensor in data.sensors])[table.sensor]
        seen = set(table.marker[np.isin(kinds, SIGHTS)].tolist())
        known = {m for m, marker in enumerate(data.markers) if marker.xyz is not None}
        named = {*table.marker.tolist(), *table.other[table.other >= 0].tolist()}
        unseen = np.array(sorted(named - seen - known), dtype=int)
        rows = np.isin(kinds, (CONTACT, PLANE))
        rows |= np.isin(table.marker, unseen) | np.isin(table.other, unseen)
        return cls(data, rows, unseen)

    @property
    def names(self) -> frozenset[str]:
        """Names of parameters that only they tell."""
        table = self.data.observations
        used = np.unique(table.sensor[self.rows]).tolist()
        out = {f"{s.name}.{p}" for s in map(self.data.sensors.__getitem__, used)
               if s.kind in (CONTACT, PLANE) for p in parts_of(s)}  # fmt: skip
        names = [self.data.markers[m].name for m in self.markers.tolist()]
        return frozenset(out | {f"{name}.{part}" for name in names for part in ("x", "y", "z")})

    def placed(self, tree: BodyTree) -> BodyTree:
        """Return a body with what is touched where it expects its markers.

        Markers that nothing sees begin in the middle of those of their link that are seen, or where
        what they touched is flattest.

        Raises:
            DataError: If what touched a plane does not span one.
        """
        markers, known = list(tree.markers), [m.xyz is not None for m in self.data.markers]
        seen = {*self.data.observations.marker.tolist(), *np.flatnonzero(known).tolist()}
        seen -= set(self.markers.tolist())
        motion = TreeMotion.at(tree, self.data.si_readings, self.data.X_flange)
        for m in self.markers.tolist():
            # Of some that were hardly seen nobody knows the places.
            placed = [marker.X_LA[:3, 3] for k, marker in enumerate(tree.markers)
                      if marker.on == markers[m].on and k in seen]  # fmt: skip
            place = np.median(placed, axis=0) if placed else self._flattest(motion, m)
            markers[m] = replace(markers[m], X_LA=transform(np.eye(3), place))
        tree = tree.with_markers(tuple(markers))
        motion = TreeMotion.at(tree, self.data.si_readings, self.data.X_flange)
        if met := self._met(motion):
            markers = [met.get(m, marker) for m, marker in enumerate(tree.markers)]
            tree = tree.with_markers(tuple(markers))
            motion = TreeMotion.at(tree, self.data.si_readings, self.data.X_flange)
        told = {s.name for s in self.data.sensors if s.X_LS is not None}
        planes = tuple(
            plane if plane.name in told else self._plane(motion, plane) for plane in tree.planes
        )
        apart = {name: self._apart(motion, name) for name in tree.contacts}
        return replace(tree, planes=planes, contacts=apart)

    def scale(self, tree: BodyTree, told: Mapping[str, float]) -> float:
        """Return what makes a placed body as large as distances say that only touches tell.

        Args:
            told: Values of parameters that the user knows, by name.

        Returns:
            1 where there are no such distances, or markers that are seen have some.
        """
        table = self.data.observations
        kinds = np.array([sensor.kind for sensor in self.data.sensors])[table.sensor]
        apart = np.where(kinds == DISTANCE, table.values[:, 0], np.nan)
        if np.isfinite(apart[~self.rows]).any():
            return 1.0
        for name in tree.contacts:
            apart[self._rows_of(name)] = told.get(f"{name}.{APART}", np.nan)
        known = np.flatnonzero(np.isfinite(apart))
        if not len(known):
            return 1.0
        motion = TreeMotion.at(tree, self.data.si_readings, self.data.X_flange)
        return float(np.median(apart[known] / self._lengths(motion, known)))

    def _rows_of(self, name: str) -> NDArray:
        names = [sensor.name for sensor in self.data.sensors]
        return np.flatnonzero(self.data.observations.sensor == names.index(name))

    def _lengths(self, motion: TreeMotion, rows: NDArray) -> NDArray:
        table = self.data.observations
        pose = np.where(table.pose[rows] == ANY_POSE, 0, table.pose[rows])
        ends = (motion.points(end[rows], pose) for end in (table.marker, table.other))
        return np.maximum(np.linalg.norm(np.subtract(*ends), axis=1), 1e-6)

    def _apart(self, motion: TreeMotion, name: str) -> float:
        rows = self._rows_of(name)
        return float(np.median(self._lengths(motion, rows))) if len(rows) else 0.0

    def _met(self, motion: TreeMotion) -> dict[int, Attached]:
        """Return markers that nothing sees where contacts and distances put them, if enough do."""
        table, tree = self.data.observations, motion.tree
        kinds = np.array([sensor.kind for sensor in self.data.sensors])[table.sensor]
        asked = np.isin(kinds, (CONTACT, DISTANCE)) & (table.pose != ANY_POSE) & self.rows
        rows = np.flatnonzero(asked)
        ends = np.stack([table.marker[rows], table.other[rows]], axis=1)
        _, sensor = np.unique(table.sensor[rows], return_inverse=True)
        met = np.intersect1d(ends, self.markers)
        if not len(met) or len(rows) <= 3 * len(met) + sensor.max() + 1:
            return {}
        on, at = (
            np.array([m.on for m in tree.markers]),
            np.stack([m.X_LA[:3, 3] for m in tree.markers]),
        )
        lengths = np.where(kinds[rows] == DISTANCE, table.values[rows, 0], 1.0)
        R = motion.R_WL[on[ends], :, :, table.pose[rows, None]]
        p = motion.p_WL[on[ends], :, table.pose[rows, None]]
        own = ends[:, :, None] == met
        found = meeting_places(R, p, at[ends], own, sensor, lengths)
        return {
            m: replace(tree.markers[m], X_LA=transform(np.eye(3), place))
            for m, place in zip(met.tolist(), found, strict=True)
        }

    def _flattest(self, motion: TreeMotion, marker: int) -> NDArray:
        """Return where on its link a marker is nearest to planes of what it touched. (3,)."""
        table, tree = self.data.observations, motion.tree
        ways = np.array(sorted(product((-1.0, 0.0, 1.0), repeat=3), key=np.linalg.norm))
        ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1.0)
        reach = float(np.linalg.norm(np.ptp(motion.p_WL, axis=(0, 2))))
        on = tree.markers[marker].on

        def off(places: NDArray) -> NDArray:
            total = np.zeros(len(places))
            for plane in tree.planes:
                rows = self._rows_of(plane.name)
                pose = table.pose[rows[table.marker[rows] == marker]]
                p = np.einsum("ijn,tj->tin", motion.R_WL[on][:, :, pose], places)
                p = self._from(motion, plane, p + motion.p_WL[on][:, pose], pose)
                p = p - np.sum(p, axis=2, keepdims=True) / max(len(pose), 1)
                total += np.linalg.eigvalsh(p @ np.swapaxes(p, 1, 2))[:, 0]
            return total

        place = np.zeros(3)
        for part in _TRIED:
            tried = place + part * reach * ways
            place = tried[np.argmin(off(tried))]
        return place

    @staticmethod
    def _from(motion: TreeMotion, plane: Attached, p_WQ: NDArray, pose: NDArray) -> NDArray:
        """Return points in the frame of a plane's link. Shape (..., 3, N)."""
        R, o = motion.R_WL[plane.on][:, :, pose], motion.p_WL[plane.on][:, pose]
        return np.asarray(np.einsum("jin,...jn->...in", R, p_WQ - o))

    def _plane(self, motion: TreeMotion, plane: Attached) -> Attached:
        table, rows = self.data.observations, self._rows_of(plane.name)
        if not len(rows):
            return plane
        pose = table.pose[rows]
        p = self._from(motion, plane, motion.points(table.marker[rows], pose).T, pose).T
        try:
            found = Plane.from_points(p)
            off = np.abs(found.distance_to(p))
            near = off <= _TRIMMED * 1.4826 * max(float(np.median(off)), 1e-9)
            found = Plane.from_points(p[near])
        except ValueError:
            touched = listed(sorted({self.data.markers[m].name for m in table.marker[rows]}))
            raise DataError(
                f"what touched plane {plane.name!r} ({touched}, {len(rows)} times) lies on a line "
                "or in a point: touch it in three places or more that span it"
            ) from None
        z = found.normal * np.sign(found.normal[np.argmax(np.abs(found.normal))])
        middle = p[near].mean(axis=0)
        return replace(plane, X_LA=transform(np.column_stack([tangent_basis(z), z]), middle))
