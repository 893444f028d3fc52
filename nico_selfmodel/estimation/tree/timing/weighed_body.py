"""A body at its solution, as score tests hold effects against it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution


@dataclass(frozen=True, eq=False)
class WeighedBody:
    """See `diagnosis.score_test.Weighed`: each number a row, in its sensor's standard deviation."""

    problem: TreeProblem
    solution: TreeSolution
    residuals: NDArray
    by_angle: NDArray
    slopes: NDArray
    """By what is free. Shape (R, 1, k)."""
    rows: NDArray
    fitted: NDArray
    """The same whitened, priors last. Shape (T, k)."""
    whitened_residuals: NDArray

    @classmethod
    def of(cls, problem: TreeProblem, solution: TreeSolution) -> "WeighedBody":
        """Weigh a solution's rows by the noise of a problem, whose free parameters were fitted."""
        linear, scale = problem.residuals.linear(solution.values), problem.scale[:, None]
        rows = np.flatnonzero(~solution.outliers[problem.observations.row])
        U, white = problem.whitened_at(solution)
        priors = slice(len(white), None)
        return cls(
            problem,
            solution,
            -linear.r[:, None] / scale,
            (linear.by_joint / scale)[:, None],
            (linear.J[problem.columns].T / scale)[:, None],
            rows,
            np.vstack([U, solution.whitened[priors]]),
            -np.append(white, solution.rest[priors]),
        )

    def whitened(self, columns: NDArray) -> NDArray:
        """Whiten columns of the rows that count; they move no prior. (R, 1, m) -> (T, m)."""
        beside = columns[:, 0] * self.problem.scale[:, None]
        free = len(self.problem.columns)
        white = self.problem.whitened_at(self.solution, beside)[0][:, free:]
        return np.pad(white, ((0, len(self.solution.rest) - len(white)), (0, 0)))
