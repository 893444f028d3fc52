"""Tests at a solution: which joint slipped in which pose, which observation nothing explains.

With P = S^-1 - S^-1 J C J' S^-1 and the residuals r of all that counts, what any change h of them
does to half the sum of squares is known without solving again (Cook, Weisberg 1982).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ContradictedError
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import FREE_SIGMA, PoseWhitening
from nico_selfmodel.estimation.tree.forward.tree_linear import TreeLinear
from nico_selfmodel.estimation.tree.tree_noise import beside_shared, tree_whitening
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_solution import TreeNoise
from nico_selfmodel.optimization.chi_square import as_rare_as
from nico_selfmodel.optimization.robust_solve import OUTLIER_AT
from nico_selfmodel.optimization.uncertainty import covariance_told_by

SLIPPED_AT = 12.0
"""Chi square of one freedom beyond which a joint was read wrongly in a pose: 5 in 10^4 are."""

OFTEN_AT = 6.0
"""Gain of a log likelihood from which on a joint slips often."""
FEWEST_SLIPS = 3
"""Poses with a wrong reading of one joint from which on it slips often."""
HINTED_AT = 0.2
"""Gain at the noise as it is below which no other is tried."""
TRIED_AT = 2.0
"""Gain from which on a joint may: the parameters are fitted as if it did, which tells."""
_FITS = 3
_TOLD = 1e-9
"""Information below which a visit tells nothing of a joint."""
_ENOUGH_TOLD = 10
"""Visits that tell of a joint, or half of all, from which on it is asked whether it slips often."""
_PARTS = (0.5, 0.65, 0.8, 0.9, 1.0, 1.1, 1.25)
"""What joint noise may be of what it was taken for before it was known which joint slips."""
_SHARES = np.array([0.02, 0.05, 0.1, 0.2, 0.35])
"""Parts of the poses in which a joint may slip."""
_SIZES = np.array([3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4])
"""Squares of what it may slip by, in variances that a pose in the middle tells it to."""


def tested(
    data: TreeObservations,
    linear: TreeLinear,
    groups: PoseGroups,
    noise: TreeNoise,
    prior: NDArray,
    outliers: NDArray,
) -> tuple[NDArray, NDArray, float | None]:
    """Return which joints slipped and which observations are outliers, beside what poses share.

    Args:
        data: What was measured.
        linear: Residuals, and their derivatives by what is estimated.
        groups: What belongs to one pose.
        noise: What disturbs the recording.
        prior: Information of the priors on their diagonal. Shape (p,).
        outliers: Those that do not count, by row of the table. Boolean, shape (N,).

    Returns:
        See `slipped_joints` and `far_observations`, and what joint noise is then as a part of what
        it is there, as `slipped_joints` has it.
    """
    own = noise.own
    linear, prior = beside_shared(data, linear, prior, noise.alike)
    scale = own.sensor[data.noise_group]
    r, J = linear.r / scale, (linear.J / scale).T
    found, part = slipped_joints(tree_whitening(data, linear, groups, own), r, J, prior)
    found &= ~data.unread
    far = far_observations(
        *(data, tree_whitening(data, linear, groups, own, found), r, J, prior, outliers),
        by_joint=linear.by_joint / scale[:, None],
        sigma=own.joint,
        slipped=found,
        took=linear.took,
    )
    return found, far, part


def slipped_joints(
    whitening: PoseWhitening, r: NDArray, J: NDArray, prior: NDArray
) -> tuple[NDArray, float | None]:
    """Return which joint, if any, was read wrongly at each visit, and what that says of the noise.

    A joint that slips often is found by all visits together: one tells as little of a slip as of
    which joint it was. Slips that were not known for such are a part of the noise: quieter joints
    are tried as well. What any joint does once stands out by `SLIPPED_AT`.

    Args:
        whitening: Of the poses, no joint freed.
        r: Residuals in their sensors' sigmas. Shape (R,).
        J: Derivatives by the free parameters. Shape (R, p).
        prior: Information of the priors on their diagonal. Shape (p,).

    Returns:
        Boolean, shape (visits, m), and the likeliest joint noise as a part of what it is there;
        None where no joint slips often.
    """
    groups = whitening.groups
    gathered = groups.gather(r[:, None]), groups.gather(J[:, None])
    asked = partial(_Scores.at, whitening, *gathered, prior)
    plain = asked(1.0, None)
    often, before = plain.often_slipped()[0], plain.likelihood
    if often.likelihood > before + HINTED_AT:
        parts = (plain if part == 1.0 else asked(part, None) for part in _PARTS)
        often, before = _likeliest(list(parts))
    for _ in range(_FITS):
        if not (before + TRIED_AT < often.likelihood < before + OFTEN_AT):
            break
        # What a fit of all visits as sound leaves of a slip is less than the slip.
        often = _likeliest([asked(part, often.slipped) for part in _PARTS])[0]
    seldom = often.slipped.sum() < FEWEST_SLIPS
    if seldom or often.likelihood < before + OFTEN_AT:
        often = _Often(before, np.zeros_like(often.slipped), None)
    out, t = often.slipped, plain.t
    visits = np.flatnonzero(~out.any(axis=1))
    worst = np.argmax(t[visits], axis=1)
    out[visits, worst] = t[visits, worst] > SLIPPED_AT
    return out, often.part


@dataclass(frozen=True, eq=False)
class _Often:
    """Joints that slip often."""

    likelihood: float
    """Of all visits."""
    slipped: NDArray
    """Visits in which they did. Boolean, shape (visits, m)."""
    part: float | None
    """What joint noise is then of what it was taken for; None where that was not asked."""


def _likeliest(scores: Sequence["_Scores"]) -> tuple[_Often, float]:
    """Return the joints that slip often, as many as each raise the likelihood, and that of none.

    One is returned in any case.
    """
    tries = [one.often_slipped() for one in scores]
    found = max(tries, key=lambda one: one[0].likelihood)[0]
    for count in range(1, max(map(len, tries))):
        of = [one[min(count, len(one) - 1)].likelihood for one in tries]
        best = int(np.argmax(of))
        if of[best] < found.likelihood + OFTEN_AT:
            break
        found = tries[best][count]
    count = int(found.slipped.any(axis=0).sum())
    curve = [one[min(count, len(one)) - 1].likelihood for one in tries]
    part = _peak(np.log(_PARTS), np.array(curve))
    return replace(found, part=part), max(one.likelihood for one in scores)


def _peak(x: NDArray, y: NDArray) -> float:
    """Return where a curve is highest, by a parabola through its highest values: exp(x) of it."""
    i = int(np.clip(np.argmax(y), 1, len(x) - 2))
    a, b, _ = np.polyfit(x[i - 1 : i + 2], y[i - 1 : i + 2], 2)
    at = -0.5 * b / a if a < 0.0 else x[np.argmax(y)]
    return float(np.exp(np.clip(at, x[0], x[-1])))


@dataclass(frozen=True, eq=False)
class _Scores:
    """What each visit says of each joint, read wrongly by anything."""

    t: NDArray
    """About chi square of one freedom where nothing is off. Shape (visits, m)."""
    c: NDArray
    """Information of a visit on the joint's reading. Shape (visits, m)."""
    likelihood: float
    """Restricted log likelihood without slips, but for a constant."""

    @classmethod
    def at(
        cls,
        whitening: PoseWhitening,
        r: NDArray,
        Jg: NDArray,
        prior: NDArray,
        part: float,
        slipped: NDArray | None,
    ) -> "_Scores":
        """Ask at some noise.

        A reading that is off by d moves the residuals by a d, a = A_j: e = a'P r, c = a'S^-1 a, and
        (e^2 + a'S^-1 J C J'S^-1 a) / c is about chi square of one freedom where nothing is off.

        Args:
            whitening: Of the poses, no joint freed.
            r: Residuals in their sensors' sigmas, by visit. Shape (T,).
            Jg: Derivatives by the free parameters. Shape (T, p).
            prior: Information of the priors on their diagonal. Shape (p,).
            part: What joint noise is of what it is there.
            slipped: Joints that are free in a visit, as the parameters are fitted. Boolean, shape
                (visits, m).
        """
        whitening = whitening if part == 1.0 else whitening.quieter(part)
        fitted = whitening if slipped is None else whitening.quieter(1.0, slipped)
        groups, A, SiJ = whitening.groups, whitening.lever, fitted.inverse(Jg)
        C = covariance_told_by(Jg.T @ SiJ + np.diag(prior))
        rows = (r - Jg @ (C @ (SiJ.T @ r)))[:, None]
        SiA = whitening.inverse(A)
        e = groups.products(SiA, rows)[:, :, 0]
        c = np.einsum("gmm->gm", groups.products(SiA, A))
        along = groups.products(SiA, Jg)
        taken = np.sum((along @ C) * along, axis=2)
        t = np.where(c < _TOLD, 0.0, (e**2 + taken) / np.maximum(c, _TOLD))
        left = float(np.sum(rows * whitening.inverse(rows)))
        determinants = whitening.log_determinant - np.linalg.slogdet(C)[1]
        return cls(t, c, -0.5 * (left + float(determinants)))

    def often_slipped(self) -> list[_Often]:
        """Return joints that slip often, one, two and so on, as long as each raises the likelihood.

        Where a joint slips in a share p of the visits by N(0, d^2), a visit is 1 - p + p B times as
        likely as without, B = exp(t x / (1 + x) / 2) / sqrt(1 + x) with x = d^2 c. The joint of
        which the logarithms' sum is largest, at its best p and d, goes first; visits that it
        explains (odds above one) tell of no other.
        """
        t, c, found = self.t, self.c, self.likelihood
        out, left = np.zeros(t.shape, dtype=bool), np.ones(len(t), dtype=bool)
        told, tries = (c > _TOLD).sum(axis=0), list[_Often]()
        asked = told >= min(_ENOUGH_TOLD, 0.5 * len(t))
        while left.any() and asked.any():
            of = {j: _mixture(t[left, j], c[left, j]) for j in np.flatnonzero(asked).tolist()}
            j = max(of, key=lambda one: of[one][0])
            gain, odds = of[j]
            if tries and gain < OFTEN_AT:
                break
            here = np.flatnonzero(left)[odds > 0.0]
            out = out.copy()
            out[here, j], asked[j], left[here] = True, False, False
            found += gain
            tries.append(_Often(found, out, None))
        return tries or [_Often(found, out, None)]


def _mixture(t: NDArray, c: NDArray) -> tuple[float, NDArray]:
    """Return the gain of the log likelihood by slips of one joint, and each visit's log odds."""
    told = c > _TOLD
    x = _SIZES[:, None] * c / (np.median(c[told]) if told.any() else 1.0)
    B = 0.5 * t * x / (1.0 + x) - 0.5 * np.log1p(x)
    p = _SHARES[:, None, None]
    gain = np.sum(np.logaddexp(np.log1p(-p), np.log(p) + B), axis=2)
    share, size = np.unravel_index(int(np.argmax(gain)), gain.shape)
    odds = np.log(_SHARES[share] / (1.0 - _SHARES[share])) + B[size]
    return float(gain[share, size]), odds


def far_observations(
    observations: TreeObservations,
    whitening: PoseWhitening,
    r: NDArray,
    J: NDArray,
    prior: NDArray,
    outliers: NDArray,
    *,
    by_joint: NDArray,
    sigma: NDArray,
    slipped: NDArray,
    took: NDArray | None = None,
) -> NDArray:
    """Return observations that neither the body nor the rest of their pose explains.

    For those that count e'P_oo^-1 e with e = (P r)_o; for the others r_o'V^-1 r_o, what the rest of
    their pose tells of its joints taken off. Of several in one visit only the worst is new: it may
    have drawn the others along.

    Args:
        observations: What was measured.
        whitening: Of the observations that count.
        r: Residuals in their sensors' sigmas. Shape (R,).
        J: Derivatives by the free parameters. Shape (R, p).
        prior: Information of the priors on their diagonal. Shape (p,).
        outliers: Those that do not count, by row of the table. Shape (N,).
        by_joint: Derivatives by the joints' errors, in the sensors' sigmas. Shape (R, m).
        sigma: Standard deviations of these errors. Shape (m,).
        slipped: What was read wrongly at each visit. Boolean, shape (visits, m).
        took: See `TreeLinear`.

    Returns:
        Boolean, by row of the table. Shape (N,).
    """
    ratio = np.zeros(len(outliers))
    groups = whitening.groups
    Jg = groups.gather(J[:, None])
    C = _covariance(whitening, Jg, prior)
    both = np.column_stack([groups.gather(r[:, None]), Jg])
    solved = groups.scatter(whitening.inverse(both))[:, 0]
    shift, spread = whitening.joint_errors(-r[:, None])
    visit = groups.of(np.ones(len(r), dtype=bool))
    loose = np.vstack([slipped, np.zeros((1, slipped.shape[1]), dtype=bool)]) | observations.unread
    by_joint = by_joint * np.where(loose[visit], FREE_SIGMA, sigma)
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


def _covariance(whitening: PoseWhitening, Jg: NDArray, prior: NDArray) -> NDArray:
    """Return C of the free parameters, what nothing tells as good as unknown. (p, p)."""
    return covariance_told_by(Jg.T @ whitening.inverse(Jg) + np.diag(prior))


def _squares(matrix: NDArray, e: NDArray) -> NDArray:
    return np.sum(e * np.linalg.solve(matrix, e[:, :, None])[:, :, 0], axis=1)


def regrouped(slipped: NDArray, old: PoseGroups, new: PoseGroups) -> NDArray:
    """Return what slipped by the visits that still count. (visits, m) of the old and the new."""
    out = np.zeros((new.poses, slipped.shape[1]), dtype=bool)
    _, a, b = np.intersect1d(old.numbers, new.numbers, return_indices=True)
    out[b] = slipped[a]
    return out


def check_that_some_agree(
    groups: PoseGroups, observations: TreeObservations, outliers: NDArray
) -> None:
    """Refuse to go on with nothing.

    Args:
        groups: What still counts.
        observations: What was measured.
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
