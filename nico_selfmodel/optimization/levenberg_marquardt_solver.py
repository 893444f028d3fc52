"""Levenberg-Marquardt as a Drake solver."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import (
    ClarabelSolver,
    ClpSolver,
    MathematicalProgram,
    MathematicalProgramResult,
    SolutionResult,
    SolverId,
    SolverInterface,
    SolverOptions,
)

from nico_selfmodel.geometry.levenberg_marquardt import (
    LevenbergMarquardtResult,
    NormalEquations,
    levenberg_marquardt,
)


class LeastSquaresProgram(Protocol):
    """A MathematicalProgram whose cost is a sum of squares with known normal equations."""

    prog: MathematicalProgram

    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient and Gauss-Newton matrix at x."""
        ...


class LevenbergMarquardtSolver(SolverInterface):
    """Solves the program of one `CalibrationProgram`; bounds and linear constraints are honoured.

    Variables pinned by equal bounds are left out of the iteration. Where inequality bounds or
    linear constraints are present, each step is a convex quadratic program.
    """

    def __init__(self, program: LeastSquaresProgram) -> None:
        """Remember where the normal equations come from; a binding cannot give them back."""
        SolverInterface.__init__(self)
        self._program = program
        self.last: LevenbergMarquardtResult | None = None

    def available(self) -> bool:
        """Return True: it is plain numpy."""
        return True

    def enabled(self) -> bool:
        """Return True: it needs no licence."""
        return True

    def solver_id(self) -> SolverId:
        """Return the name under which results report this solver (Drake wants it short)."""
        return SolverId("NicoLM")

    def AreProgramAttributesSatisfied(self, prog: MathematicalProgram) -> bool:
        """Return whether `prog` is the program whose normal equations are known."""
        return prog is self._program.prog

    def ExplainUnsatisfiedProgramAttributes(self, prog: MathematicalProgram) -> str:
        """Say why a program cannot be solved; empty if it can."""
        if self.AreProgramAttributesSatisfied(prog):
            return ""
        return "LevenbergMarquardtSolver solves only the program of its CalibrationProgram"

    def Solve(  # noqa: D417
        self,
        prog: MathematicalProgram,
        initial_guess: NDArray | None = None,
        solver_options: SolverOptions | None = None,
        result: Any = None,
    ) -> MathematicalProgramResult:
        """Minimise the program's cost.

        Options, under the solver's id: `max_iterations`, `tolerance`.

        Args:
            prog: The program of the `CalibrationProgram` given at construction.
            initial_guess: Start; the program's own initial guess if omitted. Shape (p,).

        Returns:
            A Drake result; `last` holds iterations and cost history.

        Raises:
            ValueError: If `prog` is another program or the guess is not finite.
        """
        reason = self.ExplainUnsatisfiedProgramAttributes(prog)
        if reason:
            raise ValueError(reason)
        guess = prog.initial_guess() if initial_guess is None else initial_guess
        x = np.array(guess, dtype=float)
        if not np.isfinite(x).all():
            raise ValueError("the initial guess must be finite; set a start for every variable")
        options = _options(self.solver_id(), prog.solver_options(), solver_options)
        lower, upper = bounds_of(prog)
        x = np.clip(x, lower, upper)
        free = np.flatnonzero(lower < upper)
        step = _constrained_step(prog, lower, upper, free)

        def evaluate(y: NDArray) -> NormalEquations:
            x[free] = y
            cost, gradient, hessian = self._program.normal_equations(x)
            return cost, gradient[free], hessian[np.ix_(free, free)]

        self.last = levenberg_marquardt(evaluate, x[free], step=step, **options)
        x[free] = self.last.x
        return _drake_result(prog, x, self.last)


def bounds_of(prog: MathematicalProgram) -> tuple[NDArray, NDArray]:
    """Return the tightest bounds of every decision variable. Two arrays of shape (p,)."""
    lower, upper = np.full(prog.num_vars(), -np.inf), np.full(prog.num_vars(), np.inf)
    for binding in prog.bounding_box_constraints():
        index = prog.FindDecisionVariableIndices(binding.variables())
        np.maximum.at(lower, index, binding.evaluator().lower_bound())
        np.minimum.at(upper, index, binding.evaluator().upper_bound())
    return lower, upper


def _options(solver_id: SolverId, *sources: SolverOptions | None) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for source in sources:
        if source is not None:
            found.update(source.options.get(solver_id.name(), {}))
    return {name: found[name] for name in ("max_iterations", "tolerance") if name in found}


def _constrained_step(
    prog: MathematicalProgram, lower: NDArray, upper: NDArray, free: NDArray
) -> Callable[[NDArray, NDArray, NDArray, NDArray], NDArray | None] | None:
    """Return a step that solves a quadratic program, or None where nothing constrains."""
    rows, lows, highs = [], [], []
    pinned = np.setdiff1d(np.arange(prog.num_vars()), free)
    for binding in [*prog.linear_constraints(), *prog.linear_equality_constraints()]:
        matrix = np.zeros((binding.evaluator().num_constraints(), prog.num_vars()))
        matrix[:, prog.FindDecisionVariableIndices(binding.variables())] = (
            binding.evaluator().GetDenseA()
        )
        fixed = matrix[:, pinned] @ lower[pinned]
        rows.append(matrix[:, free])
        lows.append(binding.evaluator().lower_bound() - fixed)
        highs.append(binding.evaluator().upper_bound() - fixed)
    low, high = lower[free], upper[free]
    if not rows and not (np.isfinite(low).any() or np.isfinite(high).any()):
        return None
    stacked = np.vstack([np.eye(len(free)), *rows])
    all_low, all_high = np.concatenate([low, *lows]), np.concatenate([high, *highs])
    bounded = np.isfinite(all_low) | np.isfinite(all_high)
    stacked, all_low, all_high = stacked[bounded], all_low[bounded], all_high[bounded]
    solver = ClarabelSolver()

    def step(hessian: NDArray, gradient: NDArray, damping: NDArray, y: NDArray) -> NDArray | None:
        size = np.sqrt(np.maximum(np.diag(hessian) + damping, 1e-300))
        qp = MathematicalProgram()
        s = qp.NewContinuousVariables(len(y))
        damped = (hessian + np.diag(damping)) / np.outer(size, size)
        qp.AddQuadraticCost(damped, gradient / size, s, is_convex=True)
        at = stacked @ y
        qp.AddLinearConstraint(stacked / size, all_low - at, all_high - at, s)
        solution = solver.Solve(qp)
        if not solution.is_success():
            return None
        return np.clip(solution.GetSolution(s) / size, low - y, high - y)

    return step


def _drake_result(
    prog: MathematicalProgram, x: NDArray, outcome: LevenbergMarquardtResult
) -> MathematicalProgramResult:
    """Return a Drake result that holds x: `set_x_val` on a fresh one would abort the process."""
    twin = MathematicalProgram()
    variables = prog.decision_variables()
    twin.AddDecisionVariables(variables)
    twin.AddBoundingBoxConstraint(x, x, variables)
    twin.AddLinearCost(np.zeros(len(x)), outcome.cost, variables)
    result = ClpSolver().Solve(twin)
    result.set_x_val(x)
    status = SolutionResult.kSolutionFound if outcome.converged else SolutionResult.kIterationLimit
    result.set_solution_result(status)
    return result
