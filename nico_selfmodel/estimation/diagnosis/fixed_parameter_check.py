"""Whether pinned parameters contradict the data: a likelihood ratio against the fit without."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.noise.pose_refinement import (
    PoseWhitened,
    arm_program,
    refine_by_pose,
)
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.angles import nearest_turn
from nico_selfmodel.model.arm.dh_parameters import DhParameters

_SIGNIFICANT = 3.3
"""Standard score beyond which a rise of the misfit is no accident: one in 2000."""
_NOTABLE = 1.02
"""And the ratio of the rms residuals that makes it worth a failure."""
_ROUNDING_M = 1e-9
"""Residuals below this are rounding, not noise [m]."""


@dataclass(frozen=True)
class ContradictedParameter:
    """A pinned parameter that the data ask to be elsewhere."""

    name: str
    """Its parameter."""
    value: float
    """Where it is held."""
    wanted: float
    """Where it goes in a fit without pins."""
    rise: float
    """The rms residual with all pins over that without any."""


def contradicted_parameters(
    observations: Observations,
    start: DhParameters,
    solved: ArmSolution,
    pinned: frozenset[str],
    outliers: NDArray,
    sigma: float,
) -> tuple[ContradictedParameter, ...]:
    """Name the pins without which the data would fit significantly better.

    Where pins are right, the cost falls by chi square of their number once they are let go. Where
    it falls further, the one that lowers it most is let go, until the others are right.

    Args:
        observations: What was measured.
        start: The best arm without pins.
        solved: The solution with them.
        pinned: Names of the pinned parameters. Gauges are not tested: they move no point.
        outliers: Rows that the fit without pins does not accept. Boolean, shape (N,).
        sigma: Standard deviation of a coordinate about it [m].

    Returns:
        The pins, empty where they agree with the data or the data are too few to tell.
    """
    tested = sorted(pinned - start.gauge - solved.free)
    free = solved.free | frozenset(tested)
    redundancy = 3 * int((~outliers).sum()) - len(free)
    if not tested or redundancy < 10:
        return ()
    loose = refine_by_pose(observations, start, free, outliers, sigma, trim=False)
    fits = _Fits.about(observations, loose, solved)
    least, free_values = fits.without(tested, loose.parameters)
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
        ContradictedParameter(name, float(values[at]), _near(solved, at, free_values), rise)
        for name, at in ((name, names.index(name)) for name in wrong)
    )


def _near(solved: ArmSolution, at: int, wanted: NDArray) -> float:
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
    """Least squares over one set of rows and one noise, with one set of pins or less."""

    observations: Observations
    solved: ArmSolution
    whitening: PoseWhitening

    @classmethod
    def about(cls, observations: Observations, loose: ArmSolution, solved: ArmSolution) -> "_Fits":
        """Take the noise that is there without pins; what pins do must not count as noise."""
        noise = loose.noise
        assert noise is not None
        noise = PoseNoise(max(noise.sensor_sigma, _ROUNDING_M), noise.joint_sigma)
        linear = Linearised.at(observations, loose.parameters, ~loose.outliers, noise)
        return cls(observations, solved, linear.whitening)

    def without(self, loose: list[str], start: DhParameters) -> tuple[float, NDArray]:
        """Return the sum of squares and the values where these pins too may move."""
        free = self.solved.free | frozenset(loose)
        block = PoseWhitened(DhResiduals(self.observations, start, 1.0), self.whitening)
        program = arm_program(block, start, free)
        for name, value in zip(start.names, self.solved.parameters.values, strict=True):
            if name not in free:
                program.fix(name, float(value))
        solution = program.solve()
        return max(2.0 * solution.cost, np.finfo(float).tiny), solution.x


def _contradicts(cost: float, least: float, redundancy: int, count: int) -> bool:
    """Return whether `count` pins raise the cost notably and by more than chance lets them.

    The limit is the chi square of `count` that is as rare as `_SIGNIFICANT` (Wilson, Hilferty).
    """
    if count == 0 or cost < _NOTABLE**2 * least:
        return False
    share = 2.0 / (9.0 * count)
    limit = count * (1.0 - share + _SIGNIFICANT * np.sqrt(share)) ** 3
    return (cost - least) * redundancy / least > limit
