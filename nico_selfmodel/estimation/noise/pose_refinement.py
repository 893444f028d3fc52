"""Refinement of an arm by poses: residuals whitened together, variances and outliers renewed.

Least squares over all rows alike let the poses with long levers, where joint noise moves the hand
most, decide; and count the markers of one pose as so many poses.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import (
    ArmSolution,
    Linearised,
    Priors,
    coordinate_sigma,
    information_of,
    pull_of,
    uncertainty_of,
)
from nico_selfmodel.estimation.noise.noise_variances import most_likely_noise
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.noise.variance_components import LinearResiduals
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations, gears_known
from nico_selfmodel.least_squares import NormalEquations
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.optimization.calibration_program import CalibrationProgram, ProgramSolution
from nico_selfmodel.optimization.residual_block import ResidualBlock, SummedBlock, remembers_last
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT
from nico_selfmodel.optimization.uncertainty import covariance_told_by

_LEAST_REDUNDANCY = 15
"""Equations, priors among them, more than parameters, below which two kinds of noise cannot be told
apart."""
_ROUNDS, _SETTLED = 5, 0.02
"""Rounds of variances and solution, and the relative change of a sigma that ends them."""
_STEPS, _STEPS_BETWEEN = 100, 8
"""Limits of the solver at the end, and while the variances still change."""
_TRIMS = 5
"""Rounds in which outliers are looked for again."""
_LEAST_SENSOR = 1e-9
"""Below this, residuals are rounding [m]."""


class PoseWhitened:
    """A residual block whose rows are whitened together, pose by pose."""

    def __init__(self, block: DhResiduals, whitening: PoseWhitening) -> None:
        """Wrap a block of unit sigma.

        Args:
            block: Plain residuals.
            whitening: Frozen while a solver works; `whitening` may be replaced between solutions.
        """
        self.block, self.whitening = block, whitening
        self.names = block.names

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return whitened residuals, shape (3, N), and derivatives, shape (P, 3, N)."""
        return self.whitening.whiten(*self.block.evaluate(x))


def arm_program(
    block: ResidualBlock, parameters: DhParameters, free: frozenset[str]
) -> CalibrationProgram:
    """Return the program of named parameters; all but `free` are pinned where they are."""
    program = CalibrationProgram()
    program.add_variables(parameters.names, parameters.values)
    for name in parameters.names:
        if name not in free:
            program.fix(name)
    program.add_residuals(block)
    return program


def refine_by_pose(
    observations: Observations,
    start: DhParameters,
    free: frozenset[str],
    outliers: NDArray,
    sigma: float,
    *,
    trim: bool = True,
    priors: Priors | None = None,
    noise: PoseNoise | None = None,
) -> ArmSolution:
    """Refine an arm that is near its minimum.

    Args:
        start: The arm; parameters that are not free stay.
        outliers: Outlier rows so far. Boolean, shape (N,).
        sigma: Standard deviation of a coordinate about the start [m].
        trim: Look for outliers again; else `outliers` stay as they are.
        noise: Where the search for it begins, if it is about known.
    """
    refinement = _Refinement(observations, start, free, sigma, priors or {})
    if noise is not None:
        refinement.noise = noise
    for _ in range(_TRIMS):
        refinement.solve(~outliers)
        found = refinement.outliers(outliers) if trim else outliers
        if np.array_equal(found, outliers):
            break
        outliers = found
    refinement.solve(~outliers, apart=True)
    return refinement.solution(outliers)


def counting_variance(observations: Observations, gear: NDArray) -> NDArray:
    """Return the variance of joint angles from reading whole counts, step^2 / 12 [rad^2]. (n,)."""
    step = observations.units.radians_per_unit / gear
    return np.where(gears_known(observations.units), 0.0, step**2 / 12.0)


def conditional_distances(
    linear: Linearised,
    free: frozenset[str],
    keep: NDArray,
    covariance: NDArray | None = None,
    information: NDArray | None = None,
) -> NDArray:
    """Return how far each row is from what the model and the rest of its pose let expect.

    For rows in the fit, with P = S^-1 - S^-1 J C J' S^-1, the squared distance e' P_ii^-1 e of
    e = (P r)_i: that of the row left out (Cook, Weisberg 1982). For the others what the inliers
    rows of their pose tell of its joints is taken off: delta = D G^-1 B' u, G = I + B'B.

    Args:
        keep: Rows in the fit. Boolean, shape (N,).
        covariance: C, where more rows than these tell it. Shape (k, k).
        information: What is known of the parameters beforehand, their inverse variances. (k,).

    Returns:
        Chi square of three coordinates where a row is sound. Shape (N,).
    """
    whitening, noise = linear.whitening, linear.noise
    columns = [i for i, name in enumerate(linear.names) if name in free]
    J = linear.jacobian[:, :, columns]
    size = np.sqrt(np.maximum(np.sum(J**2, axis=(0, 1)), np.finfo(float).tiny))
    J = J / size
    if covariance is None:
        U = linear.weights * linear.whitened(J)
        known = np.zeros(len(size)) if information is None else information / size**2
        C = covariance_told_by(U.T @ U + np.diag(known))
    else:
        C = covariance * np.outer(size, size)
    out = np.zeros(len(keep))
    groups = whitening.groups
    both = np.concatenate([linear.residuals[:, :, None], J], axis=2)
    solved = groups.scatter(whitening.inverse(groups.gather(both)))[keep]
    e, SiJ = solved[:, :, 0], solved[:, :, 1:]
    B = linear.by_angle[keep] * (noise.joint_sigma / noise.sensor_sigma)
    shift, G = whitening.joint_errors(linear.residuals)
    inner = G[groups.pose]
    own = np.eye(3) - B @ inner @ np.swapaxes(B, 1, 2)
    # A row that alone tells a parameter has no residual to speak of: 1e-3 keeps it so.
    left = own * (1.0 + 1e-3) / noise.sensor_sigma**2 - SiJ @ C @ np.swapaxes(SiJ, 1, 2)
    out[keep] = _squares(left, e)
    if not keep.all():
        pose = groups.of(~keep)
        A = linear.by_angle[~keep] * noise.joint_sigma
        r = linear.residuals[~keep] - np.einsum("nij,nj->ni", A, shift[pose])
        spread = noise.sensor_sigma**2 * np.eye(3) + A @ G[pose] @ np.swapaxes(A, 1, 2)
        out[~keep] = _squares(spread + J[~keep] @ C @ np.swapaxes(J[~keep], 1, 2), r)
    return out


def worst_of_visits(distances: NDArray, before: NDArray, visit: NDArray) -> NDArray:
    """Return which rows are outliers: of several in one visit only the worst is new.

    It may have drawn the others along.

    Args:
        distances: `conditional_distances`. Shape (N,).
        before: Outlier rows so far. Boolean, shape (N,).
        visit: Number of each row's visit. Shape (N,).
    """
    found = distances > OUTLIER_AT**2
    new = np.flatnonzero(found & ~before)
    worst = new[np.argsort(-distances[new], kind="stable")]
    first = np.unique(visit[worst], return_index=True)[1]
    found[new] = False
    found[worst[first]] = True
    return found


def _squares(matrix: NDArray, e: NDArray) -> NDArray:
    return np.sum(e * np.linalg.solve(matrix, e[:, :, None])[:, :, 0], axis=1)


def _alike(a: PoseNoise, b: PoseNoise) -> bool:
    """Return whether two noises are the same within a small part."""
    one, two = (np.array([noise.sensor_sigma, *noise.joint_sigma]) for noise in (a, b))
    return bool((np.abs(one - two) <= _SETTLED * np.maximum(one, two)).all())


class _ArmBlock(SummedBlock):
    """The free parameters of an arm, its poses whitened by what is frozen while a solver works."""

    def __init__(
        self, observations: Observations, parameters: DhParameters, columns: list[int]
    ) -> None:
        # Of the parameters only those of the columns may be others later.
        self.observations, self.parameters, self.columns = observations, parameters, columns
        self.names = tuple(parameters.names[i] for i in columns)
        self.whitening: PoseWhitening | None = None

    def at(self, x: NDArray) -> DhParameters:
        """Return the arm with free parameters x. Shape (p,)."""
        values = self.parameters.values
        values[self.columns] = x
        return self.parameters.with_values(values)

    @remembers_last
    def predicted(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return the rows' points, (N, 3), and their derivatives by all parameters, (N, 3, P)."""
        return self.observations.predicted(self.at(x))

    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient and Gauss-Newton matrix from one product of all columns."""
        white = self._white(x)
        sums = white.T @ white
        return 0.5 * float(sums[0, 0]), sums[1:, 0], sums[1:, 1:]

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return whitened residuals, shape (1, T), and derivatives, shape (p, 1, T)."""
        white = self._white(x).T
        return white[:1], white[1:, None]

    def _white(self, x: NDArray) -> NDArray:
        """Return whitened residuals, then derivatives, by visit. Shape (T, 1 + p)."""
        assert self.whitening is not None
        groups = self.whitening.groups
        p, jacobian = self.predicted(x)
        missed = (p - self.observations.p_WH)[:, :, None]
        both = np.concatenate([missed, jacobian[:, :, self.columns]], axis=2)
        both = self.observations.alike(both)
        return self.whitening.counted(self.whitening.root(groups.gather(both)))


class _Refinement:
    """Parameters, noise and program of one refinement under way."""

    def __init__(
        self,
        observations: Observations,
        start: DhParameters,
        free: frozenset[str],
        sigma: float,
        priors: Priors,
    ) -> None:
        self.observations, self.parameters, self.free = observations, start, free
        self.priors = {name: prior for name, prior in priors.items() if name in free}
        self.columns = [i for i, name in enumerate(start.names) if name in free]
        self.noise = PoseNoise(max(sigma, _LEAST_SENSOR), np.zeros(len(start.servos.gear)))
        self.block = _ArmBlock(observations, start, self.columns)
        self.program: CalibrationProgram | None = None
        self.last: ProgramSolution | None = None
        self.iterations = 0
        self.variances_known = False

    def solve(self, keep: NDArray, *, apart: bool = False) -> None:
        """Alternate between the variances and the solution until the variances settle."""
        # What is known beforehand is an equation, too: an effect that is all prior costs nothing.
        redundancy = 3 * int(keep.sum()) + len(self.priors) - len(self.columns)
        self.variances_known = redundancy >= _LEAST_REDUNDANCY
        observations = self.observations
        groups = PoseGroups(observations.visit, keep, 3, observations.pose)
        for _ in range(_ROUNDS):
            self.linear = self.linearised(groups)
            before = self.noise
            if self.variances_known:
                self.noise = self.likeliest_noise(apart)
                self.linear = self.linear.with_noise(self.noise)
            self.step(last=False)
            if not self.variances_known or _alike(before, self.noise):
                break
        if apart:
            self.step(last=True)
        self.linear = self.linearised(groups)

    def linearised(self, groups: PoseGroups) -> Linearised:
        """Return what is linear where the refinement is; a solver has mostly been there."""
        predicted = self.block.predicted(self.parameters.values[self.columns])
        seen = self.observations
        return Linearised.of(seen, self.parameters, groups, self.noise, predicted)

    def likeliest_noise(self, apart: bool) -> PoseNoise:
        """Return the noise that the residuals ask for, with what fitting took from them."""
        linear = self.linear
        groups = linear.whitening.groups
        jacobian = linear.jacobian[:, :, self.columns]
        pull = pull_of(self.parameters, self.columns, self.priors)
        about = linear.residuals - np.tensordot(jacobian, pull, 1)
        residuals = LinearResiduals(
            groups,
            groups.gather(about),
            groups.gather(jacobian),
            linear.by_angle,
            information=self.information if self.priors else None,
        )
        known = counting_variance(self.observations, self.parameters.servos.gear)
        found = most_likely_noise(residuals, self.noise, known, apart=apart)
        return PoseNoise(max(found.sensor_sigma, _LEAST_SENSOR), found.joint_sigma)

    @cached_property
    def information(self) -> NDArray:
        """Inverse variances of what is known beforehand. Shape (p,)."""
        return information_of(self.parameters, self.columns, self.priors)

    def step(self, *, last: bool) -> None:
        """Solve with the whitening as it is, which will change; the last time to the end."""
        if self.program is None:
            self.program = CalibrationProgram()
            self.program.add_variables(self.block.names, self.parameters.values[self.columns])
            self.program.add_residuals(self.block)
            for name, (mean, deviation) in self.priors.items():
                self.program.add_prior(name, mean, deviation)
        self.block.parameters, self.block.whitening = self.parameters, self.linear.whitening
        self.program.move_start(self.parameters.values[self.columns])
        limit = _STEPS if last else _STEPS_BETWEEN
        self.last = self.program.solve(tolerance=1e-7, max_iterations=limit)
        self.iterations += self.last.iterations
        self.parameters = self.block.at(self.last.x)

    def outliers(self, before: NDArray) -> NDArray:
        """Return rows that neither model, nor noise, nor the rest of their pose explains."""
        if not self.variances_known:
            return before
        known = self.information
        distances = conditional_distances(self.linear, self.free, ~before, information=known)
        return worst_of_visits(distances, before, self.observations.visit)

    def solution(self, outliers: NDArray) -> ArmSolution:
        """Return what was found."""
        assert self.last is not None
        uncertainty = uncertainty_of(
            self.linear,
            self.free,
            self.observations,
            self.parameters,
            variances_known=self.variances_known,
            priors=self.priors,
        )
        sigma = coordinate_sigma(self.linear)
        if not self.variances_known and np.isfinite(uncertainty.variance_factor):
            sigma *= float(np.sqrt(uncertainty.variance_factor))
        noise = self.noise if self.variances_known else PoseNoise(sigma, self.noise.joint_sigma)
        return ArmSolution(
            self.parameters,
            self.free,
            outliers,
            uncertainty,
            noise,
            sigma,
            self.last.converged,
            self.iterations,
            self.last.history,
            self.priors,
        )
