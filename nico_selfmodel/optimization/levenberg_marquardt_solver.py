"""Levenberg-Marquardt as a Drake solver."""

from dataclasses import dataclass
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

from nico_selfmodel.least_squares import (
    LevenbergMarquardtResult,
    NormalEquations,
    Step,
    levenberg_marquardt,
)
from nico_selfmodel.optimization.separable_block import eliminated_step


class LeastSquaresProgram(Protocol):
    """A MathematicalProgram whose cost is a sum of squares with known normal equations."""

    prog: MathematicalProgram

    @property
    def own_variables(self) -> NDArray | None:
        """Indices (V, m) of variables that a step may eliminate in blocks; None if none."""
        ...

    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient and Gauss-Newton matrix at x."""
        ...


class LevenbergMarquardtSolver(SolverInterface):
    """Solves the program of one `CalibrationProgram`; bounds and linear constraints are honoured.

    Variables fixed by equal bounds are left out of the iteration. Where inequality bounds or
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
        """Return whether `prog` is the program whose normal equations are known, and no more."""
        return not self.ExplainUnsatisfiedProgramAttributes(prog)

    def ExplainUnsatisfiedProgramAttributes(self, prog: MathematicalProgram) -> str:
        """Say why a program cannot be solved; empty if it can."""
        if prog is not self._program.prog:
            return "LevenbergMarquardtSolver solves only the program of its CalibrationProgram"
        linear = [*prog.linear_constraints(), *prog.linear_equality_constraints()]
        known = len(prog.bounding_box_constraints()) + len(linear)
        if len(prog.GetAllCosts()) > 1 or len(prog.GetAllConstraints()) > known:
            return "LevenbergMarquardtSolver knows one cost, bounds and linear constraints only"
        return ""

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
        x = np.clip(x, lower, np.maximum(lower, upper))
        free = np.flatnonzero(lower < upper)
        constraints = _Constraints.of(prog, lower, upper, free)
        start = x[free] if constraints is None else constraints.nearest(x[free])

        def evaluate(y: NDArray) -> NormalEquations:
            x[free] = y
            cost, gradient, hessian = self._program.normal_equations(x)
            return cost, gradient[free], hessian[np.ix_(free, free)]

        if start is None or np.any(lower > upper):
            cost, _, hessian = evaluate(x[free])
            self.last = LevenbergMarquardtResult(x[free], cost, hessian, 0, False, (cost,))
            return _drake_result(prog, x, self.last, SolutionResult.kInfeasibleConstraints)
        step = _eliminating(self._program.own_variables, free)
        if constraints is not None:
            step = constraints.step
        self.last = levenberg_marquardt(evaluate, start, step=step, **options)
        x[free] = self.last.x
        solved = self.last.converged
        status = SolutionResult.kSolutionFound if solved else SolutionResult.kIterationLimit
        return _drake_result(prog, x, self.last, status)


def _eliminating(own: NDArray | None, free: NDArray) -> Step | None:
    """Return the step that eliminates blocks of variables, where all of them are free."""
    if own is None or not np.isin(own, free).all():
        return None
    places = np.searchsorted(free, own)

    def step(hessian: NDArray, gradient: NDArray, damping: NDArray, _: NDArray) -> NDArray | None:
        return eliminated_step(hessian, gradient, damping, places)

    return step


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


@dataclass(frozen=True, eq=False)
class _Constraints:
    """Bounds and linear constraints on the free variables, lower <= A y <= upper."""

    matrix: NDArray
    lower: NDArray
    upper: NDArray

    @classmethod
    def of(
        cls, prog: MathematicalProgram, lower: NDArray, upper: NDArray, free: NDArray
    ) -> "_Constraints | None":
        """Gather what constrains the free variables; None where nothing does."""
        rows, lows, highs = [np.eye(len(free))], [lower[free]], [upper[free]]
        held = np.setdiff1d(np.arange(prog.num_vars()), free)
        for binding in [*prog.linear_constraints(), *prog.linear_equality_constraints()]:
            matrix = np.zeros((binding.evaluator().num_constraints(), prog.num_vars()))
            columns = prog.FindDecisionVariableIndices(binding.variables())
            matrix[:, columns] = binding.evaluator().GetDenseA()
            fixed = matrix[:, held] @ lower[held]
            rows.append(matrix[:, free])
            lows.append(binding.evaluator().lower_bound() - fixed)
            highs.append(binding.evaluator().upper_bound() - fixed)
        low, high = np.concatenate(lows), np.concatenate(highs)
        bounded = np.isfinite(low) | np.isfinite(high)
        if not bounded.any():
            return None
        return cls(np.vstack(rows)[bounded], low[bounded], high[bounded])

    def nearest(self, y: NDArray) -> NDArray | None:
        """Return the allowed point nearest to y; None where the constraints contradict."""
        move = self._solve(np.eye(len(y)), np.zeros(len(y)), y)
        return None if move is None else y + move

    def step(
        self, hessian: NDArray, gradient: NDArray, damping: NDArray, y: NDArray
    ) -> NDArray | None:
        """Return the damped Gauss-Newton step that stays allowed; None if there is none."""
        return self._solve(hessian + np.diag(damping), gradient, y)

    def _solve(self, hessian: NDArray, gradient: NDArray, y: NDArray) -> NDArray | None:
        diagonal = np.diag(hessian)
        size = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        qp = MathematicalProgram()
        s = qp.NewContinuousVariables(len(y))
        qp.AddQuadraticCost(hessian / np.outer(size, size), gradient / size, s, is_convex=True)
        at = self.matrix @ y
        qp.AddLinearConstraint(self.matrix / size, self.lower - at, self.upper - at, s)
        solution = ClarabelSolver().Solve(qp)
        return solution.GetSolution(s) / size if solution.is_success() else None


def _drake_result(
    prog: MathematicalProgram,
    x: NDArray,
    outcome: LevenbergMarquardtResult,
    status: SolutionResult,
) -> MathematicalProgramResult:
    """Return a Drake result that holds x: `set_x_val` on a fresh one would abort the process."""
    twin = MathematicalProgram()
    variables = prog.decision_variables()
    twin.AddDecisionVariables(variables)
    twin.AddBoundingBoxConstraint(x, x, variables)
    twin.AddLinearCost(np.zeros(len(x)), outcome.cost, variables)
    result = ClpSolver().Solve(twin)
    result.set_x_val(x)
    result.set_solution_result(status)
    return result
