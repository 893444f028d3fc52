"""Joints that carry cameras and no located marker, as the head's, told by what its cameras see.

With the joints' directions drawn, and their lines through one place from which the markers look as
wide as the cameras see them, each camera's turn is where its rays fit best (Wahba 1965). Of many
draws those that fit best are adjusted by bearings alone, what is known held; about one in three of
a pan-tilt head's comes home.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.cameras_around import as_far_as_seen
from nico_selfmodel.estimation.tree.guesses.lost_joints import joints_found, on_known
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, SHIFTS, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed

_DRAWN, _ADJUSTED = 400, 24
"""Draws of directions and places, and how many of them are adjusted at most: the best."""
_FARTHER = 0.6
"""Standard deviation of the logarithm of distances: joints widen what a camera sees of a scene."""
_ALIKE = 1.05
"""How much more than the best another start may miss bearings by, and be the same ..."""
_WITHIN = 0.02
"""... if half of all rays miss by less [rad]: wrong minima may be alike, too."""


def with_carrying_joints(
    data: BodyDataset,
    tree: BodyTree,
    cameras: Mapping[str, SensorRows],
    told: Collection[str],
    located: NDArray,
    seed: int,
) -> tuple[BodyTree, frozenset[str]]:
    """Return a body with the joints that carry cameras and no located marker, and these cameras.

    Args:
        tree: The body, its other joints in place.
        cameras: What cameras on links saw, by name.
        told: Those of them whose place on their link is known.
        located: Markers that are in place.

    Returns:
        The body, and the names of the cameras that are in place by this.

    Raises:
        DataError: If a camera on such joints saw too little.
    """
    head = _Head.of(data, tree, cameras, told, located)
    if head is None:
        return tree, frozenset()
    rng = np.random.default_rng((seed, 12))
    drawn = sorted(((head.missed(one), k, one) for k, one in enumerate(head.drawn(rng))))
    found: list[tuple[float, int, BodyTree]] = []
    for _, k, start in drawn[:_ADJUSTED]:
        adjusted = head.adjusted(start)
        found = sorted([*found, (head.missed(adjusted), k, adjusted)])
        best = found[0][0]
        if len(found) > 1 and best < _WITHIN and found[1][0] < _ALIKE * best:
            break
    return found[0][2], frozenset(head.free_of)


@dataclass(frozen=True, eq=False)
class _Head:
    """What cameras on joints of unknown place saw of markers on links of known place."""

    data: BodyDataset
    tree: BodyTree
    joints: tuple[int, ...]
    """Those to be found."""
    rays: TreeObservations
    """What their cameras saw, as bearings."""
    markers: tuple[int, ...]
    """Seen markers that nothing located, on links of known place."""
    free_of: tuple[str, ...]
    """Cameras whose place is asked for."""

    @classmethod
    def of(
        cls,
        data: BodyDataset,
        tree: BodyTree,
        cameras: Mapping[str, SensorRows],
        told: Collection[str],
        located: NDArray,
    ) -> "_Head | None":
        """Gather it; None where known joints carry all cameras."""
        links = {s.name: s.on for s in tree.sensors if s.name in cameras and s.on != WORLD}
        unknown = ~joints_found(tree, located)
        own = {n: link for n, link in links.items() if (tree.beyond[link] & unknown).any()}
        if not own:
            return None
        lost = tree.beyond[list(own.values())].any(axis=0) & unknown
        table, known = data.observations, on_known(tree, located)
        mine = np.array([s.name in own for s in data.sensors])[table.sensor]
        rays = TreeObservations.of(data, mine & known[table.marker]).as_bearings(tree.lenses)
        seen = np.unique(np.concatenate([r.marker for r in rays.sensors] or [np.zeros(0, int)]))
        fresh = tuple(m for m in seen.tolist() if m not in set(located.tolist()))
        joints = tuple(np.flatnonzero(lost).tolist())
        head = cls(
            data,
            _beside_located(tree, fresh, located),
            joints,
            rays,
            fresh,
            tuple(name for name in own if name not in told),
        )
        head.require_enough()
        return head

    def require_enough(self) -> None:
        """Refuse what has fewer equations than unknowns: a bearing counts for two."""
        count = sum(len(rows.rows) for rows in self.rays.sensors)
        if 2 * count < len(self.free):
            cameras, joints = listed([r.name for r in self._rows]), [*self.tree.joints]
            raise DataError(
                f"{cameras or 'a camera'}, carried by {listed([joints[i] for i in self.joints])}, "
                f"saw {count} markers that something else places, {-(-len(self.free) // 2)} are "
                "needed to tell where it is and how these joints move it: say where markers in the "
                "room are (xyz), let what stands see some of them too, or give the robot's "
                "description"
            )

    @property
    def free(self) -> frozenset[str]:
        """Names of the parameters that are asked for."""
        tree, parameters = self.tree, TreeParameters(self.tree)
        free = {f"{tree.markers[m].name}.{part}" for m in self.markers for part in SHIFTS}
        free |= {f"{name}.{part}" for name in self.free_of for part in FRAME_PARTS}
        return frozenset(free.union(*(parameters.line_of(tree.joints[i]) for i in self.joints)))

    def drawn(self, rng: np.random.Generator) -> Iterator[BodyTree]:
        """Yield starts."""
        scenes = {i: self._scene(i) for i in self.joints}
        for _ in range(_DRAWN):
            turns = nearest_rotation(rng.normal(size=(len(self.joints), 3, 3)))
            side, farther = rng.normal(size=3), np.exp(_FARTHER * rng.normal())
            side = side / np.linalg.norm(side)
            X_PJ = np.array(self.tree.X_PJ)
            for i, turn in zip(self.joints, turns, strict=True):
                middle, far = scenes[i]
                X_PJ[i] = transform(turn, middle + farther * far * side)
            yield self._turned(replace(self.tree, X_PJ=X_PJ))

    def _scene(self, joint: int) -> tuple[NDArray, float]:
        """Return the middle of what is seen in the frame that carries a joint, and how far it is.

        Both are 0 where another joint that is asked for carries it.
        """
        parent = int(self.tree.parent[joint])
        if parent in self.joints:
            return np.zeros(3), 0.0
        motion = self._motion(self.tree)
        seen = [(motion.points_from(parent, r.marker, r.pose), r.measured) for r in self._rows]
        p, rays = map(np.vstack, zip(*seen, strict=True))
        return p.mean(axis=0), as_far_as_seen(p, rays)

    def _turned(self, tree: BodyTree) -> BodyTree:
        """Turn cameras to where their rays fit best: R of least sum |p - R d|^2 (Wahba 1965)."""
        motion, sensors = self._motion(tree), {sensor.name: sensor for sensor in tree.sensors}
        for rows in self._rows:
            if rows.name not in self.free_of:
                continue
            at = sensors[rows.name]
            p = motion.points_from(at.on, rows.marker, rows.pose) - at.X_LA[:3, 3]
            R = nearest_rotation(_unit(p).T @ rows.measured)
            sensors[rows.name] = replace(at, X_LA=transform(R, at.X_LA[:3, 3]))
        return replace(tree, sensors=tuple(sensors.values()))

    def adjusted(self, start: BodyTree) -> BodyTree:
        """Return a start adjusted by bearings."""
        residuals = TreeResiduals(self.rays, TreeParameters(start))
        problem = TreeProblem(residuals, self.free, {})
        return residuals.parameters.tree_of(problem.rough(residuals.parameters.start)[0])

    def missed(self, tree: BodyTree) -> float:
        """Return by how much half of all rays miss their markers at most [rad]."""
        motion, sensors = self._motion(tree), {sensor.name: sensor for sensor in tree.sensors}
        off = []
        for rows in self._rows:
            at = sensors[rows.name]
            p = apply(inverse(at.X_LA), motion.points_from(at.on, rows.marker, rows.pose))
            off.append(np.linalg.norm(_unit(p) - rows.measured, axis=1))
        return float(np.median(np.concatenate(off)))

    @property
    def _rows(self) -> tuple[SensorRows, ...]:
        return self.rays.sensors

    def _motion(self, tree: BodyTree) -> TreeMotion:
        return TreeMotion.at(tree, self.data.si_readings, self.data.X_flange)


def _unit(p: NDArray) -> NDArray:
    return np.asarray(p / np.linalg.norm(p, axis=1, keepdims=True))


def _beside_located(tree: BodyTree, fresh: Collection[int], located: NDArray) -> BodyTree:
    """Put markers amid those of their link that are in place, else at its frame."""
    markers = list(tree.markers)
    for m in fresh:
        own = [k for k in located.tolist() if tree.markers[k].on == tree.markers[m].on]
        p = np.mean([tree.markers[k].X_LA[:3, 3] for k in own] or np.zeros((1, 3)), axis=0)
        markers[m] = replace(markers[m], X_LA=transform(markers[m].X_LA[:3, :3], p))
    return tree.with_markers(tuple(markers))
