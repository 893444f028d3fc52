"""A body and all that any sensors saw of it, as the ladder asks them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.dataset.body.sensors import CAMERA, SIGHTS
from nico_selfmodel.estimation.bending.asked_poses import (
    FEWEST_POSES,
    drawn_poses,
    mean_by_pose,
    verticals,
)
from nico_selfmodel.estimation.bending.bending_arm import SURE
from nico_selfmodel.estimation.bending.steps import from_both_sides
from nico_selfmodel.estimation.bending.what_bends import At
from nico_selfmodel.estimation.tree.boards.poses_apart import PosesApart
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import Priors
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.estimation.tree.weighed_tree import TreePosture, WeighedTree, lengths
from nico_selfmodel.model.arm.bending import COUPLING, LOADS, Bending
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WORLD, BodyTree
from nico_selfmodel.model.tree.spread_weight import tree_loads, tree_rods
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.optimization.losses import robust_scale

_LOADS = 0.2
"""Standard deviation of a load's coordinate, as a part of their rms: motors and shells are no
rods."""


@dataclass(frozen=True, eq=False)
class TreeBend:
    """A body's solution with what bends in it, and the problem that it solves."""

    problem: TreeProblem
    solution: TreeSolution

    @property
    def posture(self) -> TreePosture:
        """Its parameters."""
        return TreePosture(self.problem.residuals.parameters, self.solution.values)


def tree_at(tree: BodyTree, data: BodyDataset) -> At:
    """Return where what is tracked is at a recording's poses, whatever bends in the body.

    Markers on links, or what sees where all that is seen stands in the room.
    """
    carried = [one for one in tree.markers if one.on != WORLD]
    carried = carried or [one for one in tree.sensors if one.on != WORLD]

    def at(bending: Bending | None) -> tuple[NDArray, NDArray]:
        bent = replace(tree, bending=bending)
        motion = TreeMotion.at(bent, data.si_readings, data.X_flange, data.si_approach)
        points = [motion.pose_of(one)[1].T for one in carried]
        return np.concatenate(points), motion.q.T

    return at


@dataclass(frozen=True, eq=False)
class BendingTree:
    """A body at its rigid solution: see `bendable.Bendable`."""

    solution: TreeBend
    """The rigid one."""
    held: frozenset[str] = frozenset()
    """Parameters that the user holds."""
    up: NDArray | None = None
    """Unit vertical in W, shape (3,), if it is known."""
    seed: int = 0
    """Of the poses that are asked where there are many."""
    masses: tuple[NDArray, NDArray] | None = None
    """Those of a `Description`."""
    observations: TreeObservations | None = None
    """What is asked; all that was measured if omitted."""
    outliers: NDArray | None = None
    """Rows of its table that do not count; the solution's if omitted. Boolean, shape (N,)."""
    aside: NDArray | None = None
    """The same among all that was measured."""

    @property
    def seen(self) -> TreeObservations:
        """What is asked."""
        return self.observations or self.solution.problem.observations

    @property
    def posture(self) -> TreePosture:
        """Parameters of the rigid body."""
        return self.solution.posture

    def ended(self, solution: TreeBend) -> bool:
        """Return whether the search for a solution came to its end."""
        return solution.solution.converged

    def posture_of(self, solution: TreeBend) -> TreePosture:
        """Return the parameters of a solution."""
        return solution.posture

    @property
    def noise(self) -> TreeNoise:
        """About the rigid body; where some poses are asked, each has its own."""
        noise = self.solution.solution.noise
        return (
            noise if self.seen is self.solution.problem.observations else replace(noise, alike=())
        )

    def quieter(self, noise: TreeNoise) -> TreeNoise | None:
        """Return the same were joints that are read worse than others read like these."""
        joint, motion = noise.joint.copy(), self.seen.joint_groups()
        for k in noise.loud:
            alike = [n for n in np.flatnonzero(motion == motion[k]) if n not in noise.loud]
            joint[k] = np.median(noise.joint[alike]) if alike else joint[k]
        return replace(noise, joint=joint) if (joint != noise.joint).any() else None

    @property
    def joints(self) -> tuple[str, ...]:
        """Names."""
        return self.seen.data.joint_names

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the rigid parameters that are estimated."""
        return self.solution.problem.free_names

    @property
    def unit(self) -> str:
        """Unit of errors: that of the first sensor that sees poses."""
        return "px" if self._seeing[0].kind == CAMERA else "mm"

    @property
    def _seeing(self) -> list[SensorRows]:
        """What tells where something is, in space rather than in images."""
        rows = [one for one in self.seen.sensors if one.kind in SIGHTS and not one.apart]
        return sorted(rows, key=lambda one: one.kind == CAMERA)

    @property
    def _turning(self) -> NDArray:
        """Which joints turn and are read. Boolean, shape (n,)."""
        joints = self.seen.data.joints
        return np.array([j.motion == REVOLUTE and not j.follows for j in joints])

    @property
    def known_gears(self) -> tuple[str, ...]:
        """Names of gears that a unit tells and nobody holds."""
        names = (
            f"{joint.name}.gear"
            for joint, turns in zip(self.seen.data.joints, self._turning, strict=True)
            if turns and joint.gear_known
        )
        return tuple(name for name in names if name not in {*self.held, *self.free})

    @property
    def sides(self) -> bool:
        """Whether some joint is known to have come from both sides."""
        return from_both_sides(np.asarray(self.seen.data.approach))

    @property
    def enough(self) -> bool:
        """Whether there are enough poses to ask, of a body with joints that turn."""
        if not (self._seeing and self._turning.any() and self.solution.solution.variances_known):
            return False
        rows = np.concatenate([one.rows for one in self._seeing])
        poses = len(np.unique(self._pose_of_rows()[rows]))
        return poses >= FEWEST_POSES and self.seen.scalars >= 2 * len(self.free)

    @property
    def ups(self) -> tuple[tuple[NDArray, bool], ...]:
        """What may be the vertical in W, and whether its sense is certain."""
        if self.up is not None:
            return ((self.up, True),)
        first = int(np.flatnonzero(self._turning)[0])
        return verticals(self._still.R_WJ[first, :, 2, 0])

    @property
    def _still(self) -> TreeMotion:
        tree, data = self._rigid(self.posture), self.seen.data
        return TreeMotion.at(tree, np.zeros((1, len(data.joints))), data.X_flange[:1])

    def rods(self) -> tuple[NDArray, NDArray]:
        """Return loads and pivots: of masses that are described, else of uniform rods."""
        loads, pivots = tree_rods(self._still)
        if self.masses is None:
            return loads, pivots
        return tree_loads(self.posture.tree, *self.masses, pivots), pivots

    def load_sigmas(self) -> NDArray:
        """Return how far loads may be from that: a part of their rms."""
        loads, _ = self.rods()
        rms = float(np.sqrt(np.mean(np.sum(loads**2, axis=1))))
        return np.full_like(loads, _LOADS * rms)

    def names_of(self, bending: Bending, effect: str) -> tuple[str, ...]:
        """Return an effect's numbers: of joints that turn, coupled to joints on their way.

        What hangs from joints that turn is a load.
        """
        beyond = self.posture.parameters.base.beyond[:-1]
        bends = self._turning
        if effect == COUPLING:
            near = (beyond | beyond.T) & bends[:, None] & bends[None, :]
            keep = near[bending.others]
        elif effect == LOADS:
            keep = np.repeat(beyond[:, bends].any(axis=1), 3)
        else:
            keep = np.repeat(bends, len(bending.names_of(effect)) // len(bends))
        return tuple(n for n, k in zip(bending.names_of(effect), keep, strict=True) if k)

    def weighed(
        self, posture: TreePosture, free: tuple[str, ...], noise: TreeNoise
    ) -> "WeighedTree":
        """Linearise about a body."""
        outliers = self.solution.solution.outliers if self.outliers is None else self.outliers
        linear = self._residuals(posture).linear(posture.values)
        apart = PosesApart.of(self.seen, ~outliers[self.seen.row])
        linear = apart.eliminated(linear, noise.sensor[self.seen.noise_group])
        rows = np.concatenate([one.rows for one in self._seeing])
        rows = np.sort(rows[~outliers[rows]])
        return WeighedTree(
            *(self.seen, posture, free, noise, linear, outliers, rows),
            self._pose_of_rows()[rows],
            self.solution.problem.priors,
            self._size_of_rows()[rows],
        )

    def _residuals(self, posture: TreePosture) -> TreeResiduals:
        known = self.solution.problem.residuals
        if self.seen is known.observations:
            return known.about(posture.parameters)
        return TreeResiduals(self.seen, posture.parameters)

    def _pose_of_rows(self) -> NDArray:
        """Return the pose of each row of the table; -1 of what is in no pose. Shape (N,)."""
        data = self.seen.data
        return np.append(data.pose, ANY_POSE)[data.observations.pose]

    def _size_of_rows(self) -> NDArray:
        """Return what makes errors of all sensors alike: noise of the first over theirs. (N,)."""
        sigma = np.ones(len(self.seen.data.observations))
        for rows in self.seen.sensors:
            sigma[rows.rows] = self.noise.sensor[self.seen.noise_group[rows.first]]
        return np.asarray(sigma[self._seeing[0].rows[0]] / sigma)

    def turns(self, posture: TreePosture) -> NDArray:
        """Return how much joints turn beyond their displacements. Shape (N, n)."""
        bent, rigid = (self._moved(tree) for tree in (posture.tree, self._rigid(posture)))
        return np.asarray((bent.q - rigid.q).T[:, self._turning])

    def moments(self, posture: TreePosture) -> NDArray:
        """Return `Bending.moments`. Shape (n, N, 3)."""
        load = self._moved(posture.tree).load
        assert load is not None
        return load.moments

    def _rigid(self, posture: TreePosture) -> BodyTree:
        return replace(posture.tree, bending=None)

    def _moved(self, tree: BodyTree) -> TreeMotion:
        data = self.seen.data
        return TreeMotion.at(tree, data.si_readings, data.X_flange, data.si_approach)

    def few(self) -> "Iterator[BendingTree]":
        """Yield what is asked: some poses, without what is an outlier whatever bends.

        Poses in which a joint was read wrongly are left out once.
        """
        solution, data = self.solution.solution, self.seen.data
        table = data.observations
        visit = np.append(data.visit, -1)[table.pose]
        slipped = np.append(solution.slipped.any(axis=1), False)
        slipped = (visit >= 0) & slipped[np.minimum(visit, len(slipped) - 1)]
        distance = self._distances(self.posture)
        scale = robust_scale(distance[~solution.outliers & np.isfinite(distance)], 3)
        aside = [solution.outliers & (distance > sure * scale) for sure in SURE]
        aside[-1] = aside[-1] | slipped
        keep = self._thinned()
        kept_rows = np.append(keep, True)[table.pose]
        few = self.seen if keep.all() else TreeObservations.of(data.select(keep))
        asked: set[bytes] = set()
        for without in aside:
            outliers = without[kept_rows]
            left = np.unique(few.data.observations.pose[~outliers])
            if len(left) < FEWEST_POSES:
                continue
            if outliers.tobytes() not in asked:  # else what differs is not among these poses
                asked.add(outliers.tobytes())
                yield replace(self, observations=few, outliers=outliers, aside=without)

    def _thinned(self) -> NDArray:
        """Return as many samples, of whole poses drawn at random, as tell an effect. (P,)."""
        pose, rows = self.seen.data.pose, np.concatenate([one.rows for one in self._seeing])
        of_rows = self._pose_of_rows()[rows]
        drawn = drawn_poses(of_rows[of_rows != ANY_POSE], self.seed)
        return np.isin(pose, drawn) | ~np.isin(pose, of_rows)

    def _distances(self, posture: TreePosture) -> NDArray:
        """Return the error of each row, alike for all sensors; nan where it is none. (N,)."""
        r = self._residuals(posture).residuals(posture.values)
        return lengths(self.seen, r) * self._size_of_rows()

    def bent(
        self, posture: TreePosture, free: tuple[str, ...], priors: Priors, noise: TreeNoise
    ) -> TreeBend:
        """Return the solution of all observations, outliers looked for anew."""
        rigid = self.solution
        residuals = rigid.problem.residuals.about(posture.parameters)
        both = {**rigid.problem.priors, **priors}
        problem = TreeProblem(residuals, frozenset(free), both, noise, alike=rigid.problem.alike)
        return TreeBend(problem, problem.refine(posture.values, self.aside))

    def log_errors(self, posture: TreePosture) -> NDArray:
        """Return log(error) of each pose, outliers included. Shape (P,)."""
        distance, pose = self._distances(posture), self._pose_of_rows()
        told = np.isfinite(distance) & (pose >= 0)
        return np.log(mean_by_pose(distance[told], pose[told]))
