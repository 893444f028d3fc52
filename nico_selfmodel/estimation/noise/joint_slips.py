"""Which joints were read wrongly in which poses, and which are read worse than others in all.

With P = S^-1 - S^-1 J C J' S^-1 and the residuals r of all that counts, what any change h of them
does to half the sum of squares is known without solving again (Cook, Weisberg 1982).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.pose_noise import PoseWhitening
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
_LOUDER_BY = 5.0
"""Gain of a log likelihood from which on joints are louder in all visits, and do not slip."""
_QUIETER, _ABOUT = (0.5, 0.65, 0.8, 1.0), (0.7, 1.0, 1.4)
"""What joint noise may be of what it was taken for where some joints are louder, and what theirs
may be of what visits say of it."""


@dataclass(frozen=True, eq=False)
class Slips:
    """What residuals say of the joints' readings."""

    slipped: NDArray
    """Which joint was read wrongly at each visit, if any. Boolean, shape (visits, m)."""
    part: float | None = None
    """The likeliest joint noise, as a part of what it was taken for; None where no joint slips
    often."""
    louder: frozenset[int] = frozenset()
    """Joints that are read with more noise at each visit than those they were taken for alike.
    Nothing is said of slips before their noise is known."""


def slipped_joints(
    whitening: PoseWhitening,
    r: NDArray,
    J: NDArray,
    prior: NDArray,
    loudest: NDArray | None = None,
) -> Slips:
    """Return which joint, if any, was read wrongly at each visit, and what that says of the noise.

    A joint that slips often is found by all visits together: one tells as little of a slip as of
    which joint it was. Slips that were not known for such are a part of the noise: quieter joints
    are tried as well. What any joint does once stands out by `SLIPPED_AT`.

    Args:
        whitening: Of the poses, no joint freed.
        r: Residuals in their sensors' sigmas. Shape (R,).
        J: Derivatives by the free parameters. Shape (R, p).
        prior: Information of the priors on their diagonal. Shape (p,).
        loudest: Standard deviations up to which a joint may have noise of its own, 0 where it may
            not, as all if omitted. Shape (m,).
    """
    groups = whitening.groups
    X = np.column_stack([groups.gather(r[:, None]), groups.gather(J[:, None])])
    asked = partial(_Scores.at, whitening, _VisitSums.of(whitening, X), prior)
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
    else:
        often = _refitted(asked, often)
    if often.slipped.any() and loudest is not None:
        likelihood, louder = _louder_joints(asked, plain, whitening.noise.joint_sigma, loudest)
        if louder and likelihood > often.likelihood + _LOUDER_BY:
            return Slips(np.zeros_like(often.slipped), louder=louder)
    out = often.slipped
    t = asked(1.0, out).odd if out.any() else plain.t
    visits = np.flatnonzero(~out.any(axis=1))
    worst = np.argmax(t[visits], axis=1)
    out[visits, worst] = t[visits, worst] > SLIPPED_AT
    return Slips(out, often.part)


def _refitted(asked: Callable[[float, NDArray], "_Scores"], often: "_Often") -> "_Often":
    """Return joints that slip often as fits tell that do not take these visits for sound.

    What a large slip puts into the parameters, other visits pay for, as if all were loud.
    """
    for _ in range(_FITS):
        found = _likeliest([asked(part, often.slipped) for part in _PARTS])[0]
        if found.likelihood <= often.likelihood:
            break
        often = found
    return often


def _louder_joints(
    asked: Callable[[NDArray, None], "_Scores"],
    plain: "_Scores",
    sigma: NDArray,
    loudest: NDArray,
) -> tuple[float, frozenset[int]]:
    """Return joints that are louder than the others, and how likely all is then."""
    scores, factor, chosen = plain, np.ones(len(sigma)), frozenset[int]()
    while True:
        alike = ~np.isin(np.arange(len(sigma)), [*chosen])
        found = scores.louder(np.where(alike, loudest, 0.0))
        if found is None:
            break
        j, size = found
        tries = []
        for part, about in product(_QUIETER, _ABOUT):
            tried = np.where(alike, part * factor, factor)
            tried[j] = about * np.hypot(size, sigma[j]) / sigma[j]
            tries.append((asked(tried, None), tried))
        best, at = max(tries, key=lambda one: one[0].likelihood)
        if best.likelihood < scores.likelihood + OFTEN_AT:
            break
        scores, factor, chosen = best, at, chosen | {j}
    return scores.likelihood, chosen


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
        found = tries[best][min(count, len(tries[best]) - 1)]
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
class _VisitSums:
    """What rows X and derivatives A by the joints' errors tell at any joint noise D.

    A' S^-1 = (I + A'A D^2)^-1 A' and X' S^-1 X = X'X - X'A D^2 A' S^-1 X: where visits have more
    rows than joints they are summed once.
    """

    X: NDArray
    """By visit, in their sensors' sigmas. Shape (T, k)."""
    total: NDArray
    """X'X of all visits. Shape (k, k)."""
    across: NDArray
    """A'X, then A'A. Shape (visits, m, k + m)."""

    @classmethod
    def of(cls, whitening: PoseWhitening, X: NDArray) -> "_VisitSums":
        """Sum rows by visit. Shape (T, k)."""
        A = whitening.lever
        return cls(X, X.T @ X, whitening.groups.products(A, np.column_stack([X, A])))

    def whitened(self, whitening: PoseWhitening) -> tuple[NDArray, NDArray, NDArray]:
        """Return A' S^-1 X and A' S^-1 A of each visit, and X' S^-1 X of all."""
        m, k = self.across.shape[1], len(self.total)
        if len(self.X) < m * len(self.across):
            solved = whitening.inverse(np.column_stack([self.X, whitening.lever]))
            both = whitening.groups.products(whitening.lever, solved)
            return both[:, :, :k], both[:, :, k:], self.X.T @ solved[:, :k]
        variance = whitening.joint_sigma**2
        told = np.eye(m) + self.across[:, :, k:] * variance[:, None, :]
        both = np.linalg.solve(told, self.across)
        lost = self.across[:, :, :k] * variance[:, :, None]
        inner = self.total - lost.reshape(-1, k).T @ both[:, :, :k].reshape(-1, k)
        return both[:, :, :k], both[:, :, k:], 0.5 * (inner + inner.T)


@dataclass(frozen=True, eq=False)
class _Scores:
    """What each visit says of each joint, read wrongly by anything."""

    t: NDArray
    """About chi square of one freedom where nothing is off. Shape (visits, m)."""
    c: NDArray
    """Information of a visit on the joint's reading. Shape (visits, m)."""
    likelihood: float
    """Restricted log likelihood without slips, but for a constant."""
    odd: NDArray
    """As `t`, of what a visit alone says against all others. Shape (visits, m)."""

    @classmethod
    def at(
        cls,
        whitening: PoseWhitening,
        sums: "_VisitSums",
        prior: NDArray,
        part: float | NDArray,
        slipped: NDArray | None,
    ) -> "_Scores":
        """Ask at some noise.

        A reading that is off by d moves the residuals by a d, a = A_j: e = a'P r, c = a'S^-1 a, and
        (e^2 + a'S^-1 J C J'S^-1 a) / c is about chi square of one freedom where nothing is off; in
        a visit of which the fit took nothing of the joint e^2 / (c + a'S^-1 J C J'S^-1 a) is.

        Args:
            whitening: Of the poses, no joint freed.
            sums: Of residuals and their derivatives by the free parameters.
            prior: Information of the priors on their diagonal. Shape (p,).
            part: What joint noise is of what it is there, of all or of each. Shape (m,).
            slipped: Joints that are free in a visit, as the parameters are fitted. Boolean, shape
                (visits, m).
        """
        whitening = whitening if np.all(part == 1.0) else whitening.quieter(part)
        by_joint, of_joint, inner = sums.whitened(whitening)
        fitted = inner
        if slipped is not None:
            fitted = sums.whitened(whitening.quieter(1.0, slipped))[2]
        C = covariance_told_by(fitted[1:, 1:] + np.diag(prior))
        fit = np.append(1.0, -C @ fitted[1:, 0])
        e = by_joint @ fit
        # Beside noise that is far too large rounding leaves less than nothing.
        c = np.maximum(np.einsum("gmm->gm", of_joint), 0.0)
        along = by_joint[:, :, 1:]
        taken = np.sum((along @ C) * along, axis=2)
        told = np.maximum(c, _TOLD)
        t = np.where(c < _TOLD, 0.0, (e**2 + taken) / told)
        odd = t
        if slipped is not None:
            alone = np.any(slipped, axis=1, keepdims=True) & (c >= _TOLD)
            t, odd = np.where(alone, e**2 / told, t), np.where(alone, e**2 / (told + taken), t)
        left = float(fit @ inner @ fit)
        determinants = whitening.log_determinant - np.linalg.slogdet(C)[1]
        return cls(t, c, -0.5 * (left + float(determinants)), odd)

    def louder(self, loudest: NDArray) -> tuple[int, float] | None:
        """Return the joint of which more noise at all visits explains most, and how much it is.

        Args:
            loudest: Standard deviations up to which it may have noise of its own. Shape (m,).
        """
        best, most = None, OFTEN_AT
        for j in np.flatnonzero((loudest > 0.0) & (self.c > _TOLD).any(axis=0)).tolist():
            B, middle = _of_sizes(self.t[:, j], self.c[:, j])
            gains = np.sum(B, axis=1)
            size = int(np.argmax(gains))
            if gains[size] > most and _SIZES[size] <= loudest[j] ** 2 * middle:
                best, most = (j, float(np.sqrt(_SIZES[size] / middle))), float(gains[size])
        return best

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
            at = {j: (t[left, j], c[left, j], self.odd[left, j]) for j in np.flatnonzero(asked)}
            of = {int(j): _mixture(*one) for j, one in at.items()}
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


def gain_of_slips(t: NDArray, c: NDArray) -> float:
    """Return the gain of the log likelihood if any of some joints slips now and then, one a visit.

    Args:
        t: As in `_Scores`. Shape (visits, j).
        c: Shape (visits, j).
    """
    return float(_by_share(_of_sizes(t, c)[0]).max())


def gain_of_errors(e: NDArray, information: NDArray, visit: NDArray) -> float:
    """Return the gain if an observation is now and then far off, one of a visit, any way alike.

    Off by N(0, d^2 I), of information M = (S^-1)_oo and with e = (S^-1 r)_o, it is
    exp(e'(M + I / d^2)^-1 e / 2) / |I + d^2 M|^(1/2) times as likely as without.

    Args:
        e: Along the eigenvectors of M. Shape (N, k).
        information: Eigenvalues of M, 0 of what is not there. Shape (N, k).
        visit: Of each observation. Shape (N,).
    """
    size = _SIZES[:, None, None]
    x = size * information
    B = np.sum(0.5 * size * e**2 / (1.0 + x) - 0.5 * np.log1p(x), axis=2)
    of, counts = np.unique(visit, return_inverse=True, return_counts=True)[1:]
    out = np.full((len(counts), len(B)), -np.inf)
    np.logaddexp.at(out, of, B.T)
    return float(_by_share(out.T - np.log(counts)).max())


def _of_sizes(t: NDArray, c: NDArray) -> tuple[NDArray, float]:
    """Return log B of each size and visit, and what a visit in the middle tells of a joint.

    Of several joints, shape (visits, j), one slips at a time, each as often: B is their mean.
    """
    told = c > _TOLD
    middle = float(np.median(c[told])) if told.any() else 1.0
    x = _SIZES.reshape(-1, *(1,) * c.ndim) * c / middle
    B = 0.5 * t * x / (1.0 + x) - 0.5 * np.log1p(x)
    return (B if c.ndim == 1 else np.logaddexp.reduce(B, axis=2) - np.log(c.shape[1])), middle


def _by_share(B: NDArray) -> NDArray:
    """Return gains of the log likelihood by share and size of slips. (sizes, visits) -> (p, s)."""
    p = _SHARES[:, None, None]
    return np.sum(np.logaddexp(np.log1p(-p), np.log(p) + B), axis=2)


def _mixture(t: NDArray, c: NDArray, odd: NDArray) -> tuple[float, NDArray]:
    """Return the gain of the log likelihood by slips of one joint, and each visit's log odds."""
    gain = _by_share(_of_sizes(t, c)[0])
    share, size = np.unravel_index(int(np.argmax(gain)), gain.shape)
    odds = np.log(_SHARES[share] / (1.0 - _SHARES[share])) + _of_sizes(odd, c)[0][size]
    return float(gain[share, size]), odds
