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

from nico_selfmodel.least_squares import LevenbergMarquardtResult
from nico_selfmodel.optimization.free_variables import LeastSquaresProgram, minimised


class SolvedProgram(LeastSquaresProgram, Protocol):
    """A program of residual blocks that can be had as a MathematicalProgram."""

    @property
    def prog(self) -> MathematicalProgram:
        """The very same problem, as Drake sees it."""
        ...


class LevenbergMarquardtSolver(SolverInterface):
    """Solves the program of one `CalibrationProgram`.

    Variables fixed by equal bounds are left out of the iteration.
    """

    def __init__(self, program: SolvedProgram) -> None:
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
        lower, upper = _bounds_of(prog)
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
        reason = self.ExplainUnsatisfiedProgramAttributes(prog)
        if reason:
            raise ValueError(reason)
        x, self.last = minimised(self._program, np.array(guess, dtype=float), **options)
        found = self.last.converged
        status = SolutionResult.kSolutionFound if found else SolutionResult.kIterationLimit
        return _drake_result(prog, x, self.last, status)


def _bounds_of(prog: MathematicalProgram) -> tuple[NDArray, NDArray]:
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
