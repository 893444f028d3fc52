"""Levenberg-Marquardt as a Drake solver."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import (
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
    """Solves the program of one `CalibrationProgram`.

    Variables fixed by equal bounds are left out of the iteration.
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
        lower, upper = bounds_of(prog)
        known = len(prog.bounding_box_constraints())
        if len(prog.GetAllCosts()) > 1 or len(prog.GetAllConstraints()) > known:
            return "LevenbergMarquardtSolver knows one cost and fixed variables only"
        if np.any((lower != upper) & (np.isfinite(lower) | np.isfinite(upper))):
            return "LevenbergMarquardtSolver fixes variables, and knows no other bounds"
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
        guess = prog.initial_guess() if initial_guess is None else initial_guess
        options = _options(self.solver_id(), prog.solver_options(), solver_options)
        x, outcome = self.minimise(prog, np.array(guess, dtype=float), **options)
        found = outcome.converged
        status = SolutionResult.kSolutionFound if found else SolutionResult.kIterationLimit
        return _drake_result(prog, x, outcome, status)

    def minimise(
        self, prog: MathematicalProgram, guess: NDArray, **options: Any
    ) -> tuple[NDArray, LevenbergMarquardtResult]:
        """Minimise as `Solve` does, without a Drake result, which takes half a millisecond.

        Args:
            prog: The program of the `CalibrationProgram` given at construction.
            guess: Start. Shape (p,).
            options: `max_iterations`, `tolerance`.

        Returns:
            The solution, shape (p,), and how it was found.

        Raises:
            ValueError: If `prog` is another program or the guess is not finite.
        """
        reason = self.ExplainUnsatisfiedProgramAttributes(prog)
        if reason:
            raise ValueError(reason)
        if not np.isfinite(guess).all():
            raise ValueError("the initial guess must be finite; set a start for every variable")
        lower, upper = bounds_of(prog)
        free = np.flatnonzero(lower < upper)
        x = np.where(lower < upper, guess, lower)

        def evaluate(y: NDArray) -> NormalEquations:
            x[free] = y
            cost, gradient, hessian = self._program.normal_equations(x)
            return cost, gradient[free], hessian[np.ix_(free, free)]

        step = _eliminating(self._program.own_variables, free)
        self.last = levenberg_marquardt(evaluate, x[free], step=step, **options)
        x[free] = self.last.x
        return x, self.last


def _eliminating(own: NDArray | None, free: NDArray) -> Step | None:
    """Return the step that eliminates blocks of variables, where all of them are free."""
    if own is None or not np.isin(own, free).all():
        return None
    places = np.searchsorted(free, own)

    def step(hessian: NDArray, gradient: NDArray, damping: NDArray) -> NDArray | None:
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
