"""An arm and its tracked points, as the ladder asks them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.asked_poses import (
    FEWEST_POSES,
    certain_outliers,
    mean_by_pose,
    thinned,
    verticals,
)
from nico_selfmodel.estimation.bending.steps import from_both_sides
from nico_selfmodel.estimation.noise.arm_solution import ArmSolution, Linearised, Priors
from nico_selfmodel.estimation.noise.noise_variances import most_likely_noise
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise
from nico_selfmodel.estimation.noise.pose_refinement import counting_variance, refine_by_pose
from nico_selfmodel.estimation.noise.variance_components import LinearResiduals
from nico_selfmodel.estimation.observations.observations import Observations, gears_known
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.loaded_posture import LoadedPosture, loaded
from nico_selfmodel.model.arm.uniform_rods import load_sigmas, uniform_rods

SURE = (40.0, 8.0)
"""Robust standard deviations of a rigid body beyond which its outliers are left out: both are tried
where they differ, for the most bent poses look like outliers, and outliers like bends."""


@dataclass(frozen=True, eq=False)
class BendingArm:
    """An arm at its rigid solution: see `bendable.Bendable`."""

    observations: Observations
    """What was measured."""
    solution: ArmSolution
    """The rigid arm, with its noise."""
    up: NDArray | None = None
    """Unit vertical in W, shape (3,), if it is known."""
    held: frozenset[str] = frozenset()
    """Parameters that the user holds."""
    trim: bool = True
    """Look for outliers again at the end."""
    seed: int = 0
    """Of the poses that are asked where there are many."""
    whole: "tuple[BendingArm, NDArray] | None" = None
    """All observations and their certain outliers, of an arm that is asked by some."""

    @property
    def posture(self) -> DhParameters:
        """Parameters of the rigid arm."""
        return self.solution.parameters

    def ended(self, solution: ArmSolution) -> bool:
        """Return whether the search for a solution came to its end."""
        return solution.converged

    def posture_of(self, solution: ArmSolution) -> DhParameters:
        """Return the parameters of a solution."""
        return solution.parameters

    @property
    def noise(self) -> PoseNoise:
        """About the rigid arm."""
        assert self.solution.noise is not None
        return self.solution.noise

    def quieter(self, noise: PoseNoise) -> None:
        """Return nothing: joints of an arm are asked as loud as they are."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names."""
        return self.observations.joints

    @property
    def free(self) -> frozenset[str]:
        """Names of the rigid parameters that are estimated."""
        return self.solution.free

    @property
    def unit(self) -> str:
        """Unit of errors."""
        return "mm"

    @property
    def known_gears(self) -> tuple[str, ...]:
        """Names of gears that a unit tells and nobody holds."""
        known = gears_known(self.observations.units)
        names = (f"{joint}.gear" for joint, k in zip(self.joints, known, strict=True) if k)
        return tuple(name for name in names if name not in self.held | self.solution.free)

    @property
    def sides(self) -> bool:
        """Whether some joint is known to have come from both sides."""
        return from_both_sides(self.observations.approach)

    @property
    def enough(self) -> bool:
        """Whether there are enough poses to ask."""
        if self.solution.noise is None:
            return False
        poses = len(np.unique(self.observations.pose))
        return poses >= FEWEST_POSES and 3 * len(self.observations) >= 2 * len(self.free)

    @property
    def ups(self) -> tuple[tuple[NDArray, bool], ...]:
        """What may be the vertical in W, and whether its sense is certain."""
        if self.up is not None:
            return ((self.up, True),)
        return verticals(self.posture.table.X_W0[:3, 2])

    def rods(self) -> tuple[NDArray, NDArray]:
        """Return loads and pivots of uniform rods."""
        return uniform_rods(self.posture.table)

    def load_sigmas(self) -> NDArray:
        """Return how far loads may be from those of rods."""
        return load_sigmas(self.posture.table)

    def names_of(self, bending: Bending, effect: str) -> tuple[str, ...]:
        """Return an effect's numbers: an arm may have all."""
        return bending.names_of(effect)

    def weighed(
        self, posture: DhParameters, free: tuple[str, ...], noise: PoseNoise
    ) -> "WeighedArm":
        """Linearise about an arm."""
        keep = ~self.solution.outliers
        linear = Linearised.at(self.observations, posture, keep, noise)
        known = counting_variance(self.observations, posture.servos.gear)
        return WeighedArm(linear, free, self.observations.pose[keep], known)

    def turns(self, posture: DhParameters) -> NDArray:
        """Return how much joints turn beyond their displacements. Shape (N, n)."""
        found = self._loaded(posture)
        return np.asarray(found.q - found.q_read)

    def moments(self, posture: DhParameters) -> NDArray:
        """Return `Bending.moments`. Shape (n, N, 3)."""
        found = self._loaded(posture).moments
        assert found is not None
        return found

    def _loaded(self, posture: DhParameters) -> LoadedPosture:
        seen = self.observations
        q = (seen.angles - posture.servos.offset) / posture.servos.gear
        return loaded(posture.table, posture.bending, q, seen.approach)

    def few(self) -> "Iterator[BendingArm]":
        """Yield what is asked: some poses, without what is an outlier whatever bends."""
        asked: set[bytes] = set()
        for sure in SURE:
            without = certain_outliers(self.observations, self.solution, sure)
            seen, solved, keep = thinned(self.observations, self.solution, without, self.seed)
            if keep.tobytes() in asked:  # what else differs is not among these poses
                continue
            asked.add(keep.tobytes())
            yield replace(
                self,
                observations=seen,
                solution=replace(solved, outliers=~keep),
                whole=(self, without),
            )

    def bent(
        self, posture: DhParameters, free: tuple[str, ...], priors: Priors, noise: PoseNoise
    ) -> ArmSolution:
        """Return the solution of all observations, outliers looked for anew."""
        whole, outliers = self.whole or (self, self.solution.outliers)
        rigid, s = whole.solution, noise.sensor_sigma
        solved = refine_by_pose(
            *(whole.observations, posture, frozenset(free), outliers, s),
            trim=self.trim,
            priors=priors,
            noise=noise,
        )
        bending = solved.parameters.bending
        kept = bending if bending is not None and bending.effects else None
        return replace(
            solved,
            parameters=replace(solved.parameters, turn=None, bending=kept),
            iterations=solved.iterations + rigid.iterations,
            converged=solved.converged and rigid.converged,
        )

    def log_errors(self, posture: DhParameters) -> NDArray:
        """Return log(error) of each pose, outliers included. Shape (P,)."""
        seen = self.observations
        p = posture.points(seen.angles, seen.marker, seen.approach)
        errors = np.linalg.norm(p - seen.p_WH, axis=1)
        return np.log(mean_by_pose(errors, seen.pose))


@dataclass(frozen=True, eq=False)
class WeighedArm:
    """Tracked points about an arm: see `bendable.Weighed`."""

    linear: Linearised
    free: tuple[str, ...]
    """Names of the columns."""
    pose: NDArray
    """Pose of each row that counts. Shape (K,)."""
    known: NDArray
    """Variance of each joint angle by counting [rad^2]. Shape (n,)."""

    @property
    def noise(self) -> PoseNoise:
        """What disturbs the points."""
        return self.linear.noise

    def with_noise(self, noise: PoseNoise) -> "WeighedArm":
        """Return the same with other noise."""
        return replace(self, linear=self.linear.with_noise(noise))

    @property
    def U(self) -> NDArray:
        """Whitened derivatives, each pose counted once."""
        return self._white[0]

    @property
    def u(self) -> NDArray:
        """Whitened residuals."""
        return self._white[1]

    @cached_property
    def _white(self) -> tuple[NDArray, NDArray]:
        linear = self.linear
        columns = linear.weights * linear.columns(frozenset(self.free))
        return columns, linear.weights[:, 0] * linear.whitened_residuals

    @property
    def row(self) -> NDArray:
        """A row of the same visit that counts, of each whitened one."""
        groups = self.linear.whitening.groups
        return np.unique(groups.pose, return_index=True)[1][groups.visit]

    @property
    def _share(self) -> float:
        return float(self.linear.whitening.groups.weight.mean())

    @property
    def coordinates(self) -> float:
        """How many numbers count."""
        return self._share * 3 * len(self.linear.whitening.groups.rows)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of their covariance."""
        return self._share * self.linear.whitening.log_determinant

    @cached_property
    def _columns(self) -> list[int]:
        index = {name: i for i, name in enumerate(self.linear.names)}
        return [index[name] for name in self.free]

    def likeliest(self, pull: NDArray, variance: NDArray) -> PoseNoise:
        """Return the noise that residuals ask for, of effects that are known as well as that."""
        linear, groups, there = self.linear, self.linear.whitening.groups, variance > 0.0
        jacobian = linear.jacobian[:, :, self._columns]
        residuals = LinearResiduals(
            groups,
            groups.gather(linear.residuals - np.tensordot(jacobian, pull, 1)),
            groups.gather(jacobian[:, :, there]),
            linear.by_angle,
            information=1.0 / variance[there],
        )
        found = most_likely_noise(residuals, linear.noise, self.known)
        return PoseNoise(max(found.sensor_sigma, 1e-9), found.joint_sigma)

    def errors(self, step: NDArray, rows: NDArray) -> NDArray:
        """Return errors of some rows that count, after a step [m]."""
        linear = self.linear
        out = linear.whitening.groups.rows[rows]
        jacobian = linear.jacobian[out][:, :, self._columns]
        missed = linear.residuals[out] - np.tensordot(jacobian, step, 1)
        return np.asarray(np.linalg.norm(missed, axis=1))
