"""Refinement in Denavit-Hartenberg parameters, any of them pinned or freed."""

from dataclasses import dataclass, replace

from nico_selfmodel.estimation.noise.arm_solution import ArmSolution
from nico_selfmodel.estimation.noise.pose_refinement import arm_program, refine_by_pose
from nico_selfmodel.estimation.observations.hand_residuals import DhResiduals
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.optimization.calibration_program import CalibrationProgram
from nico_selfmodel.optimization.robust_solve import RobustSolution, solve_robustly


@dataclass(frozen=True, eq=False)
class Held:
    """What a refinement by name holds."""

    pins: FixedParameters
    """What the user holds and lets move."""
    values: dict[str, float]
    """Values of pins that name none; the start's where missing."""
    gears: frozenset[str]
    """Gears that are held because their encoders already read joint angles."""

    def free_names(self, start: DhParameters) -> frozenset[str]:
        """Return the parameters to estimate."""
        held = (start.gauge | self.gears | frozenset(self.pins.pinned)) - self.pins.freed
        return frozenset(start.names) - held

    def values_at(
        self, observations: Observations, start: DhParameters, found: RobustSolution, sigma: float
    ) -> dict[str, float]:
        """Return the values of all pins: the user's, the robot's, or those that the data ask for.

        The arguments are those of `refine_named`.
        """
        values = {**self.values, **{n: v for n, v in self.pins.pinned.items() if v is not None}}
        open_ones = set(self.pins.pinned) - set(values)
        if open_ones:
            loose = frozenset(start.names) - start.gauge - self.gears
            scale = sigma * found.scale
            learned = refine_by_pose(observations, start, loose, found.outliers, scale).parameters
            named = zip(learned.names, learned.values.tolist(), strict=True)
            values |= {name: value for name, value in named if name in open_ones}
        return values


def refine_named(
    observations: Observations,
    start: DhParameters,
    held: Held,
    found: RobustSolution,
    sigma: float,
    loss: str,
) -> ArmSolution:
    """Refine with parameters pinned or freed by name.

    Args:
        start: The best arm without pins.
        held: What to hold and what to let move.
        found: How the best arm was found, with its outliers.
        sigma: Whitening of the residuals [m].
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.

    Raises:
        NotConvergedError: If the pins contradict the data so much that a gear turns negative.
    """
    free, pins = held.free_names(start), held.pins
    if not pins.only_gears or any(value is not None for value in pins.pinned.values()):
        values = held.values_at(observations, start, found, sigma)
        program = dh_program(observations, start, free, sigma)
        for name in pins.pinned:
            program.fix(name, values.get(name))
        found = solve_robustly(program, 0, loss)
        # Written anew, so that the base's turn is the shortest one, as in a saved model.
        start = replace(start.with_values(found.solution.x), turn=None)
        pins.refuse_turned_gears(start.servos.gear)
    solved = refine_by_pose(
        observations, start, free, found.outliers, sigma * found.scale, trim=loss != "none"
    )
    pins.refuse_turned_gears(solved.parameters.servos.gear)
    return replace(
        solved,
        parameters=replace(solved.parameters, turn=None),
        converged=solved.converged and found.solution.converged,
        iterations=solved.iterations + found.iterations,
    )


def dh_program(
    observations: Observations, parameters: DhParameters, free: frozenset[str], sigma: float
) -> CalibrationProgram:
    """Return the program of the named parameters; all but `free` are pinned where they are."""
    return arm_program(DhResiduals(observations, parameters, sigma), parameters, free)
