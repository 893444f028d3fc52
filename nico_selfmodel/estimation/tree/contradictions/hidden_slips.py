"""Joints that were read wrongly in poses of which all that shows it was set aside as outliers.

A reading that is far off puts all that its joint carries far out, and who sets aside what is far
out sees no slip. With V = I + B B' + J C J' the covariance of what a pose shows, outliers and all,
and a what the joint moves, what is left beside the likeliest slip is

    P e,  P = V^-1 - V^-1 a a' V^-1 / a' V^-1 a

and an observation o fits where (P e)_o' P_oo^-1 (P e)_o is as small as of others (Cook, Weisberg
1982).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.misread_joint import misread_joints
from nico_selfmodel.estimation.noise.joint_slips import FEWEST_SLIPS
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations

_FEWEST = 2
"""Outliers of one pose that one slip must explain, in more scalars than `_FEWEST_SCALARS`."""
_FEWEST_SCALARS = 3
_MOST_BESIDE = 0.5
"""Outliers that it leaves, of those that it explains, up to which it is taken for a slip."""
_FEWEST_ALONE = 3
"""Scalars of one pose from which on poses together tell which joint slipped in them."""
_FAR = 50.0
"""Fall of the sum of squares below which nothing was far off."""
_MOVED = 1e-9
"""What a joint moves [sigmas] below which nothing of it is seen."""


@dataclass(frozen=True, eq=False)
class PoseRows:
    """What one pose shows, in the sensors' sigmas."""

    e: NDArray
    """Residuals. Shape (K,)."""
    V: NDArray
    """Their covariance. Shape (K, K)."""
    A: NDArray
    """By the joints' errors. Shape (K, m)."""
    row: NDArray
    """Row of the table of each. Shape (K,)."""

    @cached_property
    def gains(self) -> NDArray:
        """By how much a slip of each joint lowers the sum of squares. Shape (m,)."""
        along = self.A.T @ np.linalg.inv(self.V)
        told = np.einsum("mk,km->m", along, self.A)
        return np.where(told > _MOVED**2, (along @ self.e) ** 2 / np.maximum(told, _MOVED**2), 0.0)


def hidden_slips(
    data: TreeObservations,
    r: NDArray,
    J: NDArray,
    C: NDArray,
    by_joint: NDArray,
    outliers: NDArray,
    limit: NDArray,
) -> tuple[NDArray, NDArray]:
    """Return which joint was read wrongly where that explains outliers, and outliers without these.

    Args:
        data: What was measured.
        r: Residuals in their sensors' sigmas. Shape (R,).
        J: Derivatives by the free parameters. Shape (R, p).
        C: Covariance of these. Shape (p, p).
        by_joint: Derivatives by the joints' errors, in sigmas of both. Shape (R, m).
        outliers: By row of the table. Boolean, shape (N,).
        limit: Squared distance beyond which an observation is one, by row. Shape (N,).

    Returns:
        Joints by `TreeObservations.visit`, boolean, shape (visits, m), and outliers, shape (N,).
    """
    slipped = np.zeros((int(data.visit.max()) + 1, by_joint.shape[1]), dtype=bool)
    left, alone = outliers.copy(), list[tuple[int, PoseRows]]()
    for visit in np.unique(data.visit[outliers[data.row] & ~data.apart]).tolist():
        own = np.flatnonzero(data.visit == visit)
        A, Jv = by_joint[own], J[own]
        V = np.eye(len(own)) + A @ A.T + Jv @ C @ Jv.T
        pose = PoseRows(r[own], V, np.where(data.unread, 0.0, A), data.row[own])
        found = _slip_in(pose, outliers, limit)
        if found is None:
            alone.append((visit, pose))
        else:
            joint, explained = found
            slipped[visit, joint], left[explained] = True, False
    for visit, joint, explained in _often(alone, outliers, limit):
        slipped[visit, joint], left[explained] = True, False
    return slipped, left


def _often(
    poses: list[tuple[int, PoseRows]], outliers: NDArray, limit: NDArray
) -> list[tuple[int, int, NDArray]]:
    """Return visits, the joint that slipped in them all, and the outliers that this explains.

    One marker alone tells no slip from a wrong label; many do, if one joint moves it there.
    """
    own = [outliers[pose.row] for _, pose in poses]
    counts = [int(one.sum()) for one in own]
    k = max(set(counts), key=counts.count, default=0)
    alike = [(v, p, o) for (v, p), o, count in zip(poses, own, counts, strict=True) if count == k]
    if k < _FEWEST_ALONE:
        return []
    e, A, V = (
        np.stack(one)
        for one in zip(*((p.e[o], p.A[o], p.V[np.ix_(o, o)]) for _, p, o in alike), strict=True)
    )
    joints, off = misread_joints(e, A, V)
    if len(joints) != 1:  # what does not tell one joint from another stays set aside
        return []
    told = [one for one, size in zip(alike, off, strict=True) if np.isfinite(size)]
    found = []
    for visit, pose, out in told:
        before = np.unique(pose.row[out])
        if np.isin(before, _fitting(pose, pose.A[:, joints[0]], outliers, limit)).all():
            found.append((visit, joints[0], before))
    return found if len(found) >= FEWEST_SLIPS else []


def _slip_in(pose: PoseRows, outliers: NDArray, limit: NDArray) -> tuple[int, NDArray] | None:
    """Return the joint that slipped in a pose, and the outliers which that explains, if any did."""
    joint = int(np.argmax(pose.gains))
    if pose.gains[joint] <= _FAR:
        return None
    fits = _fitting(pose, pose.A[:, joint], outliers, limit)
    before = np.unique(pose.row[outliers[pose.row]])
    explained = np.intersect1d(before, fits)
    scalars = int(np.isin(pose.row, explained).sum())
    few = len(explained) < _FEWEST or scalars <= _FEWEST_SCALARS
    beside = len(before) - len(explained) > _MOST_BESIDE * len(explained)
    lost = len(np.setdiff1d(pose.row, fits)) > len(before) - len(explained)
    return None if few or beside or lost else (joint, explained)


def _fitting(pose: PoseRows, a: NDArray, outliers: NDArray, limit: NDArray) -> NDArray:
    """Return rows that fit beside a slip along a; the worst is left out until all others do."""
    keep = np.ones(len(pose.e), dtype=bool)
    fewest = int(np.isin(pose.row, np.flatnonzero(~outliers)).sum())
    while keep.sum() > fewest:
        Vi = np.linalg.inv(pose.V[np.ix_(keep, keep)])
        Va = Vi @ a[keep]
        told = a[keep] @ Va
        if told <= _MOVED**2:
            break
        P = Vi - np.outer(Va, Va) / told
        Pe, row = P @ pose.e[keep], pose.row[keep]
        ratio = {
            int(one): _distance(P, Pe, np.flatnonzero(row == one)) / limit[one]
            for one in np.unique(row)
        }
        worst = max(ratio, key=lambda one: ratio[one])
        if ratio[worst] <= 1.0:
            break
        keep &= pose.row != worst
    return np.unique(pose.row[keep])


def _distance(P: NDArray, Pe: NDArray, own: NDArray) -> float:
    """Return (P e)_o' P_oo^-1 (P e)_o of some scalars. Shapes (K, K), (K,) and (k,)."""
    Poo = P[np.ix_(own, own)] + 1e-9 * np.eye(len(own))
    return float(Pe[own] @ np.linalg.solve(Poo, Pe[own]))
