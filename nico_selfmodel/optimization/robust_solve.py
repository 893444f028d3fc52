"""Robust solution of a program: scale from the median, reweighting, outliers left out last."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.optimization.calibration_program import CalibrationProgram, ProgramSolution
from nico_selfmodel.optimization.losses import LOSSES, Loss, robust_scale

ROBUST_METHODS = ("trimmed", *LOSSES)
"""`trimmed`: Cauchy, then least squares without what lies beyond `OUTLIER_AT` scales."""

OUTLIER_AT = 5.5
"""An observation of three coordinates further out than this many scales is called an outlier; one
in 10^6 Gaussian ones is. Other counts are scaled by sqrt(k / 3)."""


@dataclass(frozen=True, eq=False)
class RobustSolution:
    """A solution with the observations that it does not believe."""

    solution: ProgramSolution
    outliers: NDArray
    """Boolean mask of the observations of the block. Shape (N,)."""
    scale: float
    """Standard deviation of a good coordinate, in whitened units."""
    iterations: int
    """Of all rounds together."""


def solve_robustly(
    program: CalibrationProgram, block: int, method: str = "trimmed", *, solver: str = "lm"
) -> RobustSolution:
    """Minimise with a robust loss on one block, its scale re-estimated between solutions.

    Args:
        program: The program; its start moves to the solution.
        block: Number of the residual block to protect.
        method: One of `ROBUST_METHODS`.
        solver: As in `CalibrationProgram.solve`.

    Returns:
        The solution. With `none` nothing is called an outlier.

    Raises:
        ValueError: If the method or the solver is unknown.
    """
    if method not in ROBUST_METHODS:
        raise ValueError(f"no loss {method!r}; there are {', '.join(ROBUST_METHODS)}")
    if method == "none":
        program.set_loss(block, Loss())
        solution = _solve_from(program, solver)
        residuals = program.residuals(block, solution.x)
        scale = float(np.sqrt(np.mean(residuals**2)))
        nothing = np.zeros(residuals.shape[1], dtype=bool)
        return RobustSolution(solution, nothing, scale, solution.iterations)
    kind = "cauchy" if method == "trimmed" else method
    solution, scale, iterations = _reweight(program, block, kind, solver)
    outliers = _beyond(program, block, solution.x, scale)
    if method == "trimmed":
        return _trim(program, block, solution, outliers, scale, iterations, solver)
    return RobustSolution(solution, outliers, scale, iterations)


def _reweight(
    program: CalibrationProgram, block: int, kind: str, solver: str
) -> tuple[ProgramSolution, float, int]:
    """Alternate between the scale and the solution until the scale settles."""
    coordinates = len(program.residuals(block, program.start))
    scale = robust_scale(_norms(program, block, program.start), coordinates)
    program.set_loss(block, Loss(kind, scale))
    solution = _solve_from(program, solver)
    iterations = solution.iterations
    for _ in range(7):
        before, scale = scale, robust_scale(_norms(program, block, solution.x), coordinates)
        if abs(scale - before) < 0.01 * before:
            break
        program.set_loss(block, Loss(kind, scale))
        solution = _solve_from(program, solver)
        iterations += solution.iterations
    return solution, scale, iterations


def _trim(
    program: CalibrationProgram,
    block: int,
    solution: ProgramSolution,
    outliers: NDArray,
    scale: float,
    iterations: int,
    solver: str,
) -> RobustSolution:
    """Least squares without the outliers, until the set of them settles."""
    for _ in range(6):
        keep = (~outliers).astype(float)
        program.set_loss(block, Loss(), keep if outliers.any() else None)
        solution = _solve_from(program, solver)
        iterations += solution.iterations
        norms = _norms(program, block, solution.x)
        scale = robust_scale(norms, len(program.residuals(block, solution.x)))
        found = _beyond(program, block, solution.x, scale)
        if np.array_equal(found, outliers):
            break
        outliers = found
    return RobustSolution(solution, outliers, scale, iterations)


def _solve_from(program: CalibrationProgram, solver: str) -> ProgramSolution:
    solution = program.solve(solver)
    program.prog.SetInitialGuessForAllVariables(solution.x)
    return solution


def _norms(program: CalibrationProgram, block: int, x: NDArray) -> NDArray:
    return np.linalg.norm(program.residuals(block, x), axis=0)


def _beyond(program: CalibrationProgram, block: int, x: NDArray, scale: float) -> NDArray:
    residuals = program.residuals(block, x)
    # Residuals at rounding level are no outliers of each other.
    floor = 1e-6
    limit = OUTLIER_AT * np.sqrt(len(residuals) / 3.0) * max(scale, floor)
    return np.linalg.norm(residuals, axis=0) > limit
