"""A dense Levenberg-Marquardt iteration on normal equations.

It knows only a function that returns cost, gradient and Gauss-Newton matrix, so that robust
losses, block structure and constrained steps can be supplied by those who need them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ImpossibleModelError

NormalEquations = tuple[float, NDArray, NDArray]
"""Cost f(x), gradient J'r and Gauss-Newton matrix J'J, with f = |r|^2 / 2."""

Step = Callable[[NDArray, NDArray, NDArray], NDArray | None]
"""Maps Gauss-Newton matrix, gradient and damping to a step; None asks for more damping."""

_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e-13, 1e16
"""Where damping begins, its least, and above which no step downhill is left that floating point can
see; all as parts of the largest diagonal."""
_NOTHING_LEFT = 1e-30
"""A cost below which there is nothing to explain."""


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
    x, step = np.asarray(start, dtype=float), step or damped_step
    cost, gradient, hessian = evaluate(x)
    if not np.isfinite(cost):
        return LevenbergMarquardtResult(x, cost, 0, False, (cost,))
    scale = np.diag(hessian).copy()
    history, damping, growth = [cost], _DAMPING, 2.0
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
        if predicted <= tolerance * cost or cost < _NOTHING_LEFT:
            converged = True
            continue
        new = _tried(evaluate, x + dx)
        if new is not None and new[0] < cost:
            gain = (cost - new[0]) / predicted
            damping = max(damping * max(0.01, 1.0 - (2.0 * gain - 1.0) ** 3), _LEAST_DAMPING)
            growth = 2.0
            x, (cost, gradient, hessian) = x + dx, new
            scale = np.maximum(scale, np.diag(hessian))
            history.append(cost)
        else:
            damping, growth = damping * growth, 2.0 * growth
            converged = bool(damping > _MOST_DAMPING)
    return LevenbergMarquardtResult(x, cost, iteration, converged, tuple(history))


def levenberg_marquardt_each(
    evaluate: Callable[[NDArray, NDArray], tuple[NDArray, NDArray, NDArray]],
    starts: NDArray,
    *,
    max_iterations: int = 100,
    tolerance: float = 1e-9,
) -> tuple[NDArray, NDArray]:
    """Minimise from each of many starts at once, each on its own way: `levenberg_marquardt`.

    Args:
        evaluate: Maps numbers of starts (k,) and their points (k, p) to costs (k,), gradients
            (k, p) and Gauss-Newton matrices (k, p, p).
        starts: First points. Shape (S, p).
        max_iterations: Limit on evaluated steps of each.
        tolerance: Stop when a step is predicted to lower the cost by less than this fraction.

    Returns:
        The best point of each, shape (S, p), and its cost, shape (S,).
    """
    x, every = np.array(starts, dtype=float), np.arange(len(starts))
    cost, gradient, hessian = map(np.array, evaluate(every, x))
    scale = np.diagonal(hessian, axis1=1, axis2=2).copy()
    damping, growth = np.full(len(x), _DAMPING), np.full(len(x), 2.0)
    going = every[np.isfinite(cost)]
    for _ in range(max_iterations):
        if not len(going):
            break
        floor = np.where(scale[going] > 0.0, scale[going], 1.0)
        dx, predicted, able = _damped_steps(
            hessian[going], gradient[going], damping[going, None] * floor
        )
        on = (predicted > tolerance * cost[going]) & (cost[going] >= _NOTHING_LEFT)
        asked = able & on
        tried, there, falls = going[asked], x[going[asked]] + dx[asked], np.zeros(0, dtype=bool)
        if len(tried):
            new, *slopes = evaluate(tried, there)
            falls = new < cost[tried]
            k = tried[falls]
            gain = (cost[k] - new[falls]) / predicted[asked][falls]
            less = damping[k] * np.maximum(0.01, 1.0 - (2.0 * gain - 1.0) ** 3)
            damping[k], growth[k] = np.maximum(less, _LEAST_DAMPING), 2.0
            x[k], cost[k], gradient[k], hessian[k] = (part[falls] for part in (there, new, *slopes))
            scale[k] = np.maximum(scale[k], np.diagonal(hessian[k], axis1=1, axis2=2))
        worse = np.concatenate([going[~able], tried[~falls]])
        damping[worse] *= growth[worse]
        growth[worse] *= 2.0
        going = going[(on | ~able) & (damping[going] <= _MOST_DAMPING)]
    return x, cost


def _damped_steps(
    hessian: NDArray, gradient: NDArray, damping: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return `damped_step` of many, by how much each lowers the cost, and which there are.

    Shapes (k, p, p), (k, p) and (k, p) -> (k, p), (k,) and (k,).
    """
    damped = hessian.copy()
    np.einsum("kii->ki", damped)[...] += damping
    able = _positive(damped)
    damped[~able] = np.eye(damped.shape[1])
    dx = -np.linalg.solve(damped, gradient[..., None])[..., 0]
    bent = np.sum(dx * (hessian @ dx[..., None])[..., 0], axis=1)
    return dx, -np.sum(gradient * dx, axis=1) - 0.5 * bent, able


def _positive(matrices: NDArray) -> NDArray:
    """Return which are positive definite. Shape (k, p, p) -> (k,)."""
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        alone = len(matrices) == 1
        parts = [np.zeros(1, dtype=bool)] if alone else [_positive(one[None]) for one in matrices]
        return np.concatenate(parts)
    return np.ones(len(matrices), dtype=bool)
