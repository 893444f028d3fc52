"""The minimum of a program whose fixed variables are left out of the iteration."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.least_squares import (
    LevenbergMarquardtResult,
    NormalEquations,
    Step,
    levenberg_marquardt,
)
from nico_selfmodel.optimization.separable_block import eliminated_step


class LeastSquaresProgram(Protocol):
    """A program whose cost is a sum of squares with known normal equations."""

    @property
    def fixed(self) -> Mapping[int, float]:
        """Index and value of the variables that are fixed."""
        ...

    @property
    def own_variables(self) -> NDArray | None:
        """Indices (V, m) of variables that a step may eliminate in blocks; None if none."""
        ...

    def normal_equations(self, x: NDArray) -> NormalEquations:
        """Return cost, gradient and Gauss-Newton matrix at x."""
        ...


def minimised(
    program: LeastSquaresProgram, guess: NDArray, **options: Any
) -> tuple[NDArray, LevenbergMarquardtResult]:
    """Minimise a program's cost over the variables that are not fixed.

    Args:
        program: The program.
        guess: Start. Shape (p,).
        options: `max_iterations`, `tolerance`.

    Returns:
        The solution, shape (p,), and how it was found.

    Raises:
        ValueError: If the guess is not finite.
        ImpossibleModelError: If the start itself cannot be.
    """
    if not np.isfinite(guess).all():
        raise ValueError("the initial guess must be finite; set a start for every variable")
    x = np.array(guess, dtype=float)
    x[list(program.fixed)] = list(program.fixed.values())
    free = np.delete(np.arange(len(x)), list(program.fixed))
    within = np.ix_(free, free)

    def evaluate(y: NDArray) -> NormalEquations:
        x[free] = y
        cost, gradient, hessian = program.normal_equations(x)
        return cost, gradient[free], hessian[within]

    step = _eliminating(program.own_variables, free)
    last = levenberg_marquardt(evaluate, x[free], step=step, **options)
    x[free] = last.x
    return x, last


def _eliminating(own: NDArray | None, free: NDArray) -> Step | None:
    """Return the step that eliminates blocks of variables, where all of them are free."""
    if own is None or not np.isin(own, free).all():
        return None
    places = np.searchsorted(free, own)

    def step(hessian: NDArray, gradient: NDArray, damping: NDArray) -> NDArray | None:
        return eliminated_step(hessian, gradient, damping, places)

    return step
