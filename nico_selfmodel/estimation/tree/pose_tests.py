"""Tests at a solution: which joint slipped in which pose, which observation nothing explains.

With P = S^-1 - S^-1 J C J' S^-1 and the residuals r of all that counts, what any change h of them
does to half the sum of squares is known without solving again (Cook, Weisberg 1982).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ContradictedError
from nico_selfmodel.estimation.noise.joint_slips import Slips, slipped_joints
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import FREE_SIGMA, PoseWhitening
from nico_selfmodel.estimation.tree.contradictions.hidden_slips import hidden_slips
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.noise.noise_evidence import beside_shared, tree_whitening
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.optimization.chi_square import as_rare_as
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT
from nico_selfmodel.optimization.uncertainty import covariance_told_by

LOUDEST = 0.01
"""Part of what a joint moved up to which it may be read with noise of its own: beyond it is read
wrongly."""


def tested(
    data: TreeObservations,
    linear: TreeLinear,
    groups: PoseGroups,
    noise: TreeNoise,
    prior: NDArray,
    outliers: NDArray,
) -> tuple[NDArray, Slips]:
    """Return which observations are outliers and which joints slipped, beside what poses share.

    Args:
        linear: Residuals, and their derivatives by what is estimated.
        prior: Information of the priors on their diagonal. Shape (p,).
        outliers: Those that do not count, by row of the table. Boolean, shape (N,).

    Returns:
        See `far_observations` and `slipped_joints`, slips by `TreeObservations.visit`, with those
        that outliers hid; outliers stay where a joint is louder.
    """
    own = noise.own
    linear, prior = beside_shared(data, linear, prior, noise.alike)
    scale = own.sensor[data.noise_group]
    r, J = linear.r / scale, (linear.J / scale).T
    loudest = LOUDEST * data.moved
    loudest[[*noise.loud]] = 0.0
    slips = slipped_joints(tree_whitening(data, linear, groups, own), r, J, prior, loudest)
    by_visit = np.zeros((int(data.visit.max()) + 1, len(own.joint)), dtype=bool)
    if slips.louder:
        return outliers, replace(slips, slipped=by_visit)
    found = slips.slipped & ~data.unread
    by_visit[groups.numbers] = found
    whitening = tree_whitening(data, linear, groups, own, found)
    far = far_observations(data, whitening, linear, own, prior, outliers, found)
    by_joint = linear.by_joint / scale[:, None]
    C = _covariance(whitening, groups.gather(J[:, None]), prior)
    loose = np.where(by_visit[data.visit] | data.unread, FREE_SIGMA, own.joint)
    hidden, far = hidden_slips(data, r, J, C, by_joint * loose, far, _limits(data))
    return far, replace(slips, slipped=by_visit | hidden)


def far_observations(
    observations: TreeObservations,
    whitening: PoseWhitening,
    linear: TreeLinear,
    noise: TreeNoise,
    prior: NDArray,
    outliers: NDArray,
    slipped: NDArray,
) -> NDArray:
    """Return observations that neither the body nor the rest of their pose explains.

    For those that count e'P_oo^-1 e with e = (P r)_o; for the others r_o'V^-1 r_o, what the rest of
    their pose tells of its joints taken off. Of several in one visit only the worst is new: it may
    have drawn the others along.

    Args:
        whitening: Of the observations that count.
        linear: Residuals, and their derivatives by the free parameters.
        noise: What disturbs each pose by itself.
        prior: Information of the priors on their diagonal. Shape (p,).
        outliers: Those that do not count, by row of the table. Shape (N,).
        slipped: What was read wrongly at each visit. Boolean, shape (visits, m).

    Returns:
        Boolean, by row of the table. Shape (N,).
    """
    scale, took = noise.sensor[observations.noise_group], linear.took
    r, J = linear.r / scale, (linear.J / scale).T
    ratio = np.zeros(len(outliers))
    groups = whitening.groups
    Jg = groups.gather(J[:, None])
    C = _covariance(whitening, Jg, prior)
    both = np.column_stack([groups.gather(r[:, None]), Jg])
    solved = groups.scatter(whitening.inverse(both))[:, 0]
    shift, spread = whitening.joint_errors(-r[:, None])
    visit = groups.of(np.ones(len(r), dtype=bool))
    loose = np.vstack([slipped, np.zeros((1, slipped.shape[1]), dtype=bool)]) | observations.unread
    by_joint = linear.by_joint / scale[:, None] * np.where(loose[visit], FREE_SIGMA, noise.joint)
    for rows in observations.sensors:
        k = rows.measured.shape[1]
        at = rows.first + np.arange(rows.measured.size).reshape(-1, k)
        B, G = by_joint[at], spread[visit[at[:, 0]]]
        across = B @ G @ np.swapaxes(B, 1, 2)
        known = outliers[rows.rows]
        distance = np.empty(len(at))
        e, SiJ = solved[at, 0], solved[at, 1:]
        left = np.eye(k) * (1.0 + 1e-3) - across - SiJ @ C @ np.swapaxes(SiJ, 1, 2)
        if took is not None:
            left = left - took[at] @ np.swapaxes(took[at], 1, 2)
        distance[~known] = _squares(left[~known], e[~known])
        rest = r[at] + np.einsum("nkm,nm->nk", B, shift[visit[at[:, 0]]])
        V = np.eye(k) + across + J[at] @ C @ np.swapaxes(J[at], 1, 2)
        distance[known] = _squares(V[known], rest[known])
        ratio[rows.rows] = distance / _limit(k)
    found = ratio > 1.0
    new = np.flatnonzero(found & ~outliers)
    worst = new[np.argsort(-ratio[new], kind="stable")]
    of_row = np.full(len(outliers), -1)
    of_row[observations.row] = observations.sample_visit
    first = np.unique(of_row[worst], return_index=True)[1]
    found[new] = False
    found[worst[first]] = True
    return found


def _limit(k: int) -> float:
    """Return the squared distance of k coordinates that is as rare as `OUTLIER_AT` of three."""
    return as_rare_as(OUTLIER_AT**2, 3, k)


def _limits(data: TreeObservations) -> NDArray:
    """Return `_limit` of each row of the table. Shape (N,)."""
    limits = np.ones(len(data.data.observations))
    for rows in data.sensors:
        limits[rows.rows] = _limit(rows.measured.shape[1])
    return limits


def _covariance(whitening: PoseWhitening, Jg: NDArray, prior: NDArray) -> NDArray:
    """Return C of the free parameters, what nothing tells as good as unknown. (p, p)."""
    return covariance_told_by(Jg.T @ whitening.inverse(Jg) + np.diag(prior))


def _squares(matrix: NDArray, e: NDArray) -> NDArray:
    return np.sum(e * np.linalg.solve(matrix, e[:, :, None])[:, :, 0], axis=1)


def check_that_some_agree(
    groups: PoseGroups, observations: TreeObservations, outliers: NDArray
) -> None:
    """Refuse to go on with nothing.

    Args:
        outliers: What does not count, by row of the table. Boolean, shape (N,).

    Raises:
        ContradictedError: If every observation is an outlier.
    """
    if not len(groups.numbers):
        raise ContradictedError(
            f"all {len(outliers)} observations of data set {observations.data.name!r} contradict "
            "what is known of the body: it is a recording of another one, or its readings, rows "
            "and units do not belong together"
        )
