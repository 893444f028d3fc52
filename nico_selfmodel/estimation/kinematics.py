"""Learning an arm: circle points, refinement from many starts, pins, uncertainty, held-out error.

The thesis' sections 6.2.1-6.2.3 with the corrections of `docs/thesis.md`.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import Dataset, Sweep, marked_sweeps, unmarked_sweeps
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.arm_hypothesis import ArmHypothesis
from nico_selfmodel.estimation.axis_search import random_starts
from nico_selfmodel.estimation.circle_points import (
    CirclePointAnalysis,
    analyse_circle_points,
    crossing_of,
    require_arm,
)
from nico_selfmodel.estimation.cross_validation import cross_validate
from nico_selfmodel.estimation.error_statistics import Evaluation, evaluate
from nico_selfmodel.estimation.gear_check import DoubtfulGear, doubtful_gears
from nico_selfmodel.estimation.learned_model import learned_model, training_of
from nico_selfmodel.estimation.nominal_start import (
    NominalArm,
    first_joint_zero,
    nominal_start,
)
from nico_selfmodel.estimation.observations import Observations, gears_known
from nico_selfmodel.estimation.pin_check import ContradictedPin, contradicted_pins
from nico_selfmodel.estimation.pinned_refinement import PinnedSolution, refine_pinned
from nico_selfmodel.estimation.pins import Pins
from nico_selfmodel.estimation.start_search import (
    RANDOM,
    LineSolution,
    StartSearch,
    search_starts,
)
from nico_selfmodel.estimation.zeroing import meaningful_parameters
from nico_selfmodel.model import DhParameters, DhTable, SelfModel
from nico_selfmodel.optimization import Uncertainty

METHODS = ("refine", "circle-points")
_ASSUMED_SIGMA = 1e-3
_WITHOUT_SWEEPS = 6
"""Without sweeps or a robot every start is random: this many times as many are allowed."""


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
    task = _Task.prepare(dataset, nominal, pins, starts, seed)
    if method == "circle-points":
        arm = require_arm(task.circles or _no_sweeps(task))
        parameters = task.parameters_of(arm)
        pins.check(parameters)
        solved = PinnedSolution.unrefined(task.observations, parameters)
        search, unseen, contradicted = None, np.zeros(0), ()
    else:
        task.require_enough(pins)
        loss = loss if task.redundant else "none"
        search = search_starts(task.observations, task.starts(), task.gear_pinned, task.sigma, loss)
        solved = _refined(task, search.best, pins, loss)
        unseen = cross_validate(task.observations, solved, task.sigma)
        contradicted = task.contradicted_pins(search.best, solved, pins)
    training = training_of(dataset, task.observations, solved, unseen)
    fit = {"method": method, "loss": loss, **training}
    model = learned_model(solved, dataset, name or dataset.name, nominal, fit)
    return KinematicCalibration(
        model,
        method,
        evaluate(model, dataset),
        solved.outliers,
        None if test is None else evaluate(model, test),
        unseen,
        solved.uncertainty,
        solved.free,
        task.circles,
        search,
        dataset.point_sigma_m,
        task.doubtful_gears(solved),
        contradicted,
        solved.converged,
        solved.iterations,
        solved.history,
        time.perf_counter() - clock,
    )


@dataclass(frozen=True, eq=False)
class _Task:
    """What a calibration works on, gathered once."""

    dataset: Dataset
    observations: Observations
    nominal: NominalArm | None
    gear_known: NDArray
    gear_pinned: NDArray
    zero: NDArray
    sigma: float
    circles: CirclePointAnalysis | None
    random_starts: int
    seed: int

    @classmethod
    def prepare(
        cls, dataset: Dataset, nominal: NominalArm | None, pins: Pins, starts: int, seed: int
    ) -> "_Task":
        observations = Observations.from_dataset(dataset)
        joints = observations.joints
        if nominal is not None:
            nominal = nominal.for_joints(joints)
        known = gears_known(observations.units)
        freed = np.array([f"{joint}.gear" in pins.freed for joint in joints])
        pinned = np.array([f"{joint}.gear" in pins.pinned for joint in joints])
        sweeps = sweeps_of(dataset, observations)
        rng = np.random.default_rng(seed)
        zero = np.where(known, 0.0, crossing_of(observations.angles, sweeps))
        circles = None
        if sweeps:
            circles = analyse_circle_points(observations, sweeps, known & ~freed, rng, zero)
        sigma = dataset.point_sigma_m or _ASSUMED_SIGMA
        gear_pinned = (known & ~freed) | pinned
        return cls(
            dataset,
            observations,
            nominal,
            known,
            gear_pinned,
            zero,
            sigma,
            circles,
            starts,
            seed,
        )

    def starts(self) -> Iterator[tuple[str, ArmHypothesis]]:
        """Yield labelled starts, the most trusted first."""
        trusted = 0
        if self.circles is not None and self.circles.arm is not None:
            trusted += 1
            yield "circle points", self.circles.arm
        elif self.nominal is not None:
            placed = nominal_start(self.nominal, self.dataset, self.observations, self.gear_known)
            if placed is not None:
                trusted += 1
                yield "robot", _at_zero(placed, self.zero)
        if trusted and not self.redundant:
            return
        count = max(self.random_starts, 0) * (1 if trusted else _WITHOUT_SWEEPS)
        directions = gear = None
        if self.circles is not None and self.circles.trusted.any():
            trusted_axes = self.circles.trusted
            directions = np.where(trusted_axes[:, None], self.circles.directions, np.nan)
            gear = np.where(trusted_axes, self.circles.gear, np.nan)
        wild = random_starts(
            self.observations,
            self.gear_pinned & self.gear_known,
            self.zero,
            np.random.default_rng((self.seed, 1)),
            directions=directions,
            gear=gear,
        )
        for arm in islice(wild, count if trusted else max(count, 1)):
            yield RANDOM, arm

    def parameters_of(self, arm: ArmHypothesis) -> DhParameters:
        """Write an arm as named parameters."""
        first = first_joint_zero(self.nominal, self.dataset, self.observations)
        return meaningful_parameters(
            arm,
            self.observations.units,
            self.gear_known,
            self.nominal,
            first,
            np.median(self.observations.angles, axis=0),
        )

    def doubtful_gears(self, solved: PinnedSolution) -> tuple[DoubtfulGear, ...]:
        """Return gears held because of their unit, which the data contradict."""
        joints = zip(self.observations.joints, self.gear_known & self.gear_pinned, strict=True)
        held = frozenset(f"{joint}.gear" for joint, known in joints if known)
        held -= solved.free
        return doubtful_gears(
            self.observations, solved.parameters, solved.free, held, ~solved.outliers
        )

    def contradicted_pins(
        self, best: LineSolution, solved: PinnedSolution, pins: Pins
    ) -> tuple[ContradictedPin, ...]:
        """Return pins without which the believed rows would fit significantly better."""
        joints = zip(self.observations.joints, self.gear_known, strict=True)
        by_unit = frozenset(f"{joint}.gear" for joint, known in joints if known)
        return contradicted_pins(
            self.observations.select(~best.robust.outliers),
            self.parameters_of(best.arm),
            solved,
            frozenset(pins.pinned) - by_unit,
            self.sigma,
        )

    @property
    def unknowns(self) -> int:
        """Number of free line parameters."""
        observations = self.observations
        n, m = len(observations.joints), len(observations.markers)
        return 4 * n + 3 * m + int(np.sum(~self.gear_pinned))

    @property
    def redundant(self) -> bool:
        """Whether there are twice as many equations as unknowns.

        With fewer, no observation can be told to be wrong, and the lowest of many minima fits the
        noise: only trusted starts and plain least squares are used then.
        """
        return 3 * len(self.observations) >= 2 * self.unknowns

    def require_enough(self, pins: Pins) -> None:
        """Check that there are more equations than unknowns, and that joints moved.

        Raises:
            DataError: If not.
        """
        observations = self.observations
        if observations.size <= 1e-9:
            raise DataError(
                f"the measured points of data set {self.dataset.name!r} do not move: they all "
                "coincide, so that nothing can be learned from them"
            )
        still = [
            joint
            for joint, span in zip(
                observations.joints, np.ptp(observations.angles, axis=0), strict=True
            )
            if span == 0.0
        ]
        if still:
            raise DataError(
                f"{', '.join(still)} never moved in data set {self.dataset.name!r}: move every "
                "joint of the chain, or leave it out of the data set"
            )
        unknown = self.unknowns - sum(not name.endswith(".gear") for name in pins.pinned)
        if 3 * len(observations) < unknown:
            raise DataError(
                f"data set {self.dataset.name!r} has {len(observations)} measured points, which "
                f"give {3 * len(observations)} equations for {unknown} parameters: record at "
                f"least {-(-unknown // 3)} points, or pin parameters"
            )


def sweeps_of(dataset: Dataset, observations: Observations) -> list[Sweep]:
    """Return marked sweeps, and for joints without any those found in the encoders.

    Args:
        dataset: The data.
        observations: Its measured points.

    Returns:
        Sweeps of every marker; their rows index `observations`.
    """
    position = {int(row): k for k, row in enumerate(observations.rows)}
    found: list[Sweep] = []
    for marker in observations.markers:
        marked = marked_sweeps(dataset, marker)
        have = {sweep.joint for sweep in marked}
        hidden = [] if len(have) == len(observations.joints) else unmarked_sweeps(dataset, marker)
        found += marked + [sweep for sweep in hidden if sweep.joint not in have]
    return [
        Sweep(sweep.joint, np.array([position[int(row)] for row in sweep.rows])) for sweep in found
    ]


def _no_sweeps(task: _Task) -> CirclePointAnalysis:
    return analyse_circle_points(
        task.observations, [], task.gear_known, np.random.default_rng(0), task.zero
    )


def _at_zero(arm: ArmHypothesis, zero: NDArray) -> ArmHypothesis:
    """Return the same arm with its zero configuration at other encoder angles."""
    return ArmHypothesis(arm.chain.rezeroed((zero - arm.zero) / arm.gear), arm.gear, zero)


def _refined(task: _Task, best: LineSolution, pins: Pins, loss: str) -> PinnedSolution:
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
