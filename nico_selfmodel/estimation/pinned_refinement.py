"""Refinement in Denavit-Hartenberg parameters, any of them pinned or freed, with uncertainty."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotConvergedError
from nico_selfmodel.estimation.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.pins import Pins
from nico_selfmodel.estimation.start_search import LineSolution
from nico_selfmodel.model import DhParameters
from nico_selfmodel.optimization import (
    CalibrationProgram,
    Loss,
    RobustSolution,
    Uncertainty,
    solve_robustly,
)

_LEAST_LEVER = 6.0
"""Distance of the tracked points from an axis, over the noise, below which a joint is blind."""


@dataclass(frozen=True, eq=False)
class PinnedSolution:
    """Named parameters at a solution, with what is known of them."""

    parameters: DhParameters
    """Table and servos."""
    free: frozenset[str]
    """Names that were estimated."""
    outliers: NDArray
    """Rows not believed. Boolean, shape (N,)."""
    uncertainty: Uncertainty | None
    """Of the free parameters; None where nothing was refined."""
    noise_sigma: float | None
    """Standard deviation of a measured coordinate about the model [m]."""
    converged: bool
    iterations: int
    history: tuple[float, ...]

    @classmethod
    def unrefined(cls, observations: Observations, parameters: DhParameters) -> "PinnedSolution":
        """Wrap parameters that were not refined, so that nothing is known of their errors."""
        residuals = parameters.predict(observations.angles, observations.marker)[0]
        residuals = residuals - observations.p_WH
        free = frozenset(parameters.names) - parameters.gauge
        sigma = float(np.sqrt(np.mean(residuals**2)))
        nothing = np.zeros(len(observations), dtype=bool)
        return cls(parameters, free, nothing, None, sigma, True, 0, ())

    @classmethod
    def from_lines(
        cls,
        observations: Observations,
        parameters: DhParameters,
        lines: LineSolution,
        sigma: float,
        gear_pinned: frozenset[str],
    ) -> "PinnedSolution":
        """Analyse a solution of the line problem in named parameters.

        Both views hold the same arm, so the covariance needs no conversion: it is that of the
        named parameters' own Jacobian.

        Args:
            observations: What was measured.
            parameters: The solution by name.
            lines: The solution as lines.
            sigma: Whitening of the residuals [m].
            gear_pinned: Gears that were held.
        """
        free = frozenset(parameters.names) - parameters.gauge - gear_pinned
        return cls.analysed(observations, parameters, free, lines.robust, sigma)

    @classmethod
    def analysed(
        cls,
        observations: Observations,
        parameters: DhParameters,
        free: frozenset[str],
        solved: RobustSolution,
        sigma: float,
    ) -> "PinnedSolution":
        """Add to a solution what the believed rows say of its errors.

        Args:
            observations: What was measured.
            parameters: The solution by name.
            free: Names that were estimated.
            solved: How they were.
            sigma: Whitening of the residuals [m].
        """
        program = dh_program(observations, parameters, free, sigma)
        weights = (~solved.outliers).astype(float)
        uncertainty = _uncertainty(program, free, observations, parameters, weights, sigma)
        return cls(
            parameters,
            free,
            solved.outliers,
            uncertainty,
            _noise(uncertainty, solved.scale, sigma),
            solved.solution.converged,
            solved.iterations,
            solved.solution.history,
        )


def refine_pinned(
    observations: Observations,
    start: DhParameters,
    pins: Pins,
    pin_values: dict[str, float],
    gear_pinned: frozenset[str],
    sigma: float,
    loss: str,
) -> PinnedSolution:
    """Refine with parameters pinned or freed by name.

    Args:
        observations: What was measured.
        start: The best arm without pins.
        pins: What to hold and what to let move.
        pin_values: Values of pins that name none; the start's where missing.
        gear_pinned: Gears that are held because their encoders already read joint angles.
        sigma: Whitening of the residuals [m].
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.

    Returns:
        The solution.

    Raises:
        NotConvergedError: If the pins contradict the data so much that a gear turns negative.
    """
    pinned = (start.gauge | gear_pinned | frozenset(pins.pinned)) - pins.freed
    free = frozenset(start.names) - pinned
    program = dh_program(observations, start, free, sigma)
    for name, value in pins.pinned.items():
        program.pin(name, pin_values.get(name) if value is None else value)
    solved = solve_robustly(program, 0, loss)
    # Written anew, so that the base's turn is the shortest one, as in a saved model.
    parameters = replace(start.with_values(solved.solution.x), turn=None)
    if np.any(parameters.servos.gear <= 0.0):
        raise NotConvergedError(
            f"no arm fits the data with {', '.join(sorted(pins.names))} as asked: a gear turned "
            "negative on the way; check the values and what the data say without them"
        )
    return PinnedSolution.analysed(observations, parameters, free, solved, sigma)


def dh_program(
    observations: Observations, parameters: DhParameters, free: frozenset[str], sigma: float
) -> CalibrationProgram:
    """Return the program of the named parameters; all but `free` are pinned where they are."""
    block = DhResiduals(observations, parameters, sigma)
    program = CalibrationProgram()
    program.add_variables(block.names, parameters.values)
    for name in block.names:
        if name not in free:
            program.pin(name)
    program.add_residuals(block)
    return program


def _uncertainty(
    program: CalibrationProgram,
    free: frozenset[str],
    observations: Observations,
    parameters: DhParameters,
    weights: NDArray,
    sigma: float,
) -> Uncertainty:
    """Analyse the believed rows at the solution."""
    names = tuple(name for name in program.names if name in free)
    program.set_loss(0, Loss(), weights)
    columns = [program.index(name) for name in names]
    jacobian = program.whitened_jacobian(parameters.values)[:, columns]
    residuals = program.residuals(0, parameters.values) * weights
    natural = DhResiduals(observations, parameters, sigma).natural_scale[columns]
    found = Uncertainty.from_jacobian(
        names, jacobian, natural, float(np.sum(residuals**2)), 3 * int(weights.sum())
    )
    for blind in _levers_of_noise(observations, parameters, free, _noise(found, 1.0, sigma)):
        if not any(set(blind) & set(direction.names) for direction in found.blind):
            found = found.with_blind(blind)
        else:
            found = replace(found, sigma=np.where(np.isin(found.names, blind), np.inf, found.sigma))
    return found


def _levers_of_noise(
    observations: Observations, parameters: DhParameters, free: frozenset[str], noise: float
) -> list[tuple[str, ...]]:
    """Return zero and gear of joints whose turning moves no tracked point beyond the noise.

    Such a point circles in its own noise: a gear fits it, with a sigma that means nothing.
    """
    jacobian = parameters.predict(observations.angles, observations.marker)[1]
    found = []
    for joint, gear in zip(parameters.table.joints, parameters.servos.gear, strict=True):
        column = parameters.names.index(f"{joint}.theta_offset")
        # dp / d theta_offset = -(arm of the joint) / gear
        lever = gear * np.sqrt(np.mean(np.sum(jacobian[:, :, column] ** 2, axis=1)))
        names = tuple(n for n in (f"{joint}.gear", f"{joint}.theta_offset") if n in free)
        if names and lever < _LEAST_LEVER * noise:
            found.append(names)
    return found


def _noise(uncertainty: Uncertainty, scale: float, sigma: float) -> float:
    factor = uncertainty.variance_factor
    return sigma * (float(np.sqrt(factor)) if np.isfinite(factor) else scale)
