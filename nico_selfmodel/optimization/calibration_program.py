"""A program of named variables and residual blocks with analytic derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.least_squares import NormalEquations, Step, levenberg_marquardt
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.optimization.losses import Loss
from nico_selfmodel.optimization.residual_block import ResidualBlock, SummedBlock
from nico_selfmodel.optimization.separable_block import (
    SeparableBlock,
    eliminated_step,
    shared_information,
)
from nico_selfmodel.optimization.uncertainty import covariance_told_by

if TYPE_CHECKING:
    from pydrake.solvers import MathematicalProgram

SOLVERS = ("lm", "snopt", "ipopt")


@dataclass(frozen=True, eq=False)
class ProgramSolution:
    """Where a solver stopped."""

    x: NDArray
    """All decision variables. Shape (p,)."""
    cost: float
    """Half the (robust) sum of squares."""
    converged: bool
    """Whether the solver reports a minimum."""
    iterations: int
    """Of the Levenberg-Marquardt solver; 0 for the others, which do not tell."""
    history: tuple[float, ...]
    """Costs after accepted steps."""


@dataclass
class _Term:
    block: ResidualBlock
    columns: NDArray
    loss: Loss
    weights: NDArray | None


class CalibrationProgram:
    """Named decision variables, fixed ones, priors and residual blocks.

    `prog` is the very same problem as a MathematicalProgram, for SNOPT, IPOPT and whatever else
    Drake has. It is made when it is asked for. What is added to `prog`, as constraints, counts in
    the solvers of Drake that `prog` is given to, not in the Levenberg-Marquardt solver, and not in
    the `prog` of a start or variables that changed. The program knows nothing of robots.
    """

    def __init__(self) -> None:
        """Start without variables."""
        self._index: dict[str, int] = {}
        self._start = np.zeros(0)
        self._terms: list[_Term] = []
        self._priors: dict[int, tuple[float, float]] = {}
        self._fixed: dict[int, float] = {}
        self._prog: MathematicalProgram | None = None

    @property
    def prog(self) -> "MathematicalProgram":
        """The program as Drake sees it; another one after the variables or their start changed."""
        if self._prog is None:
            from nico_selfmodel.optimization.drake_program import drake_program

            self._prog = drake_program(self.names, self._start, self._fixed, self.normal_equations)
        return self._prog

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the decision variables, in their order."""
        return tuple(self._index)

    @property
    def start(self) -> NDArray:
        """The values from which a solver starts. Shape (p,)."""
        return self._start.copy()

    def move_start(self, x: NDArray) -> None:
        """Start the next solution from here. Shape (p,)."""
        self._start[:] = x
        self._prog = None

    @property
    def free(self) -> NDArray:
        """Which variables are not fixed. Boolean, shape (p,)."""
        free = np.ones(len(self._start), dtype=bool)
        free[list(self._fixed)] = False
        return free

    def add_variables(self, names: Sequence[str], start: ArrayLike) -> None:
        """Add decision variables.

        Args:
            names: New, unique names.
            start: Initial values. Shape (len(names),).

        Raises:
            ValueError: If a name is taken or the start has another length or is not finite.
        """
        values = np.asarray(start, dtype=float)
        if values.shape != (len(names),) or not np.isfinite(values).all():
            raise ValueError(f"start must be {len(names)} finite numbers, got {values}")
        taken = set(names) & self._index.keys() or len(set(names)) != len(names)
        if taken:
            raise ValueError(f"names must be new and unique, got {list(names)}")
        self._index |= {name: len(self._index) + k for k, name in enumerate(names)}
        self._start = np.append(self._start, values)
        self._prog = None

    def index(self, name: str) -> int:
        """Return the position of a variable.

        Raises:
            ValueError: If there is none of that name; the message lists those there are.
        """
        if name not in self._index:
            refuse_unknown("parameter", name, self.names)
        return self._index[name]

    def fix(self, name: str, value: float | None = None) -> None:
        """Hold a variable at a value, its start if omitted; replaces an earlier value."""
        index = self.index(name)
        if value is not None:
            self._start[index] = value
        self._fixed[index] = float(self._start[index])
        self._prog = None

    def release(self, name: str) -> None:
        """Let a variable move again; nothing happens where it was not fixed."""
        self._fixed.pop(self.index(name), None)
        self._prog = None

    def add_prior(self, name: str, mean: float, sigma: float) -> None:
        """Add ((x - mean) / sigma)^2 to the sum of squares; replaces a variable's earlier prior.

        Raises:
            ValueError: If sigma is not positive.
        """
        if not sigma > 0.0:
            raise ValueError(f"the sigma of a prior must be positive, got {sigma} for {name}")
        self._priors[self.index(name)] = float(mean), float(sigma)

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Mean and sigma of the variables that have a prior."""
        names = self.names
        return {names[index]: prior for index, prior in self._priors.items()}

    def add_residuals(self, block: ResidualBlock) -> int:
        """Add a residual block; its variables must exist. Returns its number, for `set_loss`."""
        columns = np.array([self.index(name) for name in block.names])
        self._terms.append(_Term(block, columns, Loss(), None))
        return len(self._terms) - 1

    def set_loss(self, number: int, loss: Loss, weights: NDArray | None = None) -> None:
        """Change a block's loss and give its observations weights (0 leaves one out)."""
        self._terms[number].loss = loss
        self._terms[number].weights = weights

    def residuals(self, number: int, x: NDArray) -> NDArray:
        """Return the whitened residuals of a block, without loss or weights. Shape (k, N)."""
        term = self._terms[number]
        values = np.asarray(x)[term.columns]
        if isinstance(term.block, SeparableBlock):
            return term.block.residuals(values)
        return term.block.evaluate(values)[0]

    def prediction_covariances(self, number: int, x: NDArray) -> NDArray | None:
        """Return what a solution's own uncertainty adds to each observation's residual.

        J H^-1 J' of each observation (its leverage, where it has weight 1). None where observations
        have variables of their own, of which the others tell nothing.

        Args:
            number: Of the block.
            x: The solution. Shape (p,).

        Returns:
            Covariances in units of the observations' variance, shape (N, k, k), or None.
        """
        term = self._terms[number]
        if isinstance(term.block, SeparableBlock):
            return None
        jacobian = term.block.evaluate(np.asarray(x)[term.columns])[1]
        known, information = self._information_of(term.columns, x)
        inverse = np.zeros((len(x), len(x)))
        inverse[np.ix_(known, known)] = covariance_told_by(information)
        J = jacobian.transpose(2, 1, 0)
        return J @ inverse[np.ix_(term.columns, term.columns)] @ J.transpose(0, 2, 1)

    def _information_of(self, columns: NDArray, x: NDArray) -> tuple[NDArray, NDArray]:
        """Return free variables, `columns` among them, and what is known of them at x.

        Variables that only one observation depends on are eliminated where there are any.
        """
        free = np.flatnonzero(self.free)
        information = self.normal_equations(x)[2][np.ix_(free, free)]
        own = self.own_variables
        if own is None or np.isin(own, columns).any() or not np.isin(own, free).all():
            return free, information
        reduced = shared_information(information, np.searchsorted(free, own))
        return (free, information) if reduced is None else (free[reduced[0]], reduced[1])

    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient and Gauss-Newton matrix of the whole (robust) sum of squares.

        f = sum rho(|r|^2) / 2, g = sum w J'r, H = sum w J'J (iteratively reweighted).

        Args:
            x: All decision variables. Shape (p,).

        Returns:
            Cost, gradient, shape (p,), and matrix, shape (p, p).
        """
        cost, gradient = 0.0, np.zeros(len(x))
        hessian = np.zeros((len(x), len(x)))
        for term in self._terms:
            if isinstance(term.block, SeparableBlock):
                parts = term.block.evaluate_parts(x[term.columns])
                rho, weight = _weigh(term, parts[0].T)
                cost += 0.5 * float(rho.sum())
                term.block.add_normal_equations(parts, weight, term.columns, gradient, hessian)
                continue
            plain = term.weights is None and term.loss.kind == "none"
            if plain and isinstance(term.block, SummedBlock):
                value, slope, matrix = term.block.normal_equations(x[term.columns])
                cost += value
                gradient[term.columns] += slope
                hessian[np.ix_(term.columns, term.columns)] += matrix
                continue
            r, jacobian = term.block.evaluate(x[term.columns])
            rho, weight = _weigh(term, r)
            cost += 0.5 * float(rho.sum())
            if not plain:
                root = np.sqrt(weight)
                r, jacobian = r * root, jacobian * root
            flat = jacobian.reshape(len(term.columns), -1)
            gradient[term.columns] += flat @ r.ravel()
            hessian[np.ix_(term.columns, term.columns)] += flat @ flat.T
        for index, (mean, sigma) in self._priors.items():
            z = (x[index] - mean) / sigma
            cost += 0.5 * z * z
            gradient[index] += z / sigma
            hessian[index, index] += sigma**-2
        return cost, gradient, hessian

    @property
    def own_variables(self) -> NDArray | None:
        """Indices of variables that only one observation depends on; None if there are none.

        Shape (V, m): those of the separable block, where the program has exactly one and no other
        block ties two of its observations together.
        """
        separable = [term for term in self._terms if isinstance(term.block, SeparableBlock)]
        if len(separable) != 1:
            return None
        (term,) = separable
        assert isinstance(term.block, SeparableBlock)
        own = term.block.shared_and_own(term.columns)[1]
        for other in self._terms:
            touched = np.isin(own, other.columns).any(axis=1)
            if other is not term and touched.sum() > 1:
                return None
        return own

    def solve(
        self, solver: str = "lm", *, max_iterations: int = 100, tolerance: float = 1e-9
    ) -> ProgramSolution:
        """Minimise from the start, with the losses as they are set.

        Args:
            solver: `lm`, or `snopt` and `ipopt` as a cross-check of the same program.
            tolerance: Smallest predicted relative decrease of the cost worth a step.

        Returns:
            The solution, converged or not.

        Raises:
            ValueError: If the solver is unknown, or the start is not finite.
            ImpossibleModelError: If the start itself cannot be.
        """
        refuse_unknown("solver", solver, SOLVERS)
        if solver == "lm":
            return self._minimised(max_iterations, tolerance)
        from nico_selfmodel.optimization.drake_program import solved_by_drake

        x, success = solved_by_drake(self.prog, solver)
        cost = self.normal_equations(x)[0]
        # SNOPT reports success on a NaN cost.
        return ProgramSolution(x, cost, success and bool(np.isfinite(cost)), 0, (cost,))

    def _minimised(self, max_iterations: int, tolerance: float) -> ProgramSolution:
        """Minimise by Levenberg and Marquardt over the variables that are not fixed."""
        x, free = self.start, np.flatnonzero(self.free)
        if not np.isfinite(x).all():
            raise ValueError("the initial guess must be finite; set a start for every variable")
        x[list(self._fixed)] = list(self._fixed.values())
        within = np.ix_(free, free)

        def evaluate(y: NDArray) -> NormalEquations:
            x[free] = y
            cost, gradient, hessian = self.normal_equations(x)
            return cost, gradient[free], hessian[within]

        last = levenberg_marquardt(
            evaluate,
            x[free],
            step=_eliminating(self.own_variables, free),
            max_iterations=max_iterations,
            tolerance=tolerance,
        )
        x[free] = last.x
        return ProgramSolution(x, last.cost, last.converged, last.iterations, last.history)


def _eliminating(own: NDArray | None, free: NDArray) -> Step | None:
    """Return the step that eliminates blocks of variables, where all of them are free."""
    if own is None or not np.isin(own, free).all():
        return None
    places = np.searchsorted(free, own)

    def step(hessian: NDArray, gradient: NDArray, damping: NDArray) -> NDArray | None:
        return eliminated_step(hessian, gradient, damping, places)

    return step


def _weigh(term: _Term, r: NDArray) -> tuple[NDArray, NDArray]:
    """Return rho and weight of each observation, with the given weights multiplied in."""
    rho, weight = term.loss.rho_and_weight(np.sum(r * r, axis=0), len(r))
    if term.weights is None:
        return rho, weight
    return rho * term.weights, weight * term.weights
