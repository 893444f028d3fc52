"""Learning some parameters of a known body anew, the rest as well as it is known."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.noise.contradictions import Contradictions, hand_contradictions
from nico_selfmodel.estimation.noise.expected_misfit import expected_misfit
from nico_selfmodel.estimation.noise.hand_observations import (
    HandObservations,
    covariance_of,
    with_values,
)
from nico_selfmodel.estimation.results.unobservable_words import why_so_few_are_refused
from nico_selfmodel.estimation.results.verdict import outliers_are_many
from nico_selfmodel.model.self_model import ParameterCovariance, SelfModel
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.optimization.calibration_program import CalibrationProgram, ProgramSolution
from nico_selfmodel.optimization.losses import Loss
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT, ROBUST_METHODS
from nico_selfmodel.optimization.uncertainty import Uncertainty

_FITS = 4.0
"""Standard deviations of the misfit beyond which the rest of the body no longer fits."""
_ROUNDS = 2
"""Further solutions, each weighed where the last one ended."""


def update_words(misfit: float, expected: float) -> str:
    """Say what is left of new observations, and what was to be expected."""
    return f"misfit {misfit:.0f}, {expected:.0f} was to be expected"


@dataclass(frozen=True, eq=False)
class BlockUpdate:
    """A body of which a block of parameters was learned anew."""

    model: SelfModel
    """The body with the new values and their covariance with all others."""
    learned: tuple[str, ...]
    """Names of the block."""
    outliers: NDArray
    """Outlier rows. Boolean, shape (N,)."""
    misfit: float
    """Sum of squared innovations of the inlier rows, what the rest is uncertain by included."""
    expected: float
    """What `misfit` is to be expected to be."""
    spread: float
    """Standard deviation of `misfit` about that."""
    converged: bool
    iterations: int
    against: Contradictions | None = None
    """Poses that contradict what was learned; None where the body does not say the noise."""

    @property
    def score(self) -> float:
        """How many standard deviations the misfit lies above what was to be expected."""
        return (self.misfit - self.expected) / self.spread if self.spread > 0.0 else 0.0

    @property
    def misfit_words(self) -> str:
        """What is left of the observations, in words: of those that were not set aside."""
        if not self._contradicted:
            return update_words(self.misfit, self.expected)
        if self.against is not None:
            return self.against.words
        wrong = f"{self.outliers.sum()} of {self.outliers.size}"
        return f"{wrong} observations contradict what was learned"

    @property
    def fits(self) -> bool:
        """Whether the rest of the body still fits the data."""
        return self.score < _FITS and not self._contradicted

    @property
    def _contradicted(self) -> bool:
        """Whether more contradicts than false detections explain."""
        if self.against is None:
            return outliers_are_many(self.outliers) is not None
        return self.against.too_many


def learn_block(
    model: SelfModel,
    observations: HandObservations,
    names: tuple[str, ...],
    *,
    scales: NDArray,
    loss: str = "trimmed",
) -> BlockUpdate:
    """Learn a block of parameters from observations, all others held.

    The block's covariance includes what the others are uncertain by: with data r = J_z dz + J_b db,
    dz = -(J_z'J_z)^-1 J_z' (r - J_b db). Rows are outliers that contradict the others however the
    rest of the body errs, within what it is uncertain by: its own error is alike in all rows.

    Args:
        observations: The data, as `hand_observations_of` this model.
        names: What to learn.
        scales: Natural scale of each, on which its sigma says whether it is known. Shape (k,).
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.

    Raises:
        NotIdentifiableError: If the data leave a parameter of the block open; it names them.
    """
    columns = np.array([observations.names.index(name) for name in names], dtype=int)
    program = _program(observations, columns)
    _require_known(observations, columns, names, scales)
    solution, outliers = _settle(program, observations, loss)
    if outliers.any():
        outliers = _off_whatever_errs(model, replace(observations, x=solution.x), columns, loss)
        solution = _settle_on(program, observations, solution, outliers, loss)
    x, inliers = solution.x, ~outliers
    at = replace(observations, x=x)
    _, jacobian = observations.block.evaluate(x)
    stacked = jacobian[:, :, inliers].reshape(len(x), -1).T
    # The variances are known: nothing is scaled by the misfit of a few poses.
    uncertainty = Uncertainty.from_jacobian(names, stacked[:, columns], scales, 0.0, 0)
    updated = with_values(model, observations.names, x)
    covariance = _joint_covariance(model, observations.names, stacked, columns, uncertainty)
    updated = replace(updated, covariance=covariance)
    misfit = _misfit(model, at, inliers, columns)
    found = _update(model, updated, names, at, outliers, misfit, solution)
    if found.score < _FITS:
        return found
    return replace(found, misfit=min(misfit, _least_misfit(model, at, inliers, columns)))


def learn_with_prior(
    model: SelfModel,
    observations: HandObservations,
    names: tuple[str, ...],
    *,
    scales: NDArray,
    loss: str = "trimmed",
) -> BlockUpdate:
    """Learn a block of parameters, the rest of the body free under its posterior as prior.

    Args:
        model: The body; its covariance is the prior.
        observations: The data, as `hand_observations_of` this model.
        names: What has no prior.
        scales: Natural scale of each of `names`. Shape (k,).
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.

    Raises:
        NotIdentifiableError: If the data leave a parameter of the block open.
    """
    columns = np.array([observations.names.index(name) for name in names], dtype=int)
    program, known, block = _program_with_prior(model, observations, columns)
    _require_known(observations, columns, names, scales)
    solution, outliers = _settle(program, observations, loss)
    x, inliers = solution.x, ~outliers
    free = np.sort(np.concatenate([known, columns]))
    r, jacobian = observations.block.evaluate(x)
    information = jacobian[free][:, :, inliers].reshape(len(free), -1)
    information = information @ information.T
    inside = np.isin(free, known)
    information[np.ix_(inside, inside)] += block.information
    size = 1.0 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(size, size)) * np.outer(size, size)
    free_names = tuple(observations.names[i] for i in free)
    updated = replace(
        with_values(model, observations.names, x),
        covariance=ParameterCovariance(free_names, covariance),
    )
    misfit = float(np.sum(r[:, inliers] ** 2))
    at = replace(observations, x=x)
    return _update(model, updated, names, at, outliers, misfit, solution)


_HAND = 0
"""Number of the hand's block in a program."""


def _program(observations: HandObservations, free: NDArray) -> CalibrationProgram:
    """Return the program of the hand's observations in which some columns are free."""
    program = CalibrationProgram()
    program.add_variables(observations.names, observations.x)
    for i, name in enumerate(observations.names):
        if i not in free:
            program.fix(name)
    observations.block.whiten(observations.whitening())
    assert program.add_residuals(observations.block) == _HAND
    return program


def _program_with_prior(
    model: SelfModel, observations: HandObservations, columns: NDArray
) -> tuple[CalibrationProgram, NDArray, "_GaussianPrior"]:
    """Return the program in which some columns are free and all that may err is, under its prior.

    Args:
        observations: Where what may err has its mean.
        columns: Numbers of what has no prior. Shape (k,).

    Returns:
        The program, numbers of what may err, shape (m,), and their prior.
    """
    prior = covariance_of(model, observations.names)
    known = np.setdiff1d(np.flatnonzero(np.diag(prior) > 0.0), columns)
    program = _program(observations, np.concatenate([known, columns]))
    names = tuple(observations.names[i] for i in known)
    block = _GaussianPrior(names, observations.x[known], prior[np.ix_(known, known)])
    if len(known):
        program.add_residuals(block)
    return program, known, block


def _off_whatever_errs(
    model: SelfModel, observations: HandObservations, columns: NDArray, loss: str
) -> NDArray:
    """Return the rows that contradict the others however the rest of the body errs. Shape (N,).

    Args:
        observations: Where the block was learned, the rest as it is known.
        columns: Numbers of the block. Shape (k,).
    """
    program, _, _ = _program_with_prior(model, observations, columns)
    return _settle(program, observations, loss)[1]


def _settle_on(
    program: CalibrationProgram,
    observations: HandObservations,
    start: ProgramSolution,
    outliers: NDArray,
    loss: str,
) -> ProgramSolution:
    """Solve with outliers that are known already, and weigh anew where the solution is."""
    if loss != "trimmed":
        return start
    solution = start
    for _ in range(1 + _ROUNDS):
        program.move_start(solution.x)
        observations.block.whiten(replace(observations, x=solution.x).whitening())
        program.set_loss(_HAND, Loss(), (~outliers).astype(float))
        solution = program.solve()
    return solution


def _update(
    model: SelfModel,
    updated: SelfModel,
    names: tuple[str, ...],
    at: HandObservations,
    outliers: NDArray,
    misfit: float,
    solution: ProgramSolution,
) -> BlockUpdate:
    """Return what was learned beside what was to be expected of it."""
    return BlockUpdate(
        updated,
        names,
        outliers,
        misfit,
        *expected_misfit(model, at, ~outliers, len(names)),
        solution.converged,
        solution.iterations,
        hand_contradictions(updated, at),
    )


def _settle(
    program: CalibrationProgram, observations: HandObservations, loss: str
) -> tuple[ProgramSolution, NDArray]:
    """Solve, and weigh anew where the solution is: play moves a far point more than a near one."""
    solution, outliers = _solve(program, loss)
    for _ in range(_ROUNDS):
        program.move_start(solution.x)
        observations.block.whiten(replace(observations, x=solution.x).whitening())
        solution, outliers = _solve(program, loss)
    return solution, outliers


def _solve(program: CalibrationProgram, loss: str) -> tuple[ProgramSolution, NDArray]:
    """Solve with the variances taken as known: a few poses cannot tell their own scale.

    Returns:
        The solution, and which rows are outliers.
    """
    refuse_unknown("loss", loss, ROBUST_METHODS)
    program.set_loss(_HAND, Loss("cauchy" if loss == "trimmed" else loss))
    solution = program.solve()
    r = program.residuals(_HAND, solution.x)
    if loss == "none":
        return solution, np.zeros(r.shape[1], dtype=bool)
    outliers = np.linalg.norm(r, axis=0) > OUTLIER_AT * np.sqrt(len(r) / 3.0)
    if loss == "trimmed":
        program.move_start(solution.x)
        program.set_loss(_HAND, Loss(), (~outliers).astype(float))
        solution = program.solve()
    return solution, outliers


class _GaussianPrior:
    """W (x - mean) with W'W the inverse of a covariance, as one observation."""

    def __init__(self, names: tuple[str, ...], mean: NDArray, covariance: NDArray) -> None:
        self.names, self._mean = names, mean
        size = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(size, size)
        # Beside what nobody knows all that is known has small eigenvalues, down to rounding.
        values, vectors = np.linalg.eigh(correlation)
        values = np.maximum(values, 1e-13)
        self._root = (vectors / np.sqrt(values)).T / size
        self.information = self._root.T @ self._root

    def evaluate(self, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return the residual, shape (k, 1), and its derivatives, shape (k, k, 1)."""
        return (self._root @ (x - self._mean))[:, None], self._root.T[:, :, None]


def _require_known(
    observations: HandObservations, columns: NDArray, names: tuple[str, ...], scales: NDArray
) -> None:
    """Refuse data that leave a parameter open, before anything is solved."""
    if not names:
        return
    _, jacobian = observations.block.evaluate(observations.x)
    stacked = jacobian[columns].reshape(len(columns), -1).T
    unobservable = Uncertainty.from_jacobian(names, stacked, scales, 0.0, 0).unobservable
    if not unobservable:
        return
    found = (
        "1 observation is" if len(observations) == 1 else f"{len(observations)} observations are"
    )
    zeros = [name for name in names if name.endswith(".theta_offset")]
    raise NotIdentifiableError(why_so_few_are_refused(found, unobservable, zeros))


def _joint_covariance(
    model: SelfModel,
    names: tuple[str, ...],
    stacked: NDArray,
    columns: NDArray,
    uncertainty: Uncertainty,
) -> ParameterCovariance:
    """Return the covariance of the block with everything else the model knows."""
    old = model.covariance
    fresh = uncertainty.covariance
    learned = uncertainty.names
    kept = () if old is None else tuple(name for name in old.names if name not in learned)
    if old is None or not kept:
        return ParameterCovariance(learned, fresh)
    own = [old.names.index(name) for name in kept]
    before = old.matrix[np.ix_(own, own)]
    # What the data say of the rest acts on the block through gain = -(Jz'Jz)^-1 Jz' Jb.
    others = np.zeros((len(stacked), len(kept)))
    for i, name in enumerate(kept):
        if name in names:
            others[:, i] = stacked[:, names.index(name)]
    gain = -fresh @ stacked[:, columns].T @ others
    cross = gain @ before
    matrix = np.block([[before, cross.T], [cross, fresh + cross @ gain.T]])
    return ParameterCovariance((*kept, *learned), 0.5 * (matrix + matrix.T))


def _misfit(
    model: SelfModel, observations: HandObservations, inliers: NDArray, columns: NDArray
) -> float:
    """Return the sum of squared innovations.

    The rest of the body is one unknown for all rows, so the rows are taken together.
    """
    prior = covariance_of(model, observations.names)
    prior[columns] = 0.0
    prior[:, columns] = 0.0
    r, jacobian = observations.block.evaluate(observations.x)
    r, rows = r[:, inliers].ravel(), jacobian[:, :, inliers].reshape(len(jacobian), -1)
    free = np.flatnonzero(np.diag(prior) > 0.0)
    misfit = float(r @ r)
    if len(free):
        # Woodbury: r' (I + J C J')^-1 r = |r|^2 - b' (C^-1 + J'J)^-1 b
        j = rows[free]
        root = _GaussianPrior((), np.zeros(len(free)), prior[np.ix_(free, free)]).information
        b = j @ r
        size = 1.0 / np.sqrt(np.diag(root))
        scaled = (root + j @ j.T) * np.outer(size, size)
        misfit -= float((size * b) @ np.linalg.solve(scaled, size * b))
    return misfit


def _least_misfit(
    model: SelfModel, observations: HandObservations, inliers: NDArray, columns: NDArray
) -> float:
    """Return the least sum of squares, those of the prior among them, by which all may err.

    `_misfit` takes the block where it fits a body without errors best, and slopes for what may be
    too far away for them.
    """
    program, known, _ = _program_with_prior(model, observations, columns)
    program.set_loss(_HAND, Loss(), inliers.astype(float))
    x = program.solve().x
    prior = np.sum(program.residuals(_HAND + 1, x) ** 2) if len(known) else 0.0
    return float(np.sum(program.residuals(_HAND, x)[:, inliers] ** 2) + prior)
