"""An arm and two cameras with boards, as the ladder asks them what bends."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.bending.asked_poses import (
    FEWEST_POSES,
    drawn_poses,
    mean_by_pose,
    verticals,
)
from nico_selfmodel.estimation.bending.bending_arm import SURE
from nico_selfmodel.estimation.bending.steps import from_both_sides
from nico_selfmodel.estimation.body.body_problem import BodySolution
from nico_selfmodel.estimation.body.body_uncertainty import board_rows
from nico_selfmodel.estimation.noise.arm_solution import Priors
from nico_selfmodel.estimation.noise.hand_noise import HandNoise, noise_covariance
from nico_selfmodel.estimation.observations.arm_views import DhArm
from nico_selfmodel.estimation.observations.hand_pixels import HandPixels
from nico_selfmodel.estimation.observations.observations import gears_known
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.loaded_posture import LoadedPosture, loaded
from nico_selfmodel.model.arm.uniform_rods import load_sigmas, uniform_rods
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.losses import robust_scale


@dataclass(frozen=True, eq=False)
class BodyPosture:
    """Arm and cameras: see `bendable.Posture`."""

    arm: DhParameters
    rig: StereoRig

    @property
    def names(self) -> tuple[str, ...]:
        """Of the arm's parameters, then the cameras'."""
        return (*self.arm.names, *self.rig.names)

    @property
    def values(self) -> NDArray:
        """In the order of `names`."""
        return np.concatenate([self.arm.values, self.rig.values])

    @property
    def bending(self) -> Bending | None:
        """What bends."""
        return self.arm.bending

    @property
    def gears(self) -> NDArray:
        """Of all joints. Shape (n,)."""
        return self.arm.gears

    def with_values(self, values: NDArray) -> "BodyPosture":
        """Return the same body with other values."""
        split, left = len(self.arm.names), self.rig.left
        rig = StereoRig.from_values(values[split:], left.image_size, left.lens)
        return BodyPosture(self.arm.with_values(values[:split]), rig)

    def with_bending(self, bending: Bending | None) -> "BodyPosture":
        """Return the same body in which something else bends."""
        return replace(self, arm=self.arm.with_bending(bending))


@dataclass(frozen=True, eq=False)
class BodyBend:
    """A body's solution, and its arm by name."""

    parameters: DhParameters
    solved: BodySolution
    free: frozenset[str]
    """Names of what was estimated."""
    priors: Priors
    """Of numbers that bend."""


Resolve = Callable[[BodyPosture, frozenset[str], Priors, HandNoise], BodyBend]
"""Solves arm, cameras and boards by name, about a posture."""


@dataclass(frozen=True, eq=False)
class BendingBody:
    """Arm and cameras at their rigid solution: see `bendable.Bendable`."""

    seen: PixelObservations
    """What is asked."""
    boards: BoardViews | None
    """What holds the cameras."""
    solution: BodyBend
    """The rigid one."""
    resolve: Resolve
    """How all is solved at the end."""
    held: frozenset[str] = frozenset()
    """Parameters that the user holds."""
    up: NDArray | None = None
    """Unit vertical in the left camera's frame, shape (3,), if it is known."""
    seed: int = 0
    """Of the poses that are asked where there are many."""
    outliers: NDArray | None = None
    """Rows that do not count; the solution's if omitted. Boolean, shape (N,)."""

    @property
    def posture(self) -> BodyPosture:
        """The rigid body."""
        return self.posture_of(self.solution)

    def ended(self, solution: BodyBend) -> bool:
        """Return whether the search for a solution came to its end."""
        return solution.solved.converged

    def posture_of(self, solution: BodyBend) -> BodyPosture:
        """Return the parameters of a solution."""
        return BodyPosture(solution.parameters, solution.solved.rig)

    @property
    def noise(self) -> HandNoise:
        """About the rigid body."""
        return self.solution.solved.noise

    @property
    def joints(self) -> tuple[str, ...]:
        """Names."""
        return self.seen.arm.joints

    @property
    def free(self) -> frozenset[str]:
        """Names of the rigid parameters that are estimated."""
        return self.solution.free

    @property
    def unit(self) -> str:
        """Unit of errors."""
        return "px"

    @property
    def known_gears(self) -> tuple[str, ...]:
        """Names of gears that a unit tells and nobody holds."""
        known = gears_known(self.seen.arm.units)
        names = (f"{joint}.gear" for joint, k in zip(self.joints, known, strict=True) if k)
        return tuple(name for name in names if name not in self.held | self.free)

    @property
    def sides(self) -> bool:
        """Whether some joint is known to have come from both sides."""
        return from_both_sides(self.seen.arm.approach)

    @property
    def enough(self) -> bool:
        """Whether there are enough poses to ask."""
        poses = len(np.unique(self.seen.arm.pose))
        return poses >= FEWEST_POSES and int(self.seen.seen.sum()) >= 2 * len(self.free)

    @property
    def ups(self) -> tuple[tuple[NDArray, bool], ...]:
        """What may be the vertical in W, and whether its sense is certain."""
        if self.up is not None:
            return ((self.up, True),)
        return verticals(self.posture.arm.table.X_W0[:3, 2])

    def rods(self) -> tuple[NDArray, NDArray]:
        """Return loads and pivots of uniform rods."""
        return uniform_rods(self.posture.arm.table)

    def load_sigmas(self) -> NDArray:
        """Return how far loads may be from those of rods."""
        return load_sigmas(self.posture.arm.table)

    def names_of(self, bending: Bending, effect: str) -> tuple[str, ...]:
        """Return an effect's numbers: an arm may have all."""
        return bending.names_of(effect)

    @property
    def _kept(self) -> NDArray:
        return ~(self.solution.solved.outliers if self.outliers is None else self.outliers)

    def weighed(
        self, posture: BodyPosture, free: tuple[str, ...], noise: HandNoise
    ) -> "WeighedBody":
        """Linearise about a body."""
        kept = self.seen.select(self._kept)
        block = HandPixels(kept, DhArm(kept.arm, posture.arm), lens=posture.rig.lens)
        x = posture.values
        r, J = block.evaluate(x)
        columns = [block.names.index(name) for name in free]
        boards, rest = self._boards(free)
        if len(boards):
            names = [i for i, name in enumerate(free) if name in posture.rig.names]
            rig = {n: float(v) for n, v in zip(posture.rig.names, posture.rig.values, strict=True)}
            was = self.solution.solved.rig
            old = dict(zip(was.names, was.values.tolist(), strict=True))
            moved = np.array([rig[free[i]] - old[free[i]] for i in names])
            rest = rest - boards[:, names] @ moved
        by_angle = block.by_angle(x)
        jacobian = J[columns].transpose(2, 1, 0)
        parts = kept, free, noise, -r.T, jacobian, by_angle
        return WeighedBody(*parts, boards, rest)

    def _boards(self, free: tuple[str, ...]) -> tuple[NDArray, NDArray]:
        """Return what boards say of the cameras: whitened derivatives and residuals."""
        if self.boards is None:
            return np.zeros((0, len(free))), np.zeros(0)
        J, r, _ = board_rows(self.boards, self.solution.solved, free)
        return J, -r

    def turns(self, posture: BodyPosture) -> NDArray:
        """Return how much joints turn beyond their displacements. Shape (N, n)."""
        found = self._loaded(posture)
        return np.asarray(found.q - found.q_read)

    def moments(self, posture: BodyPosture) -> NDArray:
        """Return `Bending.moments`. Shape (n, N, 3)."""
        found = self._loaded(posture).moments
        assert found is not None
        return found

    def _loaded(self, posture: BodyPosture) -> LoadedPosture:
        seen, servos = self.seen.arm, posture.arm.servos
        q = (seen.angles - servos.offset) / servos.gear
        return loaded(posture.arm.table, posture.bending, q, seen.approach)

    def few(self) -> "Iterator[BendingBody]":
        """Yield what is asked: some poses, without what is an outlier whatever bends."""
        rigid, distance = self.solution.solved.outliers, self._distances(self.posture)
        scale = robust_scale(distance[~rigid], 2)
        aside = np.stack([rigid & (distance > sure * scale) for sure in SURE])
        pose = self.seen.arm.pose
        keep = np.isin(pose, drawn_poses(pose, self.seed))
        for without in np.unique(aside, axis=0):
            yield replace(self, seen=self.seen.select(keep), outliers=without[keep])

    def _distances(self, posture: BodyPosture) -> NDArray:
        """Return the error of each row, root mean square over the cameras [px]. Shape (N,)."""
        block = HandPixels(self.seen, DhArm(self.seen.arm, posture.arm), lens=posture.rig.lens)
        r = block.evaluate(posture.values)[0]
        return _length(r.T, self.seen.seen)

    def bent(
        self, posture: BodyPosture, free: tuple[str, ...], priors: Priors, noise: HandNoise
    ) -> BodyBend:
        """Return the solution of all observations, outliers looked for anew."""
        return self.resolve(posture, frozenset(free), priors, noise)

    def log_errors(self, posture: BodyPosture) -> NDArray:
        """Return log(error) of each pose, outliers included. Shape (P,)."""
        return np.log(mean_by_pose(self._distances(posture), self.seen.arm.pose))


def _length(r: NDArray, seen: NDArray) -> NDArray:
    """Return the root mean square over the cameras that saw each row. Shape (N, 4) -> (N,)."""
    squares = np.where(seen, r, 0.0) ** 2
    return np.asarray(np.sqrt(2.0 * squares.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)))


@dataclass(frozen=True, eq=False)
class WeighedBody:
    """The hand's pixels, and boards, about a body: see `bendable.Weighed`."""

    seen: PixelObservations
    """Rows that count."""
    free: tuple[str, ...]
    """Names of the columns."""
    noise: HandNoise
    """What disturbs the pixels."""
    residuals: NDArray
    """Measured minus predicted [px]. Shape (N, 4)."""
    jacobian: NDArray
    """Derivatives of the predictions by `free`. Shape (N, 4, k)."""
    by_angle: NDArray
    """Those by the joint angles. Shape (N, 4, n)."""
    boards: NDArray
    """What boards say of the cameras, whitened, their own poses free. Shape (B, k)."""
    rest: NDArray
    """Their whitened residuals. Shape (B,)."""

    @property
    def pose(self) -> NDArray:
        """Pose of each row. Shape (N,)."""
        return self.seen.arm.pose

    def with_noise(self, noise: HandNoise) -> "WeighedBody":
        """Return the same with other noise."""
        return replace(self, noise=noise)

    @cached_property
    def _white(self) -> tuple[NDArray, NDArray]:
        W = self.noise.whitening(self.by_angle, self.seen.seen)
        J = (W @ self.jacobian).reshape(-1, len(self.free))
        r = (W @ self.residuals[:, :, None]).ravel()
        return np.vstack([J, self.boards]), np.append(r, self.rest)

    @property
    def U(self) -> NDArray:
        """Whitened derivatives; what boards say of the cameras are the last rows."""
        return self._white[0]

    @property
    def u(self) -> NDArray:
        """Whitened residuals."""
        return self._white[1]

    @property
    def row(self) -> NDArray:
        """The row of each whitened coordinate; -1 of boards."""
        return np.append(np.repeat(np.arange(len(self.seen)), 4), np.full(len(self.rest), -1))

    @property
    def coordinates(self) -> float:
        """How many numbers count."""
        return float(self.seen.seen.sum())

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of their covariance."""
        S = noise_covariance(self.by_angle, self.noise.sensor_sigma, self.noise.joint_sigma)
        seen = self.seen.seen
        both = seen[:, :, None] & seen[:, None, :]
        return float(np.linalg.slogdet(np.where(both, S, np.eye(4)))[1].sum())

    def likeliest(self, pull: NDArray, variance: NDArray) -> HandNoise:
        """Return the noise that residuals ask for, of effects that are known as well as that."""
        there, seen = variance > 0.0, self.seen.seen
        U, known = self.U[:, there], 1.0 / variance[there]
        size = np.sqrt(np.maximum(np.sum(U**2, axis=0) + known, np.finfo(float).tiny))
        U, J = U / size, self.jacobian[:, :, there] / size
        H = U.T @ U + np.diag(known / size**2)
        C = np.linalg.pinv(H, rcond=1e-11, hermitian=True)
        left = self.residuals - self.jacobian @ pull
        left = left - J @ (C @ (U.T @ (self.u - self.U @ pull)))
        fitted = J @ C @ np.swapaxes(J, 1, 2)
        return HandNoise.most_likely(np.where(seen, left, 0.0), self.by_angle, seen, fitted)

    def errors(self, step: NDArray, rows: NDArray) -> NDArray:
        """Return errors of some rows, after a step [px]."""
        missed = self.residuals[rows] - self.jacobian[rows] @ step
        return _length(missed, self.seen.seen[rows])
