"""Joints that are read wrongly now and then, and noise that is now and then large.

A joint that slips in more poses than by chance is named: what it does there is a fault. Where it
is likelier that all joints slip alike, it is noise with heavy tails. Parameters are learned beside
each slip, but a reading to come may slip as well: predictions count the variance of all that is
no fault, sigma^2 + p d^2 of slips of N(0, d^2) in a share p of the poses. Where it is likelier
still that sensors are far off now and then, slips say nothing of the joints.

Such a variance rests on few errors that are large. With the score of each pose by its logarithm,
s_v = sigma^2 sum_j ((a_j' P r)^2 - a_j' P a_j) / 2, and the information I = sum_v tr (A' S^-1 A)^2
sigma^4 / 2, the logarithm is known to V = sum s_v^2 / I^2 (White 1982, of any distribution), and
what is to be expected is sigma^2 (1 + V), the mean of an inverse gamma about its mode.
"""

from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.joint_slips import (
    FEWEST_SLIPS,
    SLIPPED_AT,
    gain_of_errors,
    gain_of_slips,
)
from nico_selfmodel.estimation.noise.pose_noise import FREE_SIGMA
from nico_selfmodel.estimation.tree.boards.poses_apart import PosesApart
from nico_selfmodel.estimation.tree.noise.likeliest_noise import likeliest_noise
from nico_selfmodel.estimation.tree.noise.noise_evidence import NoiseEvidence, tree_whitening
from nico_selfmodel.estimation.tree.pose_tests import LOUDEST, far_observations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise, TreeSolution
from nico_selfmodel.optimization.uncertainty import covariance_told_by

_MOST_SLIPS = 0.02
"""Share of poses with a wrong reading of one joint from which on it is named, `FEWEST_SLIPS` at
least."""
_LARGER = 5.0
"""Times usual joint noise that its tails reach."""
_TOLD = 1e-9
"""Information below which a visit tells nothing of a joint."""


def slipping_joints(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return which of `TreeObservations.noisy_joints` slip more than by chance, and than others.

    They are one choice of as many joints, of which none was likelier beforehand.

    Args:
        problem: What was solved.
        solution: Where it ended.

    Returns:
        Boolean, shape (m,).
    """
    seen, slipped = problem.observations, solution.slipped
    read = np.array([part == 0 for _, part in seen.noisy_joints], dtype=bool)
    often = read & (slipped.sum(axis=0) >= max(FEWEST_SLIPS, _MOST_SLIPS * len(slipped)))
    group = seen.joint_groups(solution.noise.loud)
    alike = np.isin(group, group[often]) & ~seen.unread
    if not often.any() or (alike == often).all():
        return often
    errors = _Errors.of(problem, solution, solution.outliers)
    ways = comb(int(alike.sum()), int(often.sum()))
    return often & (errors.gain_of(often) - np.log(ways) >= errors.gain_of(alike))


def noise_to_expect(problem: TreeProblem, solution: TreeSolution) -> TreeNoise:
    """Return what disturbs readings to come: slips that are no fault of a joint are a part of it.

    Args:
        problem: What was solved.
        solution: Where it ended.
    """
    noise, seen, slipped = solution.noise, problem.observations, solution.slipped
    aside = slipped.any() or solution.outliers.any()
    if problem.noise_known or noise.alike or not (aside and solution.variances_known):
        return noise
    off = np.zeros(slipped.shape)
    real = seen.data.visit < len(off)
    if solution.joint_errors is not None:
        np.maximum.at(off, seen.data.visit[real], np.abs(solution.joint_errors[real]))
    # Tails of a joint that is read badly reach beyond `LOUDEST` of what it moved.
    reach = np.maximum(LOUDEST * seen.moved, np.sqrt(SLIPPED_AT) * _LARGER * noise.joint)
    faults = slipped & ((off > reach) | slipping_joints(problem, solution))
    outliers = solution.outliers & _beyond_joint_noise(problem, solution)
    errors = _Errors.of(problem, solution, outliers)
    as_before = (faults == slipped).all() and (outliers == solution.outliers).all()
    if as_before or errors.of_sensors > errors.gain_of(~seen.unread):
        return noise
    sound = replace(solution, slipped=faults, outliers=outliers)
    evidence = problem.evidence_at(sound)
    likeliest = likeliest_noise(evidence, problem.noise)
    joint = likeliest.joint * np.sqrt(1.0 + _doubts(evidence, likeliest))
    return replace(noise, joint=np.maximum(noise.joint, joint))


def _doubts(evidence: NoiseEvidence, noise: TreeNoise) -> NDArray:
    """Return V of each joint's variance, as `likeliest_noise` found it. Shape (m,)."""
    linear, groups, slipped = evidence.linear, evidence.groups, evidence.slipped
    scale = noise.sensor[evidence.data.noise_group]
    S = evidence.whitening(noise)
    X = groups.gather((np.vstack([linear.r, linear.J]) / scale).T[:, None])
    J, solved, A = X[:, 1:], S.inverse(X), S.lever
    C = covariance_told_by(J.T @ solved[:, 1:] + np.diag(evidence.information))
    left = solved[:, :1] - solved[:, 1:] @ (C @ (J.T @ solved[:, :1]))
    told = groups.products(A, S.inverse(A))
    along = groups.products(A, np.column_stack([left, solved[:, 1:]]))
    fitted = np.einsum("vjp,pq,vjq->vj", along[:, :, 1:], C, along[:, :, 1:], optimize=True)
    steady = np.ones(fitted.shape) if slipped is None else 1.0 - slipped
    size = noise.joint * steady
    score = 0.5 * size**2 * (along[:, :, 0] ** 2 - np.einsum("vjj->vj", told) + fitted)
    alike = noise.joint[:, None] == noise.joint
    told = 0.5 * np.einsum("vij,vi,vj,ij->i", told**2, size**2, size**2, alike, optimize=True)
    return np.asarray(np.sum((score @ alike) ** 2, axis=0) / np.maximum(alike @ told, 1e-100) ** 2)


def _beyond_joint_noise(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return observations that joint noise is not large enough for, were it `_LARGER` times so."""
    evidence, noise = problem.evidence_at(solution), problem.noise
    loud, slipped = replace(noise, joint=_LARGER * noise.joint), evidence.slipped
    if slipped is None:
        slipped = np.zeros((evidence.groups.poses, len(loud.joint)), dtype=bool)
    whitening = replace(evidence, slipped=slipped).whitening(loud)
    how = whitening, evidence.linear, loud, evidence.information
    return far_observations(evidence.data, *how, solution.outliers, slipped)


@dataclass(frozen=True, eq=False)
class _Errors:
    """What each visit says of wrong readings of each joint, and of observations far off."""

    t: NDArray
    """Chi square of a joint's slip. Shape (visits, m)."""
    c: NDArray
    """Information of a visit on the joint's reading. Shape (visits, m)."""
    of_sensors: float
    """Gain of the log likelihood if observations are far off now and then."""

    @classmethod
    def of(cls, problem: TreeProblem, solution: TreeSolution, outliers: NDArray) -> "_Errors":
        """Ask what is left at a solution, but for some rows of the table. Shape (N,)."""
        seen, noise = problem.observations, solution.noise.own
        linear, scale = problem.linear_at(solution.values, problem.poses), problem.scale
        linear = PosesApart.of(seen, ~outliers[seen.row]).eliminated(linear, scale)
        scale = noise.sensor[seen.noise_group]
        groups = seen.groups(outliers)
        whitening = tree_whitening(seen, linear, groups, noise)
        A, r = whitening.lever, groups.gather(linear.r[:, None] / scale[:, None])
        SiA, left = whitening.inverse(A), whitening.inverse(r[:, None])
        c = np.einsum("gmm->gm", groups.products(SiA, A))
        e = groups.products(A, left)[:, :, 0]
        t = np.where(c > _TOLD, e**2 / np.maximum(c, _TOLD), 0.0)
        by_row, told = groups.scatter(left)[:, 0, 0], whitening.joint_errors(linear.r[:, None])[1]
        sigma = np.where(seen.unread, FREE_SIGMA, noise.joint)
        B, visit = linear.by_joint / scale[:, None] * sigma, groups.of(seen.row >= 0)
        of, along, information = [], [], []
        for rows in seen.sensors:
            at = rows.first + np.arange(rows.measured.size).reshape(len(rows.rows), -1)
            at = at[~outliers[rows.rows]]
            inside = B[at] @ told[visit[at[:, 0]]] @ np.swapaxes(B[at], 1, 2)
            values, vectors = np.linalg.eigh(np.eye(at.shape[1]) - inside)
            wide = ((0, 0), (0, 6 - at.shape[1]))
            along.append(np.pad(np.einsum("nij,ni->nj", vectors, by_row[at]), wide))
            information.append(np.pad(np.maximum(values, 0.0), wide))
            of.append(visit[at[:, 0]])
        both = np.concatenate(along), np.concatenate(information)
        return cls(t, c, gain_of_errors(*both, np.concatenate(of)))

    def gain_of(self, joints: NDArray) -> float:
        """Return the gain of the log likelihood if some joints slip now and then. (m,)."""
        return gain_of_slips(self.t[:, joints], self.c[:, joints])
