"""The minimum of a program that Drake's own solvers take: smooth costs, bounds, constraints."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import SnoptSolver, Solve, SolverOptions


def minimum_near(program: Any, start: NDArray, of: Any, most: int | None = None) -> NDArray:
    """Return where a program's variables end, whether or not the solver is content.

    Args:
        program: A `MathematicalProgram`, for instance of Drake's `InverseKinematics`.
        start: Values of all its variables to start from.
        of: The variables that are asked for. Shape (k,).
        most: Steps after which SNOPT, which Drake takes for such programs, gives up; its own 1000
            if omitted.

    Returns:
        Shape (k,). A solver that gives up leaves its last values, and one to which a cost or a
        constraint cannot be told somewhere on its way, as the distance of shapes one inside the
        other, those that it began with: whoever asks must look whether they are good.
    """
    options = SolverOptions()
    if most is not None:
        options.SetOption(SnoptSolver.id(), "Major iterations limit", most)
    try:
        return np.asarray(Solve(program, start, options).GetSolution(of), dtype=float)
    except RuntimeError:
        return np.array(start, dtype=float)[program.FindDecisionVariableIndices(of)]
