"""The adjustment of arm, cameras and boards: a tree, first by its lines, then by name.

Joints that are known from nothing but their motion have four numbers each, two turns and two
shifts, whose minimum is found in a few steps wherever axes are. Rows have names that users hold,
and whose covariance is told: the last problem is laid in these about the minimum of the first.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.body.arm_parameters import ArmParameters, arm_tree
from nico_selfmodel.estimation.body.body_initialization import named_like
from nico_selfmodel.estimation.body.seen_body import SeenBody
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.hand_rows import HandPixels
from nico_selfmodel.estimation.observations.observations import gears_known
from nico_selfmodel.estimation.tree.bending_tree import TreeBend
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.noise.likeliest_noise import likeliest_noise
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, BodyParameters, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import blank_body
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.optimization.chi_square import as_rare_as
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT


class ReadExactly(TreeResiduals):
    """The forward model of joints that turn as they are read: all noise is the pixels'."""

    def linear(self, values: NDArray, start: NDArray | None = None) -> TreeLinear:
        """Return residuals and derivatives; what is read says nothing of its noise."""
        found = super().linear(values, start)
        return replace(found, by_joint=np.where(self.observations.unread, found.by_joint, 0.0))


@dataclass(frozen=True, eq=False)
class BodyProblem:
    """Arm, cameras and boards as one problem."""

    seen: SeenBody
    """What was seen."""
    start: SelfModel
    """Arm and cameras to begin with; it tells the zeros of joints."""
    whitened: bool = True
    """Whether joints have noise."""
    trim: bool = True
    """Whether outliers are looked for."""

    def _residuals(self, parameters: BodyParameters) -> TreeResiduals:
        kind = TreeResiduals if self.whitened else ReadExactly
        return kind(TreeObservations.of(self.seen.data), parameters)

    def by_lines(
        self,
        arm: DhParameters,
        rig: StereoRig,
        held: frozenset[str],
        before: TreeSolution | None = None,
    ) -> tuple[DhParameters, StereoRig, TreeBend]:
        """Refine an arm as lines, with its cameras.

        Args:
            arm: Where it begins.
            rig: Where the cameras begin, the left one at the world.
            held: Gears and parameters of cameras that stay.
            before: The solution of less that was seen, or of less that was free.

        Raises:
            NotConvergedError: If cameras that cannot be come out.
        """
        parameters = TreeParameters(arm_tree(arm, rig, self._blank(rig)))
        joints, base = arm.table.joints, parameters.base
        free = {name for joint in joints for name in parameters.line_of(joint)}
        free |= {f"{joint}.gear" for joint in joints}
        free |= {f"hand.{marker}.{part}" for marker in arm.table.markers for part in SHIFTS}
        free |= {name.replace(".pose.", ".") for name in rig.names}
        free -= {name.replace(".pose.", ".") for name in held}
        problem = TreeProblem(self._residuals(parameters), frozenset(free), {})
        solution = self._refined(problem, parameters.values_of(base), before)
        tree = parameters.tree_of(solution.values)
        found = lines_of_tree(tree, self.start.servos.offset, arm.table.markers)
        named = named_like(found, self.start, gears_known(self.seen.pixels.arm.units))
        rig = StereoRig(*(tree.camera(side) for side in SIDES))
        return named, rig, TreeBend(problem, solution)

    def named(
        self,
        arm: DhParameters,
        rig: StereoRig,
        free: frozenset[str],
        noise: TreeNoise | None = None,
        poses: NDArray | None = None,
    ) -> TreeProblem:
        """Return the problem by name about an arm and cameras, boards at some poses."""
        parameters = ArmParameters(arm, rig, self._blank(rig))
        residuals = self._residuals(parameters)
        return TreeProblem(residuals.about(parameters, poses), free, {}, noise)

    def by_name(
        self,
        arm: DhParameters,
        rig: StereoRig,
        free: frozenset[str],
        before: TreeBend,
        values: Mapping[str, float],
    ) -> TreeBend:
        """Refine by name.

        Args:
            arm: Where it begins, at the minimum of its lines.
            rig: Where the cameras begin.
            before: The solution by lines.
            values: At which the user holds some.

        Raises:
            NotConvergedError: If cameras that cannot be come out.
        """
        poses = before.problem.poses
        problem = self.named(arm, rig, free, before.solution.noise, poses)
        parameters = problem.residuals.parameters
        assert isinstance(parameters, ArmParameters)
        x = parameters.start
        for name, value in values.items():
            x[parameters.index[name]] = value
        if values:
            return TreeBend(problem, self._refined(problem, x, None))
        with _plausible_cameras():
            return TreeBend(problem, problem.solve_from(replace(before.solution, values=x)))

    def as_if_joints_erred(self, found: TreeBend) -> TreeNoise:
        """Return the noise that a solution's residuals ask for, did joints have any."""
        problem = found.problem
        seen = problem.observations
        residuals = TreeResiduals(seen, problem.residuals.parameters, problem.poses)
        free = frozenset(problem.free_names)
        sound = replace(found.solution, slipped=np.zeros_like(found.solution.slipped))
        anew = TreeProblem(residuals, free, {})
        return likeliest_noise(anew.evidence_at(sound), anew.noise)

    def _refined(
        self, problem: TreeProblem, values: NDArray, before: TreeSolution | None
    ) -> TreeSolution:
        with _plausible_cameras():
            if before is None:
                return problem.refine(problem.rough(values)[0], trim=self.trim)
            more = len(self.seen.data.observations) - len(before.outliers)
            outliers = np.append(before.outliers, np.zeros(more, dtype=bool))
            return problem.refine(values, outliers, trim=self.trim)

    def _blank(self, rig: StereoRig) -> BodyTree:
        return blank_body(self.seen.data, dict(zip(SIDES, rig.cameras, strict=True)))


@contextmanager
def _plausible_cameras() -> Iterator[None]:
    """Refuse cameras that have become what cannot be.

    Raises:
        NotConvergedError: If they have.
    """
    try:
        yield
    except ValueError as error:
        raise NotConvergedError(f"no plausible cameras fit the hand: {error}") from error


def arm_and_cameras(found: TreeBend) -> tuple[DhParameters, StereoRig]:
    """Return what a solution by name has learned."""
    parameters, values = found.problem.residuals.parameters, found.solution.values
    assert isinstance(parameters, ArmParameters)
    return replace(parameters.arm_of(values), turn=None), parameters.rig_of(values)


def lines_of_tree(tree: BodyTree, zero: NDArray, markers: tuple[str, ...]) -> ArmEstimate:
    """Return a tree without branches as lines.

    Args:
        tree: An arm, its markers the first of all.
        zero: Encoder angles at which its lines are told [rad]. Shape (n,).
    """
    n, count = len(zero), len(tree.joints)
    readings = np.pad(zero, (0, count - n))[None]
    motion = TreeMotion.at(tree, readings, np.tile(np.eye(4), (1, count, 1, 1)))
    p = motion.places(tree.markers[: len(markers)])[0]
    axes, points = motion.R_WJ[:n, :, 2, 0], motion.p_WJ[:n, :, 0]
    return ArmEstimate(Chain(tree.joints[:n], axes, points, markers, p), tree.gear[:n], zero)


def outlier_rows(seen: SeenBody, found: TreeBend) -> NDArray:
    """Return which rows of the hand neither the body nor its noise explains. Boolean, shape (N,).

    Of poses in which a joint was read wrongly they are those that are farther off than
    r' S^-1 r of outliers, S with the noise of all joints.
    """
    solution, table = found.solution, seen.data.observations
    out = np.zeros(len(seen.pixels), dtype=bool)
    out[seen.row[solution.outliers & (seen.row >= 0)]] = True
    by_visit = np.asarray(solution.slipped.any(axis=1))
    slipped = by_visit[seen.data.visit[table.pose]] & (seen.row >= 0)
    rows = np.unique(seen.row[slipped])
    if len(rows):
        arm, rig = arm_and_cameras(found)
        own = seen.pixels.select(rows)
        block = HandPixels(own, arm, rig.lenses)
        x = np.concatenate([arm.values, rig.values])
        block.whiten(seen.noise_of(solution.noise).whitening(block.by_angle(x), own.seen))
        distance = np.sum(block.evaluate(x)[0] ** 2, axis=0)
        limit = [as_rare_as(OUTLIER_AT**2, 3, k) for k in own.seen.sum(axis=1).tolist()]
        out[rows] |= distance > np.array(limit)
    return out
