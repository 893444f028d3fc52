"""The response that explains the steps of one joint best."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.response.steps import Steps
from nico_selfmodel.least_squares import NormalEquations, levenberg_marquardt
from nico_selfmodel.model.response.servo_response import ServoResponse
from nico_selfmodel.model.response.step_response import LOOP, PROFILE, step_response

Shape = tuple[str, tuple[str, ...]]
"""Kind of a response, and which numbers it has besides its delay."""
SHAPES: tuple[Shape, ...] = (
    (PROFILE, ("speed",)),
    (PROFILE, ("acceleration",)),
    (PROFILE, ("speed", "acceleration")),
    (PROFILE, ("speed", "rate")),
    (PROFILE, ("acceleration", "rate")),
    (PROFILE, ("speed", "acceleration", "rate")),
    (LOOP, ("rate",)),
    (LOOP, ("speed", "rate")),
)
"""From few numbers to many."""
_STEPS, _MORE_STEPS = 60, 600
"""Of the solver, from each first guess, and from the best place that it found."""
_STRONG = 6.0
"""Difference of the criterion from which evidence is strong (Kass and Raftery 1995)."""
_FASTEST = 1e4
"""Factor on a first guess beyond which a number is without limit."""


@dataclass(frozen=True, eq=False)
class StepFit:
    """A response, and the delay of each step."""

    shape: Shape
    """What it is made of."""
    log_parts: NDArray
    """Logarithms of its numbers."""
    delays: NDArray
    """Of each step [s]. Shape (n,)."""
    residuals: NDArray
    """Measured less expected of each row, each step with its own delay [rad]. Shape (N,)."""
    weighted: NDArray
    """The same in standard deviations of the rows. Shape (N,)."""
    rates: NDArray
    """How fast the joint is expected to move [rad/s]. Shape (N,)."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the solver."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for key in ("log_parts", "delays", "residuals", "weighted", "rates"):
            object.__setattr__(self, key, read_only(getattr(self, key)))

    @property
    def parts(self) -> dict[str, float]:
        """Speed, acceleration and rate, those that it has."""
        return dict(zip(self.shape[1], np.exp(self.log_parts).tolist(), strict=True))

    def bic(self) -> float:
        """Return Schwarz' criterion; what all shapes share is left out."""
        N = len(self.residuals)
        mean = max(float(np.mean(self.weighted**2)), 1e-18)
        return N * np.log(mean) + len(self.log_parts) * np.log(N)

    def response(self, joint: str) -> ServoResponse:
        """Return it with the mean of its delays."""
        spread = float(self.delays.std(ddof=1)) if len(self.delays) > 1 else 0.0
        return ServoResponse(joint, self.shape[0], float(self.delays.mean()), spread, **self.parts)


def fit_steps(steps: Steps) -> tuple[StepFit, Steps]:
    """Return the response of the shape that explains the steps with the fewest numbers.

    Shapes are compared by Schwarz' criterion (1978). Times of readings are not exact, so that a row
    is known the worse the faster the joint moves, sigma^2 = s^2 + s_t^2 x'^2; both are estimated by
    a first fit.

    Returns:
        It, and the steps with the standard deviation of each row.
    """
    first = _best(steps)
    steps = _weighed(steps, first)
    return _best(steps), steps


def _best(steps: Steps) -> StepFit:
    """Return the fit with the fewest numbers against which nothing speaks strongly."""
    fits = [fit for shape in SHAPES for fit in _fits(steps, shape)]
    least = min(map(StepFit.bic, fits)) + _STRONG
    chosen = [fit for fit in fits if fit.bic() <= least]
    found = min(chosen, key=lambda fit: (len(fit.log_parts), fit.bic()))
    if found.converged:
        return found
    # A lag and an acceleration that are hardly told apart take their time.
    return _fit(steps, found.shape, found.log_parts, found.delays, _MORE_STEPS)


def _weighed(steps: Steps, fit: StepFit) -> Steps:
    """Return steps with sigmas by the speed, of squared residuals by least squares."""
    least, fast, r2 = float(steps.sigma.min()) ** 2, fit.rates**2, fit.residuals**2
    spread = float(fast @ fast)
    timing = max(float(fast @ (r2 - least)) / spread, 0.0) if spread else 0.0
    return replace(steps, sigma=np.sqrt(least + timing * fast))


def refit(steps: Steps, fit: StepFit, chosen: NDArray) -> StepFit:
    """Return the response of the same shape by some of the steps. Boolean, shape (n,)."""
    return _fit(steps.select(chosen), fit.shape, fit.log_parts, fit.delays[chosen], _STEPS)


def _fits(steps: Steps, shape: Shape) -> list[StepFit]:
    """Fit a shape from several first guesses."""
    slow, delays = _guess(steps)
    factors = {"speed": (1.0,), "acceleration": (4.0, 40.0), "rate": (1.0, 6.0)}
    length = float(np.median(np.abs(steps.way)))
    guess = {"speed": length / slow, "acceleration": length / slow**2, "rate": 3.0 / slow}
    grids = np.meshgrid(*(np.log(factors[name]) + np.log(guess[name]) for name in shape[1]))
    starts = np.stack([grid.ravel() for grid in grids], axis=1)
    return [_fit(steps, shape, start, delays, _STEPS) for start in starts]


def _guess(steps: Steps) -> tuple[float, NDArray]:
    """Return how long a step takes in the median [s], and when each begins to move [s], (n,)."""
    share = steps.gone / np.abs(steps.way)[steps.step]
    crossings = []
    for level in (0.1, 0.9):
        beyond = share >= level
        first = np.full(len(steps), np.inf)
        np.minimum.at(first, steps.step[beyond], steps.time[beyond])
        crossings.append(np.where(np.isfinite(first), first, np.nanmax(steps.time)))
    early, late = crossings
    took = np.maximum((late - early) / 0.8, 1e-3)
    return float(np.median(took)), np.maximum(early - 0.15 * took, 0.0)


def _fit(steps: Steps, shape: Shape, start: NDArray, delays: NDArray, most: int) -> StepFit:
    """Fit the numbers of a shape and the delay of each step by least squares."""
    first = np.concatenate([start, delays])
    evaluate = partial(_normal_equations, steps, shape, np.asarray(start))
    found = levenberg_marquardt(evaluate, first, max_iterations=most)
    k = len(shape[1])
    r, slopes = _residuals(steps, shape, found.x)
    rates, how = slopes["time"], (found.converged, found.iterations)
    return StepFit(shape, found.x[:k], found.x[k:], r, r / steps.sigma, rates, *how)


def _residuals(steps: Steps, shape: Shape, x: NDArray) -> tuple[NDArray, dict[str, NDArray]]:
    k = len(shape[1])
    parts = dict(zip(shape[1], np.exp(x[:k]).tolist(), strict=True))
    way = np.abs(steps.way)[steps.step]
    expected, slopes = step_response(shape[0], way, steps.time - x[k:][steps.step], parts)
    return steps.gone - expected, slopes


def _normal_equations(steps: Steps, shape: Shape, start: NDArray, x: NDArray) -> NormalEquations:
    """Return cost, gradient and matrix; each delay belongs to the rows of its own step."""
    k, n = len(shape[1]), len(steps)
    if (np.abs(x[:k] - start) > np.log(_FASTEST)).any():
        return np.inf, np.zeros(k + n), np.eye(k + n)
    r, slopes = _residuals(steps, shape, x)
    r, by_delay = r / steps.sigma, -slopes["time"] / steps.sigma
    J = np.stack([slopes[name] / steps.sigma for name in shape[1]], axis=1)
    H = np.zeros((k + n, k + n))
    H[:k, :k] = J.T @ J
    for i in range(k):  # a number, not a sample
        H[i, k:] = H[k:, i] = np.bincount(steps.step, J[:, i] * by_delay, n)
    H.flat[k * (k + n + 1) :: k + n + 1] = np.bincount(steps.step, by_delay**2, n)
    gradient = -np.concatenate([J.T @ r, np.bincount(steps.step, by_delay * r, n)])
    return 0.5 * float(r @ r), gradient, H
