"""A dense Levenberg-Marquardt iteration on normal equations.

It knows only a function that returns cost, gradient and Gauss-Newton matrix, so that robust
losses, block structure and constrained steps can be supplied by those who need them.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ImpossibleModelError

NormalEquations = tuple[float, NDArray, NDArray]
"""Cost f(x), gradient J'r and Gauss-Newton matrix J'J, with f = |r|^2 / 2."""

Step = Callable[[NDArray, NDArray, NDArray], NDArray | None]
"""Maps Gauss-Newton matrix, gradient and damping to a step; None asks for more damping."""


@dataclass(frozen=True, eq=False)
class LevenbergMarquardtResult:
    """Where the iteration stopped, and why."""

    x: NDArray
    """Best point found. Shape (p,)."""
    cost: float
    """Half the sum of squared residuals at `x`."""
    iterations: int
    """Accepted and refused steps together."""
    converged: bool
    """Whether a tolerance, rather than the iteration limit, ended it."""
    history: tuple[float, ...]
    """Cost at the start and after each accepted step."""


def damped_step(hessian: NDArray, gradient: NDArray, damping: NDArray) -> NDArray | None:
    """Solve (H + diag(damping)) step = -g; None where the matrix is not positive definite."""
    damped = hessian.copy()
    damped.flat[:: len(damped) + 1] += damping
    try:
        np.linalg.cholesky(damped)
    except np.linalg.LinAlgError:
        return None
    return -np.linalg.solve(damped, gradient)


def _step_within(
    step: Step, hessian: NDArray, gradient: NDArray, damping: NDArray, room: NDArray
) -> NDArray | None:
    """Return the step of variables of which none may fall by more than its room.

    What would fall further ends there, and the others make the best of it.
    """
    held = np.zeros(len(room), dtype=bool)
    dx = step(hessian, gradient, damping)
    while dx is not None and (dx < -room)[~held].any():
        held |= dx < -room
        rest = ~held
        left = gradient[rest] - hessian[np.ix_(rest, held)] @ room[held]
        found = step(hessian[np.ix_(rest, rest)], left, damping[rest])
        if found is None:
            return None
        dx[held], dx[rest] = -room[held], found
    return dx


def _tried(evaluate: Callable[[NDArray], NormalEquations], x: NDArray) -> NormalEquations | None:
    """Return the normal equations at a trial point; None where it cannot be, or costs no number."""
    try:
        found = evaluate(x)
    except ImpossibleModelError:
        return None
    return found if np.isfinite(found[0]) else None


def levenberg_marquardt(
    evaluate: Callable[[NDArray], NormalEquations],
    start: NDArray,
    *,
    max_iterations: int = 100,
    tolerance: float = 1e-9,
    step: Step | None = None,
    least: NDArray | None = None,
) -> LevenbergMarquardtResult:
    """Minimise a sum of squares from its normal equations.

    Damping is scaled by the largest diagonal seen (Marquardt, as in MINPACK), so the iteration does
    not depend on units, and follows the gain ratio (Nielsen 1999). A step to what cannot be, such
    as a negative focal length, counts as one of infinite cost: it is refused, and shortened.

    Args:
        evaluate: Maps x to (cost, gradient, Gauss-Newton matrix).
        start: First point. Shape (p,).
        tolerance: Stop when a step is predicted to lower the cost by less than this fraction.
        step: Replaces `damped_step`, where variables are eliminated.
        least: Least value of each variable, -inf where it has none. Shape (p,).

    Returns:
        The best point. `converged` is False when the limit ended the iteration.

    Raises:
        ImpossibleModelError: If the start itself cannot be.
    """
    x = np.asarray(start, dtype=float)
    way = _descent(x, evaluate(x), max_iterations, tolerance, step or damped_step, least)
    x = next(way)
    while isinstance(x, np.ndarray):
        x = way.send(_tried(evaluate, x))
    return x


def levenberg_marquardt_each(
    evaluate: Callable[[NDArray, NDArray], tuple[NDArray, NDArray, NDArray]],
    starts: NDArray,
    *,
    max_iterations: int = 100,
    tolerance: float = 1e-9,
) -> list[LevenbergMarquardtResult]:
    """Minimise from each of many starts at once, each on its own way: `levenberg_marquardt`.

    Args:
        evaluate: Maps numbers of starts (k,) and their points (k, p) to costs (k,), gradients
            (k, p) and Gauss-Newton matrices (k, p, p).
        starts: First points. Shape (S, p).
        max_iterations: Limit on evaluated steps of each.
        tolerance: Stop when a step is predicted to lower the cost by less than this fraction.

    Returns:
        The best point of each.
    """
    x = np.asarray(starts, dtype=float)
    first = zip(*evaluate(np.arange(len(x)), x), strict=True)
    limits = (max_iterations, tolerance, damped_step)
    ways = [_descent(x[k], found, *limits) for k, found in enumerate(first)]
    at: list[Any] = [next(way) for way in ways]
    while going := [k for k, point in enumerate(at) if isinstance(point, np.ndarray)]:
        there = evaluate(np.array(going), np.stack([at[k] for k in going]))
        for k, *found in zip(going, *there, strict=True):
            at[k] = ways[k].send(tuple(found) if np.isfinite(found[0]) else None)
    return at


def _descent(
    x: NDArray,
    found: NormalEquations,
    max_iterations: int,
    tolerance: float,
    step: Step,
    least: NDArray | None = None,
) -> Generator[NDArray | LevenbergMarquardtResult, NormalEquations | None, None]:
    """Yield points to try, each to be answered by its normal equations or None, then the result."""
    cost, gradient, hessian = found
    if not np.isfinite(cost):
        yield LevenbergMarquardtResult(x, cost, 0, False, (cost,))
        return
    scale = np.diag(hessian).copy()
    history, damping, growth = [cost], 1e-4, 2.0
    iteration, converged = 0, False
    while iteration < max_iterations and not converged:
        iteration += 1
        floor = np.where(scale > 0.0, scale, 1.0)
        if least is None:
            dx = step(hessian, gradient, damping * floor)
        else:
            dx = _step_within(step, hessian, gradient, damping * floor, x - least)
        if dx is None:
            damping, growth = damping * growth, 2.0 * growth
            continue
        predicted = -(gradient @ dx) - 0.5 * dx @ hessian @ dx
        if predicted <= tolerance * cost or cost < 1e-30:
            converged = True
            continue
        new = yield x + dx
        if new is not None and new[0] < cost:
            gain = (cost - new[0]) / predicted
            damping = max(damping * max(0.01, 1.0 - (2.0 * gain - 1.0) ** 3), 1e-13)
            growth = 2.0
            x, (cost, gradient, hessian) = x + dx, new
            scale = np.maximum(scale, np.diag(hessian))
            history.append(cost)
        else:
            damping, growth = damping * growth, 2.0 * growth
            # No step downhill is left that floating point can see.
            converged = bool(damping > 1e16)
    yield LevenbergMarquardtResult(x, cost, iteration, converged, tuple(history))
