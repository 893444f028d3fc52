"""A program of residual blocks as a MathematicalProgram, and the solvers of Drake's own."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import IpoptSolver, MathematicalProgram, SnoptSolver, SolverOptions

from nico_selfmodel.errors import ImpossibleModelError

if TYPE_CHECKING:
    from nico_selfmodel.optimization.calibration_program import CalibrationProgram


def drake_program(program: "CalibrationProgram") -> MathematicalProgram:
    """Return the program with one cost over all variables, with its start and what is fixed."""
    prog = MathematicalProgram()
    variables = [prog.NewContinuousVariables(1, name)[0] for name in program.names]
    prog.SetInitialGuessForAllVariables(program.start)
    for index, held in program.fixed.items():
        prog.AddBoundingBoxConstraint(held, held, variables[index])

    def tried(x: NDArray) -> tuple[float, NDArray]:
        try:
            return program.normal_equations(x)[:2]
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
