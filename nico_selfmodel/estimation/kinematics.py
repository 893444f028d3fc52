"""Learning an arm: circle points, refinement from many starts, pins, uncertainty, held-out error.

The thesis' sections 6.2.1-6.2.3 with the corrections of `docs/thesis.md`.
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset
from nico_selfmodel.estimation.circle_points import CirclePointAnalysis, require_arm
from nico_selfmodel.estimation.cross_validation import cross_validate
from nico_selfmodel.estimation.error_statistics import Evaluation, evaluate
from nico_selfmodel.estimation.gear_check import DoubtfulGear, doubtful_gears
from nico_selfmodel.estimation.kinematic_task import KinematicTask
from nico_selfmodel.estimation.learned_model import learned_model, training_of
from nico_selfmodel.estimation.misfit_causes import causes_of_misfit
from nico_selfmodel.estimation.nominal_check import robot_reason
from nico_selfmodel.estimation.nominal_start import NominalArm
from nico_selfmodel.estimation.pin_check import ContradictedPin, contradicted_pins
from nico_selfmodel.estimation.pinned_refinement import PinnedSolution, refine_pinned
from nico_selfmodel.estimation.pins import Pins
from nico_selfmodel.estimation.start_search import LineSolution, StartSearch, search_starts
from nico_selfmodel.model import DhTable, SelfModel
from nico_selfmodel.optimization import Uncertainty

METHODS = ("refine", "circle-points")


@dataclass(frozen=True, eq=False)
class KinematicCalibration:
    """A learned arm with everything that is known about how it was learned."""

    model: SelfModel
    """The self-model."""
    method: str
    """`refine` or `circle-points`."""
    train: Evaluation
    """The model on its own training data, outliers included."""
    outliers: NDArray
    """Rows of `train` that were not believed. Boolean, shape (N,)."""
    free_poses: NDArray
    """Rows of `train` that are marked as no sweep's. Boolean, shape (N,)."""
    test: Evaluation | None
    """The model on held-out data."""
    cross_validation: NDArray
    """Errors of believed rows predicted without their own fold [m]. Shape (K,)."""
    uncertainty: Uncertainty | None
    """Of the free parameters; None for circle points alone."""
    free: frozenset[str]
    """Names of the parameters that were estimated."""
    circles: CirclePointAnalysis | None
    """Sweeps and their circles, where there were any."""
    search: StartSearch | None
    """How the starts fared."""
    point_sigma: float | None
    """Standard deviation of a measured coordinate that the data set states [m]."""
    doubtful_gears: tuple[DoubtfulGear, ...]
    """Gears held at 1 that the data contradict."""
    contradicted_pins: tuple[ContradictedPin, ...]
    """Parameters pinned by name that the data contradict."""
    contradicted_robot: str | None
    """How the learned arm is not the described robot, in words; None where it may be."""
    causes: tuple[str, ...]
    """What would make the data fit, where they do not; in words."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the final solution."""
    history: tuple[float, ...]
    """Costs of the final solution after each step."""
    seconds: float
    """Time taken."""


def calibrate_kinematics(
    dataset: Dataset,
    *,
    method: str = "refine",
    test: Dataset | None = None,
    nominal: NominalArm | None = None,
    pins: Pins | None = None,
    loss: str = "trimmed",
    starts: int = 10,
    seed: int = 0,
    name: str | None = None,
    explain: bool = True,
) -> KinematicCalibration:
    """Learn an arm from encoder readings and measured points of the hand.

    Args:
        dataset: Training data.
        method: `refine`, or `circle-points` for the sweeps alone.
        test: Held-out data, for judging only.
        nominal: The robot as described, for pins and the zero of its joints, and as a start where
            sweeps give none.
        pins: Parameters held or freed by name.
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.
        starts: Random starts allowed beside circle points and the robot.
        seed: Of the random starts.
        name: Name of the self-model; the data set's if omitted.
        explain: Look for what would make the data fit, where they do not; that takes longer than
            the calibration.

    Returns:
        The calibration. A failed check does not raise: see `verdict`.

    Raises:
        DataError: If the data cannot serve: no points, fewer equations than parameters.
        NotIdentifiableError: If `circle-points` meets a joint without a usable circle.
        ValueError: If a name or a choice is unknown.
    """
    if method not in METHODS:
        raise ValueError(f"no method {method!r}; there are {', '.join(METHODS)}")
    clock, pins = time.perf_counter(), pins or Pins()
    task = KinematicTask.prepare(dataset, nominal, pins, starts, seed)
    if method == "circle-points":
        arm = require_arm(task.circles or task.without_sweeps())
        parameters = task.parameters_of(arm)
        pins.check(parameters)
        solved = PinnedSolution.unrefined(task.observations, parameters)
        search, unseen, contradicted, causes = None, np.zeros(0), (), ()
    else:
        task.require_enough(pins)
        loss = loss if task.redundant else "none"
        search = search_starts(task.observations, task.starts(), task.gear_pinned, task.sigma, loss)
        solved = _refined(task, search.best, pins, loss)
        unseen = cross_validate(task.observations, solved, task.sigma)
        contradicted = _contradicted_pins(task, search.best, solved, pins)
        causes = _causes(task, search, loss) if explain else ()
    training = training_of(dataset, task.observations, solved, unseen)
    fit = {"method": method, "loss": loss, **training}
    model = learned_model(solved, dataset, name or dataset.name, nominal, fit)
    return KinematicCalibration(
        model,
        method,
        evaluate(model, dataset),
        solved.outliers,
        dataset.sweep[task.observations.rows] == "",
        None if test is None else evaluate(model, test),
        unseen,
        solved.uncertainty,
        solved.free,
        task.circles,
        search,
        dataset.point_sigma_m,
        _doubtful_gears(task, solved),
        contradicted,
        None if nominal is None else robot_reason(nominal.chain, model.dh, task.gear_known),
        causes,
        solved.converged,
        solved.iterations,
        solved.history,
        time.perf_counter() - clock,
    )


def _refined(task: KinematicTask, best: LineSolution, pins: Pins, loss: str) -> PinnedSolution:
    """Turn the best lines into named parameters, solved again where names are pinned or freed."""
    parameters = task.parameters_of(best.arm)
    pins.check(parameters)
    gear_pinned = frozenset(
        f"{joint}.gear"
        for joint, pinned in zip(task.observations.joints, task.gear_pinned, strict=True)
        if pinned
    )
    if pins.only_gears and not any(v is not None for v in pins.pinned.values()):
        return PinnedSolution.from_lines(
            task.observations, parameters, best, task.sigma, gear_pinned
        )
    values = _nominal_values(task.nominal, pins)
    return refine_pinned(task.observations, parameters, pins, values, gear_pinned, task.sigma, loss)


def _nominal_values(nominal: NominalArm | None, pins: Pins) -> dict[str, float]:
    """Return the values at which `--pin NAME` holds: the robot's, where one was given."""
    if nominal is None:
        return {}
    table = DhTable.from_chain(nominal.chain)
    values: dict[str, float] = {}
    for name in pins.pinned:
        joint, _, part = name.rpartition(".")
        if joint in table.joints and part in ("D", "r", "alpha", "beta"):
            values[name] = float(getattr(table, part)[table.joints.index(joint)])
    return values


def _doubtful_gears(task: KinematicTask, solved: PinnedSolution) -> tuple[DoubtfulGear, ...]:
    """Return gears held because of their unit, which the data contradict."""
    joints = zip(task.observations.joints, task.gear_known & task.gear_pinned, strict=True)
    held = frozenset(f"{joint}.gear" for joint, known in joints if known)
    held -= solved.free
    return doubtful_gears(task.observations, solved.parameters, solved.free, held, ~solved.outliers)


def _causes(task: KinematicTask, search: StartSearch, loss: str) -> tuple[str, ...]:
    """Return what would make the data fit, where they do not."""
    if not task.redundant:
        return ()
    return causes_of_misfit(
        task.observations,
        search,
        task.gear_pinned,
        task.gear_known,
        task.zero,
        task.sigma,
        loss,
    )


def _contradicted_pins(
    task: KinematicTask, best: LineSolution, solved: PinnedSolution, pins: Pins
) -> tuple[ContradictedPin, ...]:
    """Return pins without which the believed rows would fit significantly better."""
    joints = zip(task.observations.joints, task.gear_known, strict=True)
    by_unit = frozenset(f"{joint}.gear" for joint, known in joints if known)
    return contradicted_pins(
        task.observations.select(~best.robust.outliers),
        task.parameters_of(best.arm),
        solved,
        frozenset(pins.pinned) - by_unit,
        task.sigma,
    )
