"""Robust solution of a program: scale from the median, reweighting, outliers left out last."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.optimization.calibration_program import CalibrationProgram, ProgramSolution
from nico_selfmodel.optimization.losses import LOSSES, Loss, robust_scale

ROBUST_METHODS = ("trimmed", *LOSSES)
"""`trimmed`: Cauchy, then least squares without what lies beyond `OUTLIER_AT` scales."""

OUTLIER_AT = 5.5
"""An observation of three coordinates further out than this many scales is called an outlier; one
in 10^6 Gaussian ones is. Other counts are scaled by sqrt(k / 3)."""


@dataclass(frozen=True, eq=False)
class RobustSolution:
    """A solution with its outliers."""

    solution: ProgramSolution
    outliers: NDArray
    """Boolean mask of the observations of the block. Shape (N,)."""
    scale: float
    """Standard deviation of a good coordinate, in whitened units."""
    iterations: int
    """Of all rounds together."""


_ROUGH = 1e-5
"""Tolerance of solutions that another one follows."""


def solve_robustly(
    program: CalibrationProgram,
    block: int,
    method: str = "trimmed",
    *,
    rough: bool = False,
    outlier_at: float = OUTLIER_AT,
) -> RobustSolution:
    """Minimise with a robust loss on one block, its scale re-estimated between solutions.

    Args:
        program: The program; its start moves to the solution.
        block: Number of the residual block to protect.
        method: One of `ROBUST_METHODS`.
        rough: Stop early: good enough to tell one minimum from another.
        outlier_at: Scales, for three coordinates, beyond which an observation is an outlier.

    Returns:
        The solution. With `none` nothing is called an outlier.

    Raises:
        ValueError: If the method is unknown.
    """
    refuse_unknown("loss", method, ROBUST_METHODS)
    attempt = _Attempt(program, block, outlier_at)
    if method == "none":
        program.set_loss(block, Loss())
        solution = attempt.solve(rough)
        residuals = program.residuals(block, solution.x)
        nothing = np.zeros(residuals.shape[1], dtype=bool)
        scale = float(np.sqrt(np.mean(residuals**2)))
        return RobustSolution(solution, nothing, scale, solution.iterations)
    solution, scale = attempt.reweight("cauchy" if method == "trimmed" else method)
    if method == "trimmed":
        return attempt.trim(attempt.beyond(solution.x, scale))
    if not rough:
        solution = attempt.solve(rough)
    return RobustSolution(solution, attempt.beyond(solution.x, scale), scale, attempt.iterations)


def solve_without(program: CalibrationProgram, block: int, outliers: NDArray) -> RobustSolution:
    """Least squares over all observations of a block but known outliers.

    Args:
        program: The program; its start moves to the solution.
        block: Number of the residual block.
        outliers: Boolean, shape (N,).
    """
    attempt = _Attempt(program, block, OUTLIER_AT)
    solution = attempt.least_squares(outliers)
    residuals = program.residuals(block, solution.x)[:, ~outliers]
    scale = float(np.sqrt(np.mean(residuals**2)))
    return RobustSolution(solution, outliers, scale, attempt.iterations)


class _Attempt:
    """A robust solution under way: one block of one program, and the iterations so far."""

    def __init__(self, program: CalibrationProgram, block: int, outlier_at: float) -> None:
        self.program, self.block, self.outlier_at = program, block, outlier_at
        self.iterations = 0

    @cached_property
    def coordinates(self) -> int:
        """How many coordinates an observation has."""
        return len(self.program.residuals(self.block, self.program.start))

    def solve(self, rough: bool) -> ProgramSolution:
        """Solve from where the last solution ended."""
        options = {"tolerance": _ROUGH, "max_iterations": 30} if rough else {}
        solution = self.program.solve(**options)
        self.program.move_start(solution.x)
        self.iterations += solution.iterations
        return solution

    def reweight(self, kind: str) -> tuple[ProgramSolution, float]:
        """Alternate between the scale and the solution until the scale settles."""
        scale = self.scale_at(self.program.start)
        self.program.set_loss(self.block, Loss(kind, scale))
        solution = self.solve(rough=True)
        for _ in range(9):
            before, scale = scale, self.scale_at(solution.x)
            if abs(scale - before) < 0.01 * before:
                break
            self.program.set_loss(self.block, Loss(kind, scale))
            solution = self.solve(rough=True)
        return solution, scale

    def trim(self, outliers: NDArray) -> RobustSolution:
        """Least squares without the outliers, until the set of them settles."""
        solution, scale, found = self.without(outliers)
        for _ in range(5):
            if np.array_equal(found, outliers):
                break
            outliers = found
            solution, scale, found = self.without(outliers)
        return RobustSolution(solution, outliers, scale, self.iterations)

    def without(self, outliers: NDArray) -> tuple[ProgramSolution, float, NDArray]:
        """Return the least squares solution without outliers, its scale, and who they are then."""
        solution = self.least_squares(outliers)
        scale = self.scale_at(solution.x, ~outliers)
        spreads = self.program.prediction_covariances(self.block, solution.x)
        if spreads is None:
            return solution, scale, self.beyond(solution.x, scale)
        taken = np.trace(spreads[~outliers], axis1=1, axis2=2).mean() / self.coordinates
        scale /= np.sqrt(1.0 - min(float(taken), 0.9))
        residuals = self.program.residuals(self.block, solution.x).T
        norms = np.linalg.norm(residuals, axis=1)
        norms[outliers] = _whitened_norms(residuals[outliers], spreads[outliers])
        return solution, scale, norms > self.limit(scale)

    def least_squares(self, outliers: NDArray) -> ProgramSolution:
        """Return the least squares solution without outliers."""
        keep = (~outliers).astype(float) if outliers.any() else None
        self.program.set_loss(self.block, Loss(), keep)
        return self.solve(rough=False)

    def scale_at(self, x: NDArray, inliers: NDArray | None = None) -> float:
        """Return the robust scale of a coordinate at x, of the inliers alone."""
        norms = np.linalg.norm(self.program.residuals(self.block, x), axis=0)
        return robust_scale(norms if inliers is None else norms[inliers], self.coordinates)

    def beyond(self, x: NDArray, scale: float) -> NDArray:
        """Return which observations are outliers at x; residuals at rounding level are none."""
        norms = np.linalg.norm(self.program.residuals(self.block, x), axis=0)
        return norms > self.limit(scale)

    def limit(self, scale: float) -> float:
        """Return the norm from which on an observation is an outlier."""
        return self.outlier_at * np.sqrt(self.coordinates / 3.0) * max(scale, 1e-6)


def _whitened_norms(residuals: NDArray, spreads: NDArray) -> NDArray:
    """Return sqrt(r' (I + S)^-1 r) of observations that had no part in the solution. Shape (N,).

    With S = J H^-1 J', shape (N, k, k): where a left out pose is the only one of its kind, the
    others say little of it (externally studentised residuals; Cook, Weisberg 1982).
    """
    values, vectors = np.linalg.eigh(0.5 * (spreads + np.swapaxes(spreads, 1, 2)))
    along = np.einsum("nij,ni->nj", vectors, residuals)
    # Rounding makes the spreads of a direction that nothing tells negative.
    return np.sqrt(np.sum(along**2 / (1.0 + np.maximum(values, 0.0)), axis=1))
