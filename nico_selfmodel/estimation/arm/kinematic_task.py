"""What the calibration of an arm works on, and from where it may start."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.sweeps import Sweep, marked_sweeps, unmarked_sweeps
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.initialization.axis_search import random_starts
from nico_selfmodel.estimation.initialization.circle_points import (
    CirclePointAnalysis,
    analyse_circle_points,
    crossing_of,
)
from nico_selfmodel.estimation.initialization.joint_zeros import meaningful_parameters
from nico_selfmodel.estimation.initialization.nominal_arm import (
    NominalArm,
    first_joint_zero,
    nominal_start,
)
from nico_selfmodel.estimation.initialization.start_search import RANDOM, few_rows
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations, gears_known
from nico_selfmodel.estimation.observations.sight_spread import SightSpread
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.names import listed

_ASSUMED_SIGMA = 1e-3
MOST_ROWS = 2000
"""Rows up to which everything is done on all of them. Of more a sample finds the minimum and the
noise, to 2 %; all rows then decide parameters, outliers and what is known of them."""
_OF_A_MARKER, _RUN = 50, 100
"""Least poses of a marker in a sample, and length of a run of visits."""
_WITHOUT_SWEEPS = 6
"""Without sweeps or a robot every start is random: this many times as many are allowed."""


@dataclass(frozen=True, eq=False)
class KinematicTask:
    """Observations, sweeps with their circles, and what the options say of the gears."""

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
    few: Observations
    """The part of the observations on which starts are tried."""
    sample: Observations
    """The part that tells minimum and noise: whole poses at random, or all there is."""
    witnesses: NDArray
    """Rows that are asked what the model lacks: visits in runs, in the order of time. (K,)."""

    @classmethod
    def prepare(
        cls,
        dataset: Dataset,
        nominal: NominalArm | None,
        pins: FixedParameters,
        starts: int,
        seed: int,
    ) -> "KinematicTask":
        """Gather what a data set says before anything is solved.

        Args:
            pins: Parameters held or freed by name.
            starts: Random starts allowed.
            seed: Of the random starts and of the circles' outlier search.

        Raises:
            DataError: If the data set has no measured point.
            ValueError: If the robot has other joints.
        """
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
            few_rows(observations, seed),
            _sample(observations, seed),
            _witnesses(observations),
        )

    def with_spread(self, spread: SightSpread | None, arm: ArmEstimate) -> "KinematicTask":
        """Return the same, its points weighed by what cameras are uncertain by near an arm's."""
        if spread is None:
            return self

        def of(rows: Observations) -> Observations:
            expected = arm.predict(rows.angles, rows.marker)
            return rows.with_spread(spread.covariances(expected, rows.p_WH))

        return replace(self, observations=of(self.observations), sample=of(self.sample))

    @property
    def sampled(self) -> bool:
        """Whether there are more poses than one sample needs."""
        return len(self.sample) < len(self.observations)

    def starts(self) -> Iterator[tuple[str, ArmEstimate]]:
        """Yield labelled starts, the most trusted first."""
        trusted = 0
        if self.circles is not None and self.circles.arm is not None:
            trusted += 1
            yield "circle points", self.circles.arm
        elif self.nominal is not None:
            placed = nominal_start(self.nominal, self.dataset, self.few, self.gear_known)
            if placed is not None:
                trusted += 1
                yield "robot", at_zero(placed, self.zero)
        if trusted and not self.redundant:
            return
        count = max(self.random_starts, 0) * (1 if trusted else _WITHOUT_SWEEPS)
        directions = gear = None
        if self.circles is not None and self.circles.trusted.any():
            trusted_axes = self.circles.trusted
            directions = np.where(trusted_axes[:, None], self.circles.directions, np.nan)
            gear = np.where(trusted_axes, self.circles.gear, np.nan)
        drawn = random_starts(
            self.few,
            self.gear_pinned & self.gear_known,
            self.zero,
            np.random.default_rng((self.seed, 1)),
            directions=directions,
            gear=gear,
            at_once=4 if trusted else 8,  # what circle points confirm, few starts do, too
        )
        for arm in islice(drawn, count if trusted else max(count, 1)):
            yield RANDOM, arm

    def parameters_of(self, arm: ArmEstimate) -> DhParameters:
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

    def without_sweeps(self) -> CirclePointAnalysis:
        """Return the analysis of no sweeps at all, which names every joint that needs one."""
        return analyse_circle_points(
            self.observations, [], self.gear_known, np.random.default_rng(0), self.zero
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

    def require_enough(self, pins: FixedParameters) -> None:
        """Check that there are more equations than unknowns, and that joints moved.

        Raises:
            DataError: If not.
        """
        observations = self.observations
        unknown = self.unknowns - sum(not name.endswith(".gear") for name in pins.pinned)
        if 3 * len(observations) < unknown:
            raise DataError(
                f"data set {self.dataset.name!r} has {len(observations)} measured points to learn "
                f"from, which give {3 * len(observations)} equations for {unknown} parameters: "
                f"record at least {-(-unknown // 3)} points, hold out fewer, or fix parameters"
            )
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
                f"{listed(still)} never moved in data set {self.dataset.name!r}: move every "
                "joint of the chain, or leave it out of the data set; if it did move, its encoder "
                "stands still"
            )


def _sample(observations: Observations, seed: int) -> Observations:
    """Return whole poses at random, some of every marker among them."""
    if len(observations) <= MOST_ROWS:
        return observations
    rng = np.random.default_rng((seed, 3))
    share = MOST_ROWS / len(observations)
    chosen = np.zeros(len(observations), dtype=bool)
    for marker in range(len(observations.markers)):
        poses = np.unique(observations.pose[observations.marker == marker])
        count = max(round(share * len(poses)), _OF_A_MARKER)
        chosen |= np.isin(observations.pose, rng.permutation(poses)[:count])
    return observations.select(chosen)


def _witnesses(observations: Observations) -> NDArray:
    """Return the rows of runs of successive visits, evenly over the recording."""
    visits = np.unique(observations.visit)
    if len(visits) <= MOST_ROWS:
        return np.arange(len(observations))
    starts = np.linspace(0, len(visits) - _RUN, MOST_ROWS // _RUN).astype(int)
    chosen = visits[np.unique(starts[:, None] + np.arange(_RUN))]
    return np.flatnonzero(np.isin(observations.visit, chosen))


def sweeps_of(dataset: Dataset, observations: Observations) -> list[Sweep]:
    """Return marked sweeps, and for joints without any those found in the encoders.

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


def at_zero(arm: ArmEstimate, zero: NDArray) -> ArmEstimate:
    """Return the same arm with its zero configuration at other encoder angles."""
    return ArmEstimate(arm.chain.rezeroed((zero - arm.zero) / arm.gear), arm.gear, zero)
