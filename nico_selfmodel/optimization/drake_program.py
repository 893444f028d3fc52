"""A program of residual blocks as a MathematicalProgram, and the solvers of Drake's own."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver, SolverOptions

from nico_selfmodel.errors import ImpossibleModelError
from nico_selfmodel.least_squares import NormalEquations


def drake_program(
    names: Sequence[str],
    start: NDArray,
    fixed: Mapping[int, float],
    evaluate: Callable[[NDArray], NormalEquations],
) -> MathematicalProgram:
    """Return a program with one cost over all its variables.

    Args:
        start: Their initial values. Shape (p,).
        fixed: Index of a variable -> the value it is held at.
        evaluate: Returns cost and gradient, and what else there is, at given values.
    """
    prog = MathematicalProgram()
    variables = [prog.NewContinuousVariables(1, name)[0] for name in names]
    prog.SetInitialGuessForAllVariables(start)
    for index, held in fixed.items():
        prog.AddBoundingBoxConstraint(held, held, variables[index])

    def tried(x: NDArray) -> tuple[float, NDArray]:
        try:
            return evaluate(x)[:2]
        except ImpossibleModelError:
            return np.inf, np.zeros(len(x))

    def cost(values: NDArray) -> Any:
        if values.dtype == object and isinstance(values[0], AutoDiffXd):
            x, slope = ExtractValue(values).ravel(), ExtractGradient(values)
            f, gradient = tried(x)
            chained = gradient[None, :] @ slope if slope.size else np.zeros((1, 0))
            return InitializeAutoDiff(np.array([[f]]), chained)[0, 0]
        return tried(np.asarray(values, dtype=float))[0]

    prog.AddCost(cost, np.array(variables))
    return prog


def solved_by_drake(prog: MathematicalProgram, solver: str) -> tuple[NDArray, bool]:
    """Return where `snopt` or `ipopt` stopped, and whether it calls that a minimum.

    Args:
        prog: The program, with its start.
        solver: `snopt` or `ipopt`.

    Returns:
        The solution, shape (p,), and whether it succeeded.
    """
    drake = SnoptSolver() if solver == "snopt" else IpoptSolver()
    options = SolverOptions()
    # IPOPT's own 1e-10 asks for more than a quasi-Newton Hessian can give.
    options.SetOption(IpoptSolver.id(), "tol", 1e-5)
    options.SetOption(IpoptSolver.id(), "max_iter", 1000)
    result = drake.Solve(prog, prog.initial_guess(), options)
    return np.asarray(result.get_x_val()), result.is_success()
