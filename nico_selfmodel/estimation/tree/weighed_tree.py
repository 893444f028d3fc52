"""Observations linearised about a body, whitened by pose, as the ladder fits effects to them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import SIGHTS
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseWhitening
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.noise.likeliest_noise import likeliest_noise
from nico_selfmodel.estimation.tree.noise.noise_evidence import (
    NoiseEvidence,
    beside_shared,
    tree_whitening,
)
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import BodyParameters
from nico_selfmodel.estimation.tree.tree_priors import prior_rows
from nico_selfmodel.estimation.tree.tree_setup import Priors
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.tree.body_tree import BodyTree


@dataclass(frozen=True, eq=False)
class TreePosture:
    """A body's parameters: see `bendable.Posture`."""

    parameters: BodyParameters
    """What they are told from."""
    values: NDArray
    """All of them. Shape (P,)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of all of them."""
        return self.parameters.names

    @property
    def tree(self) -> BodyTree:
        """The body."""
        return self.parameters.tree_of(self.values)

    @property
    def bending(self) -> Bending | None:
        """What bends."""
        return self.parameters.bending_of(self.values)

    @property
    def gears(self) -> NDArray:
        """Of all joints. Shape (n,)."""
        return np.asarray(self.values[self.parameters.gears])

    def with_values(self, values: NDArray) -> "TreePosture":
        """Return the same body with other values."""
        return TreePosture(self.parameters, np.asarray(values, dtype=float))

    def with_bending(self, bending: Bending | None) -> "TreePosture":
        """Return the same body in which something else bends."""
        rigid = self.values[: self.parameters.bends.start]
        bends = np.zeros(0) if bending is None else bending.values
        parameters = self.parameters.with_bending(bending)
        return TreePosture(parameters, np.concatenate([rigid, bends]))


def lengths(seen: TreeObservations, r: NDArray) -> NDArray:
    """Return how far off what tells places is, by row of the table; nan for the rest. (N,)."""
    out = np.full(len(seen.data.observations), np.nan)
    for rows in seen.sensors:
        if rows.kind in SIGHTS and not rows.apart:
            off = r[rows.scalars].reshape(len(rows.rows), -1)
            out[rows.rows] = np.linalg.norm(off[:, :3], axis=1)
    return out


def _log_of(E: NDArray) -> float:
    """Return log|E'E|, of which prior rows make it log|1 + E'E| of the others."""
    return float(np.linalg.slogdet(E.T @ E)[1]) if E.shape[1] else 0.0


@dataclass(frozen=True, eq=False)
class WeighedTree:
    """Observations about a body: see `bendable.Weighed`."""

    seen: TreeObservations
    posture: TreePosture
    free: tuple[str, ...]
    """Names of the columns."""
    noise: TreeNoise
    """What disturbs the observations."""
    linear: TreeLinear
    outliers: NDArray
    """Rows of the table that do not count. Shape (N,)."""
    rows: NDArray
    """Rows of the table whose errors are compared. Shape (K,)."""
    pose: NDArray
    """Their poses. Shape (K,)."""
    priors: Priors
    """Of rigid parameters."""
    size: NDArray
    """What makes errors of all sensors alike. Shape (K,)."""

    def with_noise(self, noise: TreeNoise) -> "WeighedTree":
        """Return the same with other noise."""
        return replace(self, noise=noise)

    @cached_property
    def _groups(self) -> PoseGroups:
        return self.seen.groups(self.outliers)

    @cached_property
    def _scale(self) -> NDArray:
        return np.asarray(self.noise.own.sensor[self.seen.noise_group])

    @cached_property
    def _whitening(self) -> PoseWhitening:
        return tree_whitening(self.seen, self.linear, self._groups, self.noise.own)

    @cached_property
    def _columns(self) -> NDArray:
        index = self.posture.parameters.index
        return np.array([index[name] for name in self.free], dtype=int)

    @cached_property
    def _white(self) -> tuple[NDArray, NDArray]:
        own = replace(self.linear, J=self.linear.J[self._columns])
        J = beside_shared(self.seen, own, np.zeros(0), self.noise.alike)[0].J
        J = (J / self._scale)[:, None]
        r, slopes = self._whitening.whiten((-self.linear.r / self._scale)[None], J)
        keep = self._groups.rows
        now = dict(zip(self.posture.names, self.posture.values.tolist(), strict=True))
        rows, rest = prior_rows(self.priors, self.free, now)
        shared = len(J) - len(self.free)
        rows = np.pad(rows, ((0, 0), (0, shared)))
        beside = np.eye(shared, len(J), len(self.free))
        rest = np.concatenate([r[0, keep], -rest, np.zeros(shared)])
        return np.vstack([slopes[:, 0, keep].T, rows, beside]), rest

    @property
    def U(self) -> NDArray:
        """Whitened derivatives, each pose counted once; priors of rigid parameters are rows.

        Columns beyond those of `free` are by errors of N(0, 1) that poses share.
        """
        return self._white[0]

    @property
    def u(self) -> NDArray:
        """Whitened residuals."""
        return self._white[1]

    @property
    def row(self) -> NDArray:
        """A row of the same visit that counts, of each whitened one; -1 of what is in no pose."""
        place = np.full(len(self.seen.data.observations), -1)
        place[self.rows] = np.arange(len(self.rows))
        # Whatever else a pose shows is left out with it.
        of_pose = dict(zip(self.pose.tolist(), range(len(self.pose)), strict=True))
        pose = self.seen.pose[self._groups.rows]
        by_pose = np.array([of_pose.get(number, -1) for number in pose.tolist()])
        found = place[self.seen.row[self._groups.rows]]
        found = np.where(found < 0, by_pose, found)
        return np.append(found, np.full(len(self.u) - len(found), -1))

    @property
    def _share(self) -> float:
        return float(self._groups.weight.mean())

    @property
    def coordinates(self) -> float:
        """How many numbers count."""
        taken = 0.0 if self.linear.taken is None else float(self.linear.taken.sum())
        return self._share * (len(self._groups.rows) - taken)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of their covariance."""
        scales = 2.0 * float(np.log(self._scale[self._groups.rows]).sum())
        if self.linear.taken is not None:
            scales -= 2.0 * float(self.linear.taken @ np.log(self.noise.sensor))
        E = self.U[:, len(self.free) :]
        return self._share * (self._whitening.log_determinant + scales) + _log_of(E)

    def likeliest(self, pull: NDArray, variance: NDArray) -> TreeNoise:
        """Return the noise that residuals ask for, of effects that are known as well as that.

        What poses share stays as it is: an effect that made up for it would be told by all of them.
        """
        own, there = self.linear.J[self._columns], variance > 0.0
        linear = replace(self.linear, r=self.linear.r + pull @ own, J=own[there])
        shared = self.noise.alike
        loose = self.seen.unread_in(self._groups.poses)
        evidence = NoiseEvidence(self.seen, linear, self._groups, loose, 1.0 / variance[there])
        return likeliest_noise(evidence.beside(shared), self.noise.own).sharing(shared)

    def errors(self, step: NDArray, rows: NDArray) -> NDArray:
        """Return errors of some rows that count, after a step [m or px, of the first sensor]."""
        missed = self.linear.r + step @ self.linear.J[self._columns]
        return (lengths(self.seen, missed)[self.rows] * self.size)[rows]
