"""Learning an arm: circle points, refinement from many starts, pins, uncertainty, held-out error.

The thesis' sections 6.2.1-6.2.3 with the corrections of `docs/thesis.md`.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.held_out import held_out_of
from nico_selfmodel.estimation.arm.cross_validation import cross_validate_arm
from nico_selfmodel.estimation.arm.evaluation import Evaluation, evaluate
from nico_selfmodel.estimation.arm.kinematic_task import KinematicTask
from nico_selfmodel.estimation.arm.learned_model import learned_model, training_of
from nico_selfmodel.estimation.arm.named_refinement import Held, refine_named
from nico_selfmodel.estimation.bending.bending_arm import BendingArm
from nico_selfmodel.estimation.bending.ladder import Ladder, climb
from nico_selfmodel.estimation.bending.steps import STEPS
from nico_selfmodel.estimation.bending.what_bends import At, arm_at
from nico_selfmodel.estimation.diagnosis.changes_in_time import Change, change_in_time
from nico_selfmodel.estimation.diagnosis.fault_hypotheses import (
    Causes,
    causes_of_misfit,
    foreign_marker,
)
from nico_selfmodel.estimation.diagnosis.fixed_parameter_check import (
    ContradictedParameter,
    contradicted_parameters,
)
from nico_selfmodel.estimation.diagnosis.gear_check import DoubtfulGear, doubtful_gears
from nico_selfmodel.estimation.diagnosis.lag_in_time import Steps, lag_in_time
from nico_selfmodel.estimation.diagnosis.nominal_check import RobotSize, odd_axes, robot_size
from nico_selfmodel.estimation.diagnosis.outliers_in_time import outliers_in_time
from nico_selfmodel.estimation.diagnosis.score_test import ArmTest, arm_test
from nico_selfmodel.estimation.diagnosis.systematic_residuals import (
    Pattern,
    likeliest_backlash,
    systematic_patterns,
)
from nico_selfmodel.estimation.initialization.circle_points import CirclePointAnalysis, require_arm
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.initialization.start_search import (
    LineSolution,
    StartSearch,
    search_starts,
)
from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.noise.pose_sums import PoseSums, refine_on_all
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.sight_spread import SightSpread
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.uncertainty import Uncertainty

METHODS = ("refine", "circle-points")
_PATTERNS = 4
"""Patterns of the residuals that a change in time is told from."""


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
    """Rows of `train` that were outliers. Boolean, shape (N,)."""
    free_poses: NDArray
    """Rows of `train` that are marked as no sweep's. Boolean, shape (N,)."""
    test: Evaluation | None
    """The model on held-out data."""
    cross_validation: NDArray
    """Errors of inlier rows predicted without their own fold [m]. Shape (K,)."""
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
    contradicted_parameters: tuple[ContradictedParameter, ...]
    """Parameters pinned by name that the data contradict."""
    size: RobotSize | None
    """How large the learned arm is beside the described robot; None where nothing tells."""
    odd_axes: str | None
    """Where the described robot is far off; None where it is not, or there is none."""
    causes: Causes
    """What would make the data fit, where they do not."""
    ladder: Ladder
    """What may bend, and what became of it."""
    noise: PoseNoise | None
    """Of the sensor and of the joints; None for circle points alone."""
    spread: SightSpread | None
    """What weighed points that cameras reconstructed."""
    patterns: tuple[Pattern, ...]
    """What the residuals depend on, which the model does not have; the surest first."""
    change: Change | None
    """What changed while the data were recorded."""
    lag: Change | None
    """Whether points and readings are of different moments."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the final solution."""
    history: tuple[float, ...]
    """Costs of the final solution after each step."""
    seconds: float
    """Time taken."""

    @property
    def at(self) -> At:
        """Where the arm is at the training poses, whatever bends in it."""
        return arm_at(self.model.parameters, self.train.observations)


@on_one_blas_thread
def calibrate_kinematics(
    dataset: Dataset,
    *,
    method: str = "refine",
    test: Dataset | None = None,
    nominal: NominalArm | None = None,
    pins: FixedParameters | None = None,
    loss: str = "trimmed",
    starts: int = 10,
    seed: int = 0,
    name: str | None = None,
    explain: bool = True,
    effects: Sequence[str] = STEPS,
    up: NDArray | None = None,
    spread: SightSpread | None = None,
) -> KinematicCalibration:
    """Learn an arm from encoder readings and measured points of the hand.

    Args:
        method: `refine`, or `circle-points` for the sweeps alone.
        test: Held-out data, for judging only.
        nominal: The robot as described, for pins and the zero of its joints, and as a start where
            sweeps give none.
        pins: Parameters held or freed by name.
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.
        starts: Random starts allowed beside circle points and the robot.
        name: Name of the self-model; the data set's if omitted.
        explain: Look for what would make the data fit, where they do not; that takes longer than
            the calibration.
        effects: What may bend, of `estimation.bending.steps.STEPS`: kept where unseen poses gain.
            With none they are asked for all the same, to tell what they would explain.
        up: Unit vertical in W, for sag; the first axis and z are tried if omitted. Shape (3,).
        spread: Of points that cameras reconstructed; a tracker's coordinates err alike if omitted.

    Returns:
        The calibration. A failed check does not raise: see `estimation.judging.judge`.

    Raises:
        DataError: If the data cannot serve: no points, fewer equations than parameters.
        NotIdentifiableError: If `circle-points` meets a joint without a usable circle.
        ValueError: If a name or a choice is unknown, or `circle-points` has pins.
    """
    clock, pins = time.perf_counter(), pins or FixedParameters()
    _check_method(method, pins)
    test = None if test is None else held_out_of(dataset, test)
    task = KinematicTask.prepare(dataset, nominal, pins, starts, seed)
    if method == "circle-points":
        arm = require_arm(task.circles or task.without_sweeps())
        parameters = task.parameters_of(arm)
        solved = ArmSolution.unrefined(task.observations, parameters)
        search, unseen, contradicted, ladder = None, np.zeros(0), (), Ladder((), solved)
    else:
        task.require_enough(pins)
        loss = loss if task.redundant else "none"
        search = search_starts(
            task.sample, task.few, task.starts(), task.gear_pinned, task.sigma, loss
        )
        task = task.with_spread(spread, search.best.arm)
        solved = _refined(task, search.best, pins, loss)
        contradicted = _contradicted_parameters(task, search.best, solved, pins)
        trim = loss != "none"
        asked = effects if not contradicted else None  # no bend shall explain a wrong value
        ladder = climb(BendingArm(task.sample, solved, up, pins.names, trim, seed), asked)
        ladder = _unless_time_explains(task, solved, ladder)
        solved, sums = _on_all(task, ladder, trim)
        unseen = cross_validate_arm(task.observations, solved, sums)
    doubts = _Doubts.of(task, solved)
    causes = Causes()
    if search is not None and explain and task.redundant:
        causes = _causes(task, search, doubts, loss, solved.noise_sigma)
    fit = {"method": method, "loss": loss}
    fit |= training_of(dataset, task.observations, solved, unseen)
    model = learned_model(solved, dataset, name or dataset.name, nominal, fit)
    return KinematicCalibration(
        model,
        method,
        evaluate(model, dataset, spread),
        solved.outliers,
        dataset.sweep[task.observations.rows] == "",
        None if test is None else evaluate(model, test, spread),
        unseen,
        solved.uncertainty,
        solved.free,
        task.circles,
        search,
        dataset.point_sigma_m,
        doubts.gears or ladder.doubtful_gears,
        contradicted,
        None if nominal is None else robot_size(nominal.chain, model.dh, task.gear_known),
        None if nominal is None else odd_axes(nominal.chain, model.dh.to_chain()),
        causes,
        ladder,
        solved.noise,
        spread,
        doubts.patterns,
        doubts.change,
        doubts.lag,
        solved.converged,
        solved.iterations,
        solved.history,
        time.perf_counter() - clock,
    )


def _check_method(method: str, pins: FixedParameters) -> None:
    """Refuse a method that there is not, or that cannot hold what shall be held."""
    if method not in METHODS:
        raise ValueError(f"no method {method!r}; there are {', '.join(METHODS)}")
    if method == "circle-points" and pins.names:
        raise ValueError(
            f"circle-points learns each joint by its own circle and can neither fix nor free "
            f"{listed(sorted(pins.names))}: take the method refine"
        )


def _refined(
    task: KinematicTask, best: LineSolution, pins: FixedParameters, loss: str
) -> ArmSolution:
    """Turn the best lines into named parameters and refine them by poses."""
    parameters = task.parameters_of(best.arm)
    pins.check(parameters)
    gears = frozenset(
        f"{joint}.gear"
        for joint, pinned in zip(task.observations.joints, task.gear_pinned, strict=True)
        if pinned
    )
    held = Held(pins, _nominal_values(task.nominal, pins), gears)
    return refine_named(task.sample, parameters, held, best.robust, task.sigma, loss)


def _unless_time_explains(task: KinematicTask, rigid: ArmSolution, ladder: Ladder) -> Ladder:
    """Return a ladder that keeps nothing where time explains more than all that stayed on it.

    In poses that follow each other a coupling or sag takes part of what a late encoder misses by,
    or one that jumped, and leaves a rest that tells neither.
    """
    if not ladder.adopted:
        return ladder
    doubts = _Doubts.of(task, rigid)
    told = [one for one in (doubts.lag, doubts.change) if one is not None and one.explains]
    return Ladder((), rigid) if any(one.ratio > ladder.gain for one in told) else ladder


def _on_all(task: KinematicTask, ladder: Ladder, trim: bool) -> tuple[ArmSolution, PoseSums | None]:
    """Return the arm that the ladder ended with, on all observations, and what these say of it."""
    solved: ArmSolution = ladder.solution
    sums = None
    if task.sampled:
        solved, sums = refine_on_all(task.observations, solved, trim=trim)
    assert solved.uncertainty is not None
    known = ladder.in_doubt(solved.uncertainty, solved.parameters)
    return replace(solved, uncertainty=known), sums


@dataclass(frozen=True, eq=False)
class _Doubts:
    """What residuals at a solution say against it."""

    gears: tuple[DoubtfulGear, ...] = ()
    patterns: tuple[Pattern, ...] = ()
    change: Change | None = None
    lag: Change | None = None

    @classmethod
    def of(cls, task: KinematicTask, solved: ArmSolution) -> "_Doubts":
        noise = solved.noise
        if noise is None or solved.uncertainty is None or not task.redundant:
            return cls()
        observations, outliers = task.observations, solved.outliers
        apart = outliers_in_time(observations, outliers)
        if task.sampled:
            observations = observations.select(task.witnesses)
            solved = replace(solved, outliers=outliers[task.witnesses])
        linear = Linearised.at(observations, solved.parameters, ~solved.outliers, noise)
        test = arm_test(linear, solved.free, solved.priors, solved.parameters.values)
        joints = zip(observations.joints, task.gear_known & task.gear_pinned, strict=True)
        held = frozenset(f"{joint}.gear" for joint, known in joints if known) - solved.free
        patterns = systematic_patterns(observations, solved.parameters, test)
        ripples = {p.ripple_of: p.score for p in patterns if p.ripple_of is not None}
        backlash = likeliest_backlash(observations, test)
        known = np.concatenate([backlash, *(p.columns for p in patterns[:_PATTERNS])], axis=2)
        return cls(
            doubtful_gears(test, solved.parameters, held, ripples),
            patterns,
            _notable(
                change_in_time(observations, solved, known, patterns),
                apart,
            ),
            _lag(observations, solved, test),
        )


def _lag(observations: Observations, solved: ArmSolution, test: ArmTest) -> Change | None:
    servos = solved.parameters.servos
    q = (observations.angles - servos.offset) / servos.gear
    steps = Steps.of(observations.sample, q)
    everything = np.ones(len(q), dtype=bool)
    joints = {name: j for j, name in enumerate(observations.joints)}
    return lag_in_time(steps, test, {"the points": everything}, joints)


def _notable(*changes: Change | None) -> Change | None:
    """Return the first change that matters, else the first there is."""
    there = [change for change in changes if change is not None]
    return next((change for change in there if change.notable), there[0] if there else None)


def _nominal_values(nominal: NominalArm | None, pins: FixedParameters) -> dict[str, float]:
    """Return the values at which `--fix NAME` holds: the robot's, where one was given."""
    if nominal is None:
        return {}
    table = DhTable.from_chain(nominal.chain)
    values: dict[str, float] = {}
    for name in pins.pinned:
        joint, _, part = name.rpartition(".")
        if joint in table.joints and part in ("D", "r", "alpha", "beta"):
            values[name] = float(getattr(table, part)[table.joints.index(joint)])
    return values


def _causes(
    task: KinematicTask, search: StartSearch, doubts: _Doubts, loss: str, scatter: float | None
) -> Causes:
    """Return what would make the data fit, where they do not; what is plain to see first."""
    foreign = foreign_marker(task.observations)
    if foreign is not None:
        return Causes((foreign,))
    if doubts.lag is not None and doubts.lag.explains:
        return Causes((doubts.lag.what,))
    return causes_of_misfit(
        task.observations,
        search,
        task.gear_pinned,
        task.gear_known,
        task.zero,
        task.sigma,
        loss,
        scatter or 0.0,
    )


def _contradicted_parameters(
    task: KinematicTask, best: LineSolution, solved: ArmSolution, pins: FixedParameters
) -> tuple[ContradictedParameter, ...]:
    """Return pins without which the inlier rows would fit significantly better."""
    joints = zip(task.observations.joints, task.gear_known, strict=True)
    by_unit = frozenset(f"{joint}.gear" for joint, known in joints if known)
    return contradicted_parameters(
        task.sample,
        task.parameters_of(best.arm),
        solved,
        frozenset(pins.pinned) - by_unit,
        best.robust.outliers,
        task.sigma * best.robust.scale,
    )
