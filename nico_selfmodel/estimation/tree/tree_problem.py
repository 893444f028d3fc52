"""One adjustment of any body by any sensors: program, weights, variances, outliers.

All that a pose shows is whitened together, because its joint noise is one draw (see
`noise.pose_noise`), and is linear about where the pose shows its joints (see `joint_errors`). What
is read wrongly by one joint in one pose (a slip) frees that joint there; what neither the body nor
the rest of its pose explains is an outlier.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.alike_errors import Decorrelation
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseWhitening
from nico_selfmodel.estimation.tree import tree_priors
from nico_selfmodel.estimation.tree.boards.poses_apart import PosesApart
from nico_selfmodel.estimation.tree.contradictions.far_jumps import with_far_jumps
from nico_selfmodel.estimation.tree.contradictions.unplaced_markers import come_and_go
from nico_selfmodel.estimation.tree.forward.joint_errors import joint_errors
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.noise.alike_noise import likeliest_alike
from nico_selfmodel.estimation.tree.noise.likeliest_noise import likeliest_noise
from nico_selfmodel.estimation.tree.noise.noise_evidence import NoiseEvidence, tree_whitening
from nico_selfmodel.estimation.tree.pose_tests import check_that_some_agree, tested
from nico_selfmodel.estimation.tree.tree_block import TreeBlock
from nico_selfmodel.estimation.tree.tree_noise import robust_weights, standing_out
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import Alike, Priors
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.losses import Loss

_ROUNDS, _SHARED_ROUNDS = 6, 2
"""Of variances, outliers and solution, and of what poses share."""
_STEPS_BETWEEN = 8
_ROUGH_ROUNDS, _ROUGH_STEPS = 10, 6
_FIRST_JOINT = np.radians(0.1)
"""Where the search for the joints' standard deviation begins [rad]."""
LEAST_REDUNDANCY = 15
"""Equations more than parameters below which kinds of noise cannot be told apart."""


class TreeProblem:
    """What is estimated of a body from one recording, and how."""

    def __init__(
        self,
        residuals: TreeResiduals,
        free: frozenset[str],
        priors: Priors,
        noise: TreeNoise | None = None,
        *,
        noise_known: bool = False,
        alike: Sequence[Alike] = (),
    ) -> None:
        """Prepare.

        Args:
            priors: Means and standard deviations of some of it.
            noise: Where its search begins; what the recording states if omitted.
            noise_known: Whether that is the noise, which few poses would not tell.
            alike: Groups of parameters whose priors have one standard deviation, which is learned.
        """
        self.alike, self.noise_known, self._joint_part = tuple(alike), noise_known, 1.0
        self.poses: NDArray | None = None
        """Whole poses at the last solution, where the search for the next ones begins."""
        self._last: tuple[bytes, TreeLinear] | None = None
        self.residuals = residuals
        self.observations: TreeObservations = residuals.observations
        names = residuals.parameters.names
        self.columns = np.array([i for i, n in enumerate(names) if n in free], dtype=int)
        self.free_names = tuple(names[i] for i in self.columns)
        self.priors: Priors = {n: p for n, p in priors.items() if n in free}
        data = self.observations
        joints = np.full(len(data.noisy_joints), _FIRST_JOINT)
        self.noise = noise or TreeNoise(data.stated_sigma, joints)

    @property
    def scale(self) -> NDArray:
        """Standard deviation of each scalar's sensor. Shape (R,)."""
        return self.noise.sensor[self.observations.noise_group]

    @property
    def _own_scale(self) -> NDArray:
        """The same without what poses share, as whitening is `joined`. Shape (R,)."""
        return self.noise.own.sensor[self.observations.noise_group]

    def program(
        self, values: NDArray, whitening: PoseWhitening | None, pulled: NDArray | None = None
    ) -> CalibrationProgram:
        """Return the program about some values, with its priors. Shapes (P,) and (R,)."""
        program = CalibrationProgram()
        program.add_variables(self.free_names, values[self.columns])
        start = self.residuals.whole_poses(self.residuals.parameters.tree_of(values), self.poses)

        def linear(x: NDArray) -> TreeLinear:
            return self.linear_at(self._with(values, x), start)

        free = self.free_names, self.columns
        joined = whitening is not None and whitening.shared is not None
        scale = self._own_scale if joined else self.scale
        block = TreeBlock(self.observations, free, linear, scale, whitening, pulled)
        program.add_residuals(block)
        for name, (mean, sigma) in self.priors.items():
            program.add_prior(name, mean, sigma)
        return program

    def _boards_free(self, values: NDArray) -> PoseWhitening | None:
        """Return what lets poses that nobody reads go along, weights of joints left out."""
        data = self.observations
        if not (np.isin(data.data.seen_on[data.row], data.data.free_joints) & ~data.apart).any():
            return None
        nothing = np.zeros(len(data.data.observations), dtype=bool)
        linear = self._linear(values, nothing)
        unread = replace(linear, by_joint=np.where(data.unread, linear.by_joint, 0.0))
        return tree_whitening(data, unread, data.groups(nothing), self.noise)

    def linear_at(self, values: NDArray, poses: NDArray | None) -> TreeLinear:
        """Return residuals and derivatives, kept of the last place; see `TreeResiduals.linear`."""
        key = values.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, self.residuals.linear(values, poses)
        return self._last[1]

    def _linear(self, values: NDArray, outliers: NDArray) -> TreeLinear:
        """Return residuals and derivatives, poses of what no joint moves eliminated."""
        keep = ~outliers[self.observations.row]
        linear = self.linear_at(values, self.poses)
        self.poses = linear.poses
        return PosesApart.of(self.observations, keep).eliminated(linear, self.scale)

    def rough(self, values: NDArray, rounds: int = _ROUGH_ROUNDS) -> tuple[NDArray, float]:
        """Solve from afar, each sensor weighed by itself and far observations hardly at all.

        Cauchy's loss on whole observations, its scale renewed from the median of each sensor.

        Args:
            values: Start. Shape (P,).
            rounds: Of weights and steps at most.

        Returns:
            The values, shape (P,), and a cost by which starts can be compared.
        """
        cost, before = np.inf, np.inf
        for _ in range(rounds):
            weight, cost = self._cauchy(values)
            if abs(before - cost) < 1e-3 * abs(cost):
                break
            before = cost
            program = self.program(values, self._boards_free(values))
            program.set_loss(0, Loss(), weight)
            solution = program.solve(max_iterations=_ROUGH_STEPS, tolerance=1e-5)
            values = self._with(values, solution.x)
        return values, self._cauchy(values)[1]

    def _cauchy(self, values: NDArray) -> tuple[NDArray, float]:
        """Return weights of all scalars and the robust cost, sum of k log(scale) and rho."""
        r = self.residuals.residuals(values) / self.scale
        weight, cost = robust_weights(self.observations, r)
        rest = tree_priors.prior_rows(self.priors, self.free_names, self._by_name(values))[1]
        return weight, cost + float(rest @ rest)

    def refine(
        self, values: NDArray, outliers: NDArray | None = None, *, trim: bool = True
    ) -> TreeSolution:
        """Solve near the minimum: variances, slips and outliers renewed, poses whitened.

        Args:
            values: Start, near the minimum. Shape (P,).
            outliers: Observations to leave out at first, by row of the table; those that stand
                out at the start if omitted. Shape (N,).
            trim: Look for outliers and slips; else all counts alike.

        Raises:
            ContradictedError: If every observation is an outlier.
        """
        data = self.observations
        left = self.residuals.residuals(values) / self.scale
        told = len(self.columns) - len(self.priors)
        found = (standing_out(data, left, told) if outliers is None else outliers) & trim
        groups = data.groups(found)
        slipped = np.zeros((groups.poses, len(data.noisy_joints)), dtype=bool)
        known, steps, rounds, returned = False, 0, 0, np.zeros_like(found)
        while rounds < _ROUNDS:
            linear = self._linear(values, found)
            equations = int((~found[data.row]).sum()) + len(self.priors)
            known = self.noise_known or equations - len(self.columns) >= LEAST_REDUNDANCY
            before = self.noise
            if known and not self.noise_known:
                noise = likeliest_noise(self._evidence(linear, groups, slipped, values), self.noise)
                self.noise = replace(noise, joint=self._joint_part * noise.joint)
            whitening = tree_whitening(data, linear, groups, self.noise, slipped)
            program = self.program(values, whitening, linear.pulled)
            solution = program.solve(max_iterations=_STEPS_BETWEEN, tolerance=1e-7)
            values, steps = self._with(values, solution.x), steps + solution.iterations
            linear = self._about_poses(values, groups, slipped, found, jumps=known and trim)
            now_slipped, now_found, new = slipped, found, groups
            settled = not known or self._learned_priors(values, found, slipped)
            if known and trim:
                by_visit, now_found = self._tested(linear, groups, found, not self.noise_known)
                now_found = now_found | come_and_go(data.data, returned, found)
                returned |= found & ~now_found
                new = data.groups(now_found)
                now_slipped = by_visit[new.numbers]
            same = np.array_equal(now_found, found) and np.array_equal(now_slipped, slipped)
            check_that_some_agree(new, data, now_found)
            slipped, found, groups = now_slipped, now_found, new
            rounds += self.noise.loud == before.loud  # a joint is found to be loud once at most
            if same and self.noise.is_like(before) and settled:
                break
        if known and not self.noise_known:
            slipped = self._share(values, slipped, found, trim=trim)
        return self._finish(values, slipped, found, known, steps)

    def _share(
        self, values: NDArray, slipped: NDArray, outliers: NDArray, *, trim: bool
    ) -> NDArray:
        """Let poses that are alike share errors where they do; return slips beside these."""
        groups = self.observations.groups(outliers)
        for _ in range(_SHARED_ROUNDS):
            linear = self._linear(values, outliers)
            found = likeliest_alike(self._evidence(linear, groups, slipped, values), self.noise)
            if found is None:
                break
            self.noise = found
            how = linear, groups, self.noise, slipped
            whitening = tree_whitening(self.observations, *how, joined=True)
            program = self.program(values, whitening, linear.pulled)
            x = program.solve(max_iterations=_STEPS_BETWEEN, tolerance=1e-7).x
            values = self._with(values, x)
            if trim and any(one.turns is not None for one in found.alike):
                # What a sensor's turns share had been taken for slips of joints.
                linear = self._about_poses(values, groups, slipped, outliers)
                by_visit = self._tested(linear, groups, outliers, False)[0]
                slipped = by_visit[groups.numbers]
        return slipped

    def solve_from(self, before: TreeSolution) -> TreeSolution:
        """Solve where an adjustment of less that was free ended, its noise and outliers kept.

        Args:
            before: Of the same observations; its values are of these parameters.
        """
        slipped = before.slipped_in(self.observations.groups(before.outliers).numbers)
        self.noise = before.noise
        return self._finish(before.values, slipped, before.outliers, before.variances_known)

    def _about_poses(
        self,
        values: NDArray,
        groups: PoseGroups,
        slipped: NDArray,
        outliers: NDArray,
        *,
        jumps: bool = False,
    ) -> TreeLinear:
        """Take joints to be where each pose shows them, be it far; return what is linear there."""
        linear = self._linear(values, outliers)
        whitening = tree_whitening(self.observations, linear, groups, self.noise, slipped)
        loose = self.observations.unread_in(groups.poses, slipped)
        errors = joint_errors(self.observations, whitening, linear.r / self.scale, loose)
        if jumps:
            how = values, outliers, linear.by_joint, self.scale
            errors = with_far_jumps(self.residuals, *how, errors)
        self.residuals, self._last = self.residuals.erring(errors), None
        return self._linear(values, outliers)

    def _finish(
        self, values: NDArray, slipped: NDArray, outliers: NDArray, known: bool, steps: int = 0
    ) -> TreeSolution:
        groups = self.observations.groups(outliers)
        linear = self._about_poses(values, groups, slipped, outliers)
        how = linear, groups, self.noise, slipped
        whitening = tree_whitening(self.observations, *how, joined=True)
        solution = self.program(values, whitening, linear.pulled).solve(tolerance=1e-8)
        values = self._with(values, solution.x)
        rows, white, shared = self._whitened(values, outliers, slipped)
        prior, rest = tree_priors.prior_rows(self.priors, self.free_names, self._by_name(values))
        if self.observations.data.free_joints:
            self.residuals = self.residuals.about(self.residuals.parameters, self.poses)
        by_visit = np.zeros((self.observations.visits, slipped.shape[1]), dtype=bool)
        real = groups.numbers < len(by_visit)
        by_visit[groups.numbers[real]] = slipped[real]
        return TreeSolution(
            values,
            self.noise,
            outliers,
            by_visit,
            solution.cost,
            solution.converged,
            steps + solution.iterations,
            known,
            np.vstack([rows, prior]),
            np.append(white, rest),
            solution.history,
            self.residuals.joint_errors,
            shared,
        )

    def _whitened(
        self, values: NDArray, outliers: NDArray, slipped: NDArray | None,
        beside: NDArray | None = None,
    ) -> tuple[NDArray, NDArray, Decorrelation | None]:  # fmt: skip
        """Return whitened derivatives by what is free, and residuals, of what counts."""
        groups = self.observations.groups(outliers)
        linear = self._linear(values, outliers)
        r = (linear.r / self._own_scale)[None]
        by_all = linear.J[self.columns]
        by_all = by_all if beside is None else np.vstack([by_all, beside.T])
        J = (by_all / self._own_scale)[:, None]
        whitening = tree_whitening(
            self.observations, linear, groups, self.noise, slipped, joined=True
        )
        white, slopes = whitening.whiten(r, J)
        keep = np.zeros(len(self.observations.row), dtype=bool)
        keep[groups.rows] = True
        return slopes[:, 0, keep].T, white[0, keep], whitening.shared_by_row

    def whitened_at(
        self, solution: TreeSolution, beside: NDArray | None = None
    ) -> tuple[NDArray, NDArray]:
        """Return whitened derivatives and residuals where another problem's adjustment ended.

        Args:
            solution: Of the same observations and noise, with other parameters free.
            beside: Derivatives of the residuals by what no body has as a parameter, whitened
                alike. Shape (R, e).

        Returns:
            By what is free here and then by that, shape (k, free + e), and what is left, shape
            (k,).
        """
        self.residuals, self._last = self.residuals.erring(solution.joint_errors), None
        slipped = solution.slipped_in(self.observations.groups(solution.outliers).numbers)
        return self._whitened(solution.values, solution.outliers, slipped, beside)[:2]

    def whitened_start(self) -> NDArray:
        """Return whitened derivatives where the parameters begin, all that was seen counted."""
        nothing = np.zeros(len(self.observations.data.observations), dtype=bool)
        return self._whitened(self.residuals.parameters.start, nothing, None)[0]

    def evidence_at(self, solution: TreeSolution) -> NoiseEvidence:
        """Return what tells the noise where an adjustment ended."""
        groups = self.observations.groups(solution.outliers)
        linear = self._linear(solution.values, solution.outliers)
        return self._evidence(linear, groups, solution.slipped_in(groups.numbers), solution.values)

    def _learned_priors(self, values: NDArray, outliers: NDArray, slipped: NDArray) -> bool:
        """Let priors be as wide as the data ask for; return whether they were."""
        if not self.alike:
            return True
        white, now = self._whitened(values, outliers, slipped)[:2], self._by_name(values)
        before, known = self.priors, (self.priors, self.alike, self.free_names)
        self.priors = tree_priors.expected_priors(*known, now, white)
        return tree_priors.are_alike(before, self.priors)

    def _by_name(self, values: NDArray) -> dict[str, float]:
        return dict(zip(self.free_names, values[self.columns].tolist(), strict=True))

    def _with(self, values: NDArray, x: NDArray) -> NDArray:
        out = values.copy()
        out[self.columns] = x
        return out

    def _evidence(
        self, linear: TreeLinear, groups: PoseGroups, slipped: NDArray | None, values: NDArray
    ) -> NoiseEvidence:
        """Return what residuals are asked for their noise by, with what fitting took from them."""
        names, J = self.residuals.parameters.names, linear.J[self.columns]
        few = len(groups.rows) - len(self.columns) < LEAST_REDUNDANCY
        bends = names[self.residuals.parameters.bends]
        priors = tree_priors.beside_noise(self.priors, self.observations, bends, few=few)
        known = tree_priors.information_of(priors, self.free_names)
        pull = tree_priors.pull_of(priors, self.free_names, self._by_name(values))
        own = replace(linear, r=linear.r + pull @ J, J=J)
        loose = self.observations.unread_in(groups.poses, slipped)
        return NoiseEvidence(self.observations, own, groups, loose, known)

    def _tested(
        self, linear: TreeLinear, groups: PoseGroups, outliers: NDArray, louder: bool
    ) -> tuple[NDArray, NDArray]:
        """Return what slipped, by visit, and what is an outlier; ask for louder joints too."""
        prior = tree_priors.information_of(self.priors, self.free_names)
        mine = replace(linear, J=linear.J[self.columns])
        all_of_them = frozenset(range(len(self.noise.joint)))
        noise = self.noise if louder else replace(self.noise, loud=all_of_them)
        far, slips = tested(self.observations, mine, groups, noise, prior, outliers)
        self.noise = replace(self.noise, loud=self.noise.loud | slips.louder)
        self._joint_part = 1.0 if slips.part is None else slips.part * self._joint_part
        return slips.slipped, far
