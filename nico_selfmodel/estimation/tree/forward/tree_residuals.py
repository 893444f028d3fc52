"""Residuals of any sensors of any body, with every derivative.

Whatever moves a body's parameter moves what is beyond it like a rigid body: by a turn w about the
frame's origin and a shift v in W. A marker on link a at p moves by w x (p - o) + v where the joint
lies on its way to the world, what a sensor on link b sees of it moves by the opposite where the
joint lies on the sensor's: dp_S = R_WS' (s_a - s_b) (w x (p - o) + v), and a frame turns by
R_WS' (s_a - s_b) w. A joint that carries both moves nothing.

In a mirror n.x + d = 0 a camera sees p' = S p - 2 d n, S = I - 2 n n', instead: a joint on the
marker's way moves it by S (w x (p - o) + v), one on the camera's way what is seen of it by
-(w x (p' - o) + v). They no longer cancel.
"""

from dataclasses import replace
from functools import cached_property
from itertools import groupby
from typing import Self

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CONTACT, PAIRS
from nico_selfmodel.estimation.tree.boards.first_poses import first_poses
from nico_selfmodel.estimation.tree.boards.settled_poses import SETTLING_ROUNDS, settled_poses
from nico_selfmodel.estimation.tree.forward.joint_errors import erring_readings
from nico_selfmodel.estimation.tree.forward.pushes import Push, by_bearing, by_bends, by_frames
from nico_selfmodel.estimation.tree.forward.rows_last import at_samples, dot_first
from nico_selfmodel.estimation.tree.forward.sensor_run import AttachedEnds, SensorRun
from nico_selfmodel.estimation.tree.forward.sights import sight_of
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import BodyParameters
from nico_selfmodel.geometry.reflection import reflect, reflection, reflection_slopes
from nico_selfmodel.model.arm.line_kinematics import cross
from nico_selfmodel.model.tree.body_tree import FREE, REVOLUTE, WHOLE_POSES, BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_TRIED = 6
"""Steps after which one of two guesses of a pose is the better one."""


class TreeResiduals:
    """The forward model of a recording: parameters in, residuals and derivatives out."""

    def __init__(
        self,
        observations: TreeObservations,
        parameters: BodyParameters,
        poses: NDArray | None = None,
        joint_errors: NDArray | None = None,
    ) -> None:
        """Prepare.

        Args:
            poses: Where the search for poses that nobody reads begins; by single views if omitted.
                Shape (P, n, 4, 4).
            joint_errors: How far joints are taken to be from their readings where `linear` is, see
                `estimation.tree.forward.joint_errors`; none if omitted. Shape (P, m).
        """
        self._poses = poses
        self.observations, self.parameters = observations, parameters
        self.joint_errors = joint_errors
        self._layout = parameters.layout
        self._on = np.array([a.on for a in self._layout.attached])
        self._beyond = parameters.base.beyond
        base = parameters.base
        self._sensor_names = [s.name for s in (*base.sensors, *base.planes)]

    def about(self, parameters: BodyParameters, poses: NDArray | None = None) -> Self:
        """Return the same of other parameters of nearly the same body.

        Args:
            poses: Where the search for poses begins; where this one's does if omitted.
        """
        if poses is None and self.observations.data.free_joints:
            poses = self._first_poses
        return type(self)(self.observations, parameters, poses, self.joint_errors)

    def erring(self, joint_errors: NDArray | None) -> Self:
        """Return the same, linear about other errors of joints. Shape (P, m)."""
        known = self._first_poses if self.observations.data.free_joints else None
        return type(self)(self.observations, self.parameters, known, joint_errors)

    def motion(self, tree: BodyTree) -> TreeMotion:
        """Return where everything is at the samples; what moves freely where it fits best."""
        return self._moved(tree, self.whole_poses(tree))

    def whole_poses(self, tree: BodyTree, start: NDArray | None = None) -> NDArray:
        """Return poses as controllers read them, and where what moves freely fits best.

        Args:
            start: Where the search for the latter begins; by single views if omitted. Shape (P, n,
                4, 4).

        Returns:
            Shape (P, n, 4, 4).
        """
        data = self.observations.data
        if not data.free_joints:
            return data.X_flange
        return self._settled(tree, self._first_poses if start is None else start)[0]

    def _moved(self, tree: BodyTree, flanges: NDArray) -> TreeMotion:
        data = self.observations.data
        readings = erring_readings(self.observations, tree, self.joint_errors)
        return TreeMotion.at(tree, readings, flanges, data.si_approach)

    @cached_property
    def _first_poses(self) -> NDArray:
        """Where the search for poses that nobody reads begins. Shape (P, n, 4, 4)."""
        if self._poses is not None:
            return self._poses
        tree = self.parameters.base
        guesses = first_poses(tree, self.observations)
        one, other = (self._settled(tree, X, _TRIED) for X in guesses)
        return np.where((other[1] < one[1])[:, None, None, None], other[0], one[0])

    @cached_property
    def _boards(self) -> TreeObservations:
        return self.observations.on_free_joints()

    @cached_property
    def _board_runs(self) -> tuple[SensorRun, ...]:
        return self._runs_of(self._boards)

    def _settled(
        self, tree: BodyTree, flanges: NDArray, rounds: int = SETTLING_ROUNDS
    ) -> tuple[NDArray, NDArray]:
        seen = self._boards
        if not seen.sensors:  # samples that show no board: nothing depends on where it is
            return flanges, np.zeros(len(flanges))
        free, sigma = seen.data.free_joints, seen.stated_sigma[seen.noise_group]
        columns = np.flatnonzero(seen.unread)

        def evaluate(poses: NDArray) -> tuple[NDArray, NDArray]:
            r, by_joint = self._of_free(tree, self._moved(tree, poses))
            return r / sigma, by_joint[:, columns] / sigma[:, None]

        return settled_poses(evaluate, flanges, free, seen.sample, rounds)

    def _of_free(self, tree: BodyTree, motion: TreeMotion) -> tuple[NDArray, NDArray]:
        """Return residuals, and their derivatives by what moves freely alone. (R,), (R, m)."""
        parts = [self._of_free_in(tree, motion, run) for run in self._board_runs]
        return tuple(np.concatenate(part) for part in zip(*parts, strict=True))  # type: ignore[return-value]

    def residuals(self, values: NDArray) -> NDArray:
        """Return residuals alone, of joints that do not err. Shape (P,) -> (R,)."""
        if self.joint_errors is not None:
            return self.erring(None).residuals(values)
        tree = self.parameters.tree_of(values)
        motion = self.motion(tree)
        shown = [sight_of(tree, motion, run).shown for run in self._runs]
        return np.concatenate([part.residual.ravel() for part in shown])

    def linear(self, values: NDArray, start: NDArray | None = None) -> TreeLinear:
        """Return residuals and derivatives. Shape (P,) -> (R,), (P, R), (R, m).

        About errors e of the joints residuals are those of readings that do not err: r(e) - A e.

        Args:
            start: See `whole_poses`.
        """
        tree = self.parameters.tree_of(values)
        poses = self.whole_poses(tree, start)
        motion = self._moved(tree, poses)
        slopes = self._layout.turn_slopes(self.parameters.layout_values(values))
        parts = [self._linear(tree, motion, slopes, run) for run in self._runs]
        linear = replace(TreeLinear.together(parts), poses=poses)
        linear = replace(linear, J=self.parameters.by_name(values, linear.J))
        if self.joint_errors is None:
            return linear
        off = self.joint_errors[self.observations.sample]
        pulled = np.einsum("rm,rm->r", linear.by_joint, off)
        return replace(linear, r=linear.r - pulled, pulled=pulled)

    def run_of(self, *parts: SensorRows) -> SensorRun:
        """Return rows of sensors that are alike as what is linearised at once."""
        pose = np.concatenate([rows.pose for rows in parts])
        items = zip(*(self._items(rows) for rows in parts), strict=True)
        ends, k = [], parts[0].measured.shape[1]
        for item in map(np.concatenate, items):
            on = self._on[item]
            ends.append(AttachedEnds(item, on, pose, self._beyond[on].astype(float), k))
        return SensorRun(parts, *ends)

    def _items(self, rows: SensorRows) -> tuple[NDArray, NDArray]:
        """Return which attached frames are seen, and which see. Shape (N,) each."""
        if rows.kind in PAIRS:
            return rows.marker, rows.other
        markers = len(self._layout.base.markers)
        seeing = markers + self._sensor_names.index(rows.name)
        return rows.marker, np.full(len(rows.rows), seeing)

    @cached_property
    def _runs(self) -> tuple[SensorRun, ...]:
        return self._runs_of(self.observations)

    def _runs_of(self, observations: TreeObservations) -> tuple[SensorRun, ...]:
        """Return sensors that follow each other and are alike."""
        alike = groupby(observations.sensors, lambda rows: (rows.kind, rows.mirror))
        return tuple(self.run_of(*run) for _, run in alike)

    @cached_property
    def _read_alone(self) -> tuple[NDArray, NDArray]:
        """Which of `noisy_joints` are no part of a whole pose, and their joints."""
        motions, noisy = self.parameters.base.motions, self.observations.noisy_joints
        own = [m for m, (i, _) in enumerate(noisy) if motions[i] not in WHOLE_POSES]
        return np.array(own, dtype=int), np.array([noisy[m][0] for m in own], dtype=int)

    def _linear(
        self, tree: BodyTree, motion: TreeMotion, slopes: NDArray, run: SensorRun
    ) -> TreeLinear:
        sight = sight_of(tree, motion, run)
        residual, pose = sight.shown.residual, run.pose
        N, k = residual.shape
        J = np.zeros((len(self._layout.names), N, k))
        by_joint = np.zeros((N, k, len(self.observations.noisy_joints)))
        n = len(tree.joints)
        by_q, across = np.zeros((n, N, k)), np.zeros((4, n, N, k))
        push = pushed = Push.of_sight(sight, run.seen)
        ways = [(push, run.signs)]
        if run.mirror:
            push, pushed = self._in_mirror(J, tree.mirror(run.mirror), push)
            ways = [(push, run.seen.moved), (pushed, -run.seeing.moved)]
        for one, signs in ways:
            self._by_joints(motion, slopes, one, signs, J, by_q, by_joint, across)
        gears = self._layout.gears.start
        read = np.tensordot(tree.coupling.T, by_q, 1)
        own, joints = self._read_alone
        by_joint[:, :, own] = read[joints].transpose(1, 2, 0)
        # q = reading / gear
        slope = self.observations.data.si_readings[:, joints] / tree.gear[joints] ** 2
        J[gears + joints] = -read[joints] * slope[pose].T[:, :, None]
        if motion.load is not None:
            J[self._layout.bends] = by_bends(motion, read, across, pose)
        # The other of two markers is a point, whose frame may turn.
        seeing = None if run.kind in PAIRS else sight.p_WS
        self._by_attached(J, motion, slopes, push, run.seen, 1.0)
        self._by_attached(J, motion, slopes, pushed, run.seeing, -1.0, seeing)
        for rows, own, one in zip(run.parts, run.own, sight.parts, strict=False):
            if one.by_lens is not None:
                J[self._layout.intrinsics(rows.name), own] = one.by_lens.transpose(2, 0, 1)
        if run.kind == CONTACT:
            for rows, own in zip(run.parts, run.own, strict=True):
                J[self._layout.contact(rows.name), own] = -1.0
        return TreeLinear(residual.ravel(), J.reshape(len(J), -1), by_joint.reshape(N * k, -1))

    def _of_free_in(
        self, tree: BodyTree, motion: TreeMotion, run: SensorRun
    ) -> tuple[NDArray, NDArray]:
        sight = sight_of(tree, motion, run)
        residual = sight.shown.residual
        push = Push.of_sight(sight, run.seen)
        if run.mirror:
            across = reflection(tree.mirror(run.mirror).plane)[:3, :3]
            push = replace(push, shift=push.shift @ across)
        by_joint = np.zeros((*residual.shape, len(self.observations.noisy_joints)))
        for i in self.observations.data.free_joints:
            moved = np.flatnonzero(run.seen.moved[:, i])
            one = np.ones((len(moved), 1, 1))
            self._by_whole_pose(i, motion, push, moved, one, by_joint)
        return residual.ravel(), by_joint.reshape(residual.size, -1)

    def _in_mirror(self, J: NDArray, mirror: StandingMirror, push: Push) -> tuple[Push, Push]:
        """Add what the plane moves; return what moves the marker, and what moves the camera does.

        `push` is by shifts of what is seen, about where the marker stands.
        """
        plane, p_WM, shift = mirror.plane, push.p_WM, push.shift
        by_values = reflection_slopes(plane, p_WM) @ mirror.slopes
        J[self._layout.mirror(mirror.name)] = np.moveaxis(shift @ by_values, -1, 0)
        turned = shift @ reflection(plane)[:3, :3]
        return replace(push, shift=turned), replace(push, p_WM=reflect(plane, p_WM))

    def _by_joints(
        self,
        motion: TreeMotion,
        slopes: NDArray,
        push: Push,
        signs: NDArray,
        J: NDArray,
        by_q: NDArray,
        by_joint: NDArray,
        across: NDArray,
    ) -> None:
        """Add what joints' frames, readings and bearings move.

        Args:
            slopes: `TreeParameters.turn_slopes`.
            push: What turns and shifts in W do.
            signs: Whether each joint moves each row, and which way. Shape (N, n).
            J: By all parameters. Shape (P, N, k).
            by_q: By displacements. Shape (n, N, k).
            by_joint: By parts of flanges' poses. Shape (N, k, m).
            across: By turns and shifts of bearings. Shape (4, n, N, k).
        """
        motions, moves = motion.tree.motions, signs.any(axis=0)
        # What moves freely has its own pose, and nothing else.
        framed = moves & (np.array(motions) != FREE)
        by_frames(motion, (slopes, self._layout.frames), push, signs, J, by_q, framed)
        bends = motion.load is not None
        for i in np.flatnonzero(moves).tolist():
            if motions[i] not in WHOLE_POSES and not (bends and motions[i] == REVOLUTE):
                continue
            moved = np.flatnonzero(signs[:, i])
            sign = signs[moved, i][:, None, None]
            if motions[i] in WHOLE_POSES:
                self._by_whole_pose(i, motion, push, moved, sign, by_joint)
            else:
                across[:, i, moved] += sign[:, :, 0] * by_bearing(i, motion, push, moved)

    def _by_whole_pose(
        self,
        i: int,
        motion: TreeMotion,
        push: Push,
        moved: NDArray,
        sign: NDArray,
        by_joint: NDArray,
    ) -> None:
        """Add what turns of a whole pose in its own frame, and shifts in its parent's, move."""
        pose = push.pose[moved]
        about, along = push.of(moved, motion.p_WL[i])
        R = motion.R_WL[i][:, :, pose].transpose(2, 0, 1)
        R_J = motion.R_WJ[i][:, :, pose].transpose(2, 0, 1)
        first = self.observations.noisy_joints.index((i, 0))
        by_joint[moved, :, first : first + 3] += sign * (about @ R)
        by_joint[moved, :, first + 3 : first + 6] += sign * (along @ R_J)

    def _by_attached(
        self,
        J: NDArray,
        motion: TreeMotion,
        slopes: NDArray,
        push: Push,
        ends: AttachedEnds,
        sign: float,
        origin: NDArray | None = None,
    ) -> None:
        """Add what markers (`origin` None), or what sees them, `sign` -1, move on their links."""
        shift, about = sign * push.shift_first, push.turn_first
        about = None if about is None else sign * about
        if origin is not None:
            lever = push.p_first - np.repeat(origin.T, ends.k, axis=1)
            across = cross(lever, shift)
            about = across if about is None else across + about
        rows = J.reshape(len(J), -1)
        for item, own, samples in ends.by_item:
            frame = self._layout.frame_of[item]
            if frame < 0:
                continue
            R = at_samples(motion.R_WL[self._on[item]], samples)
            columns = rows[6 * frame : 6 * frame + 6]
            base = self._layout.frames[frame, :3, :3]
            columns[3:, own] += base.T @ dot_first(shift[:, None, own], R)
            if about is not None:
                columns[:3, own] += slopes[frame].T @ dot_first(about[:, None, own], R)
