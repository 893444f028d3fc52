"""The minimum of a program that Drake's own solvers take: smooth costs, bounds, constraints."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.solvers import Solve


def minimum_near(program: Any, start: NDArray, of: Any) -> NDArray:
    """Return where a program's variables end, whether or not the solver is content.

    Args:
        program: A `MathematicalProgram`, for instance of Drake's `InverseKinematics`.
        start: Values of all its variables to start from.
        of: The variables that are asked for. Shape (k,).

    Returns:
        Shape (k,). A solver that gives up leaves its last values: whoever asks must look whether
        they are good.
    """
    return np.asarray(Solve(program, start).GetSolution(of), dtype=float)
