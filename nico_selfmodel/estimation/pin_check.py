"""Whether pinned parameters contradict the data: a likelihood ratio against the fit without."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations import Observations
from nico_selfmodel.estimation.pinned_refinement import PinnedSolution, dh_program
from nico_selfmodel.geometry.angles import nearest_turn
from nico_selfmodel.model import DhParameters

_SIGNIFICANT = 3.3
"""Standard score beyond which a rise of the misfit is no accident: one in 2000."""
_NOTABLE = 1.02
"""And the ratio of the rms residuals that makes it worth a failure."""
_ROUNDING_M = 1e-9
"""Residuals below this are rounding, not noise [m]."""


@dataclass(frozen=True)
class ContradictedPin:
    """A pinned parameter that the data ask to be elsewhere."""

    name: str
    """Its parameter."""
    value: float
    """Where it is held."""
    wanted: float
    """Where it goes in a fit without pins."""
    rise: float
    """The rms residual with all pins over that without any."""


def contradicted_pins(
    observations: Observations,
    start: DhParameters,
    solved: PinnedSolution,
    pinned: frozenset[str],
    sigma: float,
) -> tuple[ContradictedPin, ...]:
    """Name the pins without which the data would fit significantly better.

    Where pins are right, the cost falls by chi square of their number once they are let go. Where
    it falls further, the one that lowers it most is let go, until the others are right.

    Args:
        observations: Rows believed by the fit without pins.
        start: The best arm without pins.
        solved: The solution with them.
        pinned: Names of the pinned parameters. Gauges are not tested: they move no point.
        sigma: Whitening of the residuals [m].

    Returns:
        The pins, empty where they agree with the data or the data are too few to tell.
    """
    tested = sorted(pinned - start.gauge - solved.free)
    redundancy = 3 * len(observations) - len(solved.free) - len(tested)
    if not tested or redundancy < 10:
        return ()
    fits = _Fits(observations, solved, sigma)
    least, free_values = fits.without(tested, start)
    least = max(least, redundancy * (_ROUNDING_M / sigma) ** 2)
    held, _ = fits.without([], solved.parameters)
    cost, wrong = held, list[str]()
    while _contradicts(cost, least, redundancy, len(tested) - len(wrong)):
        others = [name for name in tested if name not in wrong]
        costs = [fits.without([*wrong, name], solved.parameters)[0] for name in others]
        cost = min(costs)
        wrong.append(others[int(np.argmin(costs))])
    names, values = solved.parameters.names, solved.parameters.values
    rise = float(np.sqrt(held / least))
    return tuple(
        ContradictedPin(name, float(values[at]), _near(solved, at, free_values), rise)
        for name, at in ((name, names.index(name)) for name in wrong)
    )


def _near(solved: PinnedSolution, at: int, wanted: NDArray) -> float:
    """Return where a parameter wants to be; an angle on the turn nearest to where it is held."""
    parameters = solved.parameters
    if parameters.units[at] != "rad":
        return float(wanted[at])
    name = parameters.names[at]
    joint = name.rpartition(".")[0]
    geared = name.endswith(".theta_offset")
    gear = parameters.servos.gear[parameters.table.joints.index(joint)] if geared else 1.0
    return float(nearest_turn(wanted[at], parameters.values[at], 2.0 * np.pi * gear))


@dataclass(frozen=True, eq=False)
class _Fits:
    """Least squares over one set of rows, with one set of pins or less."""

    observations: Observations
    solved: PinnedSolution
    sigma: float

    def without(self, loose: list[str], start: DhParameters) -> tuple[float, NDArray]:
        """Return the sum of squares and the values where these pins too may move."""
        free = self.solved.free | frozenset(loose)
        program = dh_program(self.observations, start, free, self.sigma)
        for name, value in zip(start.names, self.solved.parameters.values, strict=True):
            if name not in free:
                program.pin(name, float(value))
        solution = program.solve()
        return 2.0 * solution.cost, solution.x


def _contradicts(cost: float, least: float, redundancy: int, count: int) -> bool:
    """Return whether `count` pins raise the cost notably and by more than chance lets them.

    The limit is the chi square of `count` that is as rare as `_SIGNIFICANT` (Wilson, Hilferty).
    """
    if count == 0 or cost < _NOTABLE**2 * least:
        return False
    share = 2.0 / (9.0 * count)
    limit = count * (1.0 - share + _SIGNIFICANT * np.sqrt(share)) ** 3
    return (cost - least) * redundancy / least > limit
