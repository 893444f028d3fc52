"""One linear fit of a rigid arm and some effects, each held near zero as the data themselves ask.

Evidence (MacKay 1992): the numbers w of one effect share the prior variance v; with the covariance
C of the fit, gamma = sum(1 - C_kk / v) of them are told by the data, and v = |w|^2 / gamma. What no
data tell falls to zero by itself. Where an effect shall stay uncertain instead, it has seen a part
a of one number more, which is as large as the noise hides, v0, with the probability p that the
effect is there, and else nothing: v = (|w|^2 + a p v0) / (gamma + a), the mode under an inverse
gamma prior. The noise is what the residuals ask for beside effects that scatter by
v (restricted likelihood). Fits are compared by their evidence, with H what the rigid parameters
leave of an effect's columns,

    -2 log Z = log|S| + r' S^-1 r + w' w / v + log|I + v H| + log N

so that an effect whose numbers nothing tells costs one number, v. Counting its numbers as others
(BIC) keeps couplings from real arms that gain a tenth by them, and ripples from simulated ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.bendable import Bendable, Posture, Weighed
from nico_selfmodel.estimation.noise.arm_solution import Priors
from nico_selfmodel.estimation.results.folds import fold_of, splits

DOUBT = 0.5
"""Numbers more that each effect has in a body that bends."""
_ROUNDS = 30
_SIZES = (1.0, 1e-3)
"""Variances at which an effect begins, as parts of that at which it is as large as the noise."""
_GONE = 1e-3
"""Numbers told by the data below which an effect is not there."""
_LEAST = 1e-12
_ALIKE = 0.05
"""Relative difference of variances below which two answers are one."""
_Told = tuple[NDArray, dict[str, float]]
"""Step and variances."""


@dataclass(frozen=True, eq=False)
class EffectFit:
    """Rigid parameters and effects, fitted about an arm in one step."""

    parameters: Posture
    """What it is about; its `bending` has the effects."""
    free: tuple[str, ...]
    """Names of the columns."""
    step: NDArray
    """Change of each. Shape (k,)."""
    groups: Mapping[str, tuple[str, ...]]
    """Names of the numbers that share a variance, by effect."""
    means: Mapping[str, float]
    """Values at which numbers have no effect, where they are not 0."""
    variance: Mapping[str, float]
    """Prior variance of each effect's numbers; 0 where the data tell none of it."""
    known: frozenset[str]
    """Effects of which it was known beforehand."""
    shares: Mapping[str, float]
    """Prior variance of a number, as a multiple of its effect's, where it is another."""
    spread: NDArray
    """Covariance of the effects' numbers, group by group. Shape (e, e)."""
    noise: Any
    """Of sensors and joints, the effects taken off."""
    evidence: float
    """-2 log evidence but for a constant: smaller is better."""
    left_out: NDArray
    """Error of each row that counts, predicted without its fold of poses [m or px]. Shape (K,)."""
    pose: NDArray
    """Pose of each of them. Shape (K,)."""

    @property
    def values(self) -> NDArray:
        """All parameters after the step."""
        out = np.array(self.parameters.values)
        for name, change in zip(self.free, self.step.tolist(), strict=True):
            out[self.parameters.names.index(name)] += change
        return out

    def sigma_of(self, weights: Mapping[str, float]) -> float:
        """Return the standard deviation of a weighted sum of the effects' numbers."""
        names = [name for group in self.groups.values() for name in group]
        w = np.array([weights.get(name, 0.0) for name in names])
        return float(np.sqrt(w @ self.spread @ w))

    @property
    def priors(self) -> Priors:
        """Mean and standard deviation of each number of an effect."""
        return {
            name: (self.means.get(name, 0.0), max(float(np.sqrt(v)), _LEAST))
            for name, v in self.variances.items()
        }

    @property
    def variances(self) -> Mapping[str, float]:
        """Prior variance of each number."""
        return {
            name: self.variance[effect] * self.shares.get(name, 1.0)
            for effect, names in self.groups.items()
            for name in names
        }


@dataclass(frozen=True, eq=False)
class Beforehand:
    """What is known of effects without data."""

    means: Mapping[str, float]
    """Values at which numbers have no effect, where they are not 0."""
    variance: Mapping[str, float]
    """Prior variances of effects of which it is known; it costs no information."""
    shares: Mapping[str, float]
    """Prior variance of a number, as a multiple of its effect's, where it is another."""
    doubt: float = 0.0
    """Numbers more that each effect is thought to have; above 0 none falls to zero."""
    probable: Mapping[str, float] = field(default_factory=dict)
    """Probability that an effect is there, where it is not certain."""


def fit_effects(
    body: Bendable,
    parameters: Posture,
    groups: Mapping[str, tuple[str, ...]],
    beforehand: Beforehand,
    begin: Mapping[str, float],
    noise: Any,
) -> EffectFit:
    """Fit in one step, with evidence variances and the noise that is left.

    Args:
        body: What was measured, and what is rigid in it.
        parameters: The body; its `bending` has all effects of `groups`.
        groups: Names of the numbers that share a variance, by effect.
        beforehand: What is known of them without data.
        begin: Variances at which the search begins, where an effect was fitted before; the others
            begin large and small, for two effects that look alike have two answers.
        noise: Where the search for it begins.
    """
    wanted = set(body.free).union(*groups.values())
    free = tuple(n for n in parameters.names if n in wanted)
    member = {e: np.array([free.index(n) for n in names], dtype=int) for e, names in groups.items()}
    index = {name: i for i, name in enumerate(parameters.names)}
    now = parameters.values[[index[n] for n in free]]
    means, known = beforehand.means, beforehand.variance
    start = now - np.array([means.get(n, 0.0) for n in free])
    share = np.array([beforehand.shares.get(n, 1.0) for n in free])
    task = _Task(free, member, start, share, beforehand)
    weighed = body.weighed(parameters, free, noise)
    fits = []
    for told in task.starts(weighed, begin):
        found = task.fitted(weighed, *told)
        about = parameters, free, found[0], groups, means, found[1], frozenset(known)
        fits.append(EffectFit(*about, beforehand.shares, *found[2:], weighed.pose))
    return min(fits, key=lambda fit: fit.evidence)


@dataclass(frozen=True, eq=False)
class _Task:
    free: tuple[str, ...]
    member: Mapping[str, NDArray]
    start: NDArray
    """What each column's number is now, above the value at which it has no effect. Shape (k,)."""
    share: NDArray
    """Prior variance of each column's number, as a multiple of its effect's. Shape (k,)."""
    beforehand: Beforehand

    @property
    def known(self) -> Mapping[str, float]:
        """Variances that are not learned."""
        return self.beforehand.variance

    def starts(self, weighed: Weighed, begin: Mapping[str, float]) -> list[_Told]:
        """Return the answers, by evidence, of effects that begin large and small; one if alike."""
        new = set(self.member) - set(self.known) - set(begin)
        sums = _Sums.of(weighed)
        large, *small = (
            self.by_evidence(sums, begin, size) for size in (_SIZES if new else _SIZES[:1])
        )
        others = [
            told
            for told in small
            if any(abs(told[1][e] - v) > _ALIKE * v for e, v in large[1].items())
        ]
        return [large, *others]

    def fitted(
        self, weighed: Weighed, step: NDArray, variance: dict[str, float]
    ) -> tuple[NDArray, dict[str, float], NDArray, Any, float, NDArray]:
        """Return step, variances, spread, noise, evidence and the errors of rows left out."""
        pull, spread_of = np.zeros(len(self.free)), np.full(len(self.free), np.inf)
        for effect, own in self.member.items():
            pull[own], spread_of[own] = -self.start[own], variance[effect] * self.share[own]
        noise = weighed.likeliest(pull, spread_of)
        weighed = weighed.with_noise(noise)
        sums = _Sums.of(weighed)
        step, variance = self.by_evidence(sums, variance, _SIZES[1])
        left = weighed.u - weighed.U @ step
        deviance = weighed.log_determinant + float(left @ left)
        asked = sum(effect not in self.known for effect in self.member)
        reduced = sums.reduced(self.member, self.share)
        cost = self.occam(reduced, step, variance) + asked * np.log(weighed.coordinates)
        spread = reduced.solve(self.start, variance)[0]
        unseen = self.without_folds(weighed, sums, variance)
        return step, variance, spread, noise, deviance + cost, unseen

    def by_evidence(self, sums: "_Sums", begin: Mapping[str, float], size: float) -> _Told:
        """Return the step and the variances."""
        reduced = sums.reduced(self.member, self.share)
        hidden = {e: sums.hidden(own) for e, own in self.member.items()}
        doubt, probable = self.beforehand.doubt, self.beforehand.probable
        found = {e: begin.get(e, 0.0) or size * v for e, v in hidden.items()} | dict(self.known)
        for _ in range(_ROUNDS):
            C, w = reduced.solve(self.start, found)
            before = dict(found)
            for effect, own in reduced.member.items():
                v = found[effect]
                if v <= 0.0:
                    continue
                if effect in self.known:
                    continue
                share = self.share[self.member[effect]]
                told = float(np.sum(1.0 - np.diag(C)[own] / (v * share)))
                total = self.start[self.member[effect]] + w[own]
                more = doubt * probable.get(effect, 1.0) * hidden[effect]
                size = float(np.sum(total**2 / share)) + more
                found[effect] = size / (told + doubt) if told + doubt > _GONE else 0.0
            if all(abs(found[e] - v) <= 1e-3 * v for e, v in before.items()):
                break
        return reduced.whole(reduced.solve(self.start, found)[1]), found

    def occam(self, reduced: "_Reduced", step: NDArray, variance: Mapping[str, float]) -> float:
        """Return what the effects cost: w'V^-1 w + log|I + V H|, H what the rest leaves of them.

        An effect whose numbers nothing tells costs nothing; one that is told, the logarithm of how
        much better it is told than known beforehand.
        """
        there = [own for effect, own in self.member.items() if variance[effect] > 0.0]
        if not there:
            return 0.0
        own = np.concatenate(there)
        v = np.concatenate(
            [variance[e] * self.share[m] for e, m in self.member.items() if variance[e] > 0.0]
        )
        places = np.concatenate([p for e, p in reduced.member.items() if variance[e] > 0.0])
        root = np.sqrt(v)
        inside = reduced.S[np.ix_(places, places)] * np.outer(root, root)
        cost = float(np.linalg.slogdet(np.eye(len(own)) + inside)[1])
        total = (self.start + step)[own]
        return cost + float(np.sum(total**2 / v))

    def without_folds(
        self, weighed: Weighed, sums: "_Sums", variance: Mapping[str, float]
    ) -> NDArray:
        """Return errors of rows that count, each predicted without its fold of poses. (K,)."""
        U, u, fold = weighed.U, weighed.u, fold_of(weighed.pose)
        of_coordinate = np.where(weighed.row < 0, -1, fold[weighed.row])
        errors = np.zeros(len(fold))
        for k, (_, left) in enumerate(splits(fold)):
            out = of_coordinate == k
            reduced = sums.without(U[out], u[out]).reduced(self.member, self.share)
            step = reduced.whole(reduced.solve(self.start, variance)[1])
            errors[left] = weighed.errors(step, left)
        return errors


@dataclass(frozen=True, eq=False)
class _Sums:
    """Normal equations of all columns."""

    H: NDArray
    """U'U. Shape (k, k)."""
    g: NDArray
    """U'u. Shape (k,)."""
    count: int
    """Rows of U."""

    @classmethod
    def of(cls, weighed: Weighed) -> "_Sums":
        return cls(weighed.U.T @ weighed.U, weighed.U.T @ weighed.u, len(weighed.u))

    def without(self, U: NDArray, u: NDArray) -> "_Sums":
        """Return those of the other rows."""
        return _Sums(self.H - U.T @ U, self.g - U.T @ u, self.count - len(u))

    def reduced(self, member: Mapping[str, NDArray], share: NDArray) -> "_Reduced":
        """Return those of the effects alone."""
        return _Reduced.of(self.H, self.g, member, share)

    def hidden(self, own: NDArray) -> float:
        """Return the variance at which an effect would be as large as the noise, 0 if none."""
        told = float(np.trace(self.H[np.ix_(own, own)]))
        return self.count / told if told > _LEAST * self.count else 0.0


@dataclass(frozen=True, eq=False)
class _Reduced:
    """Normal equations of the effects alone, what the rigid parameters would do taken out."""

    rigid: NDArray
    """Columns of the rigid parameters. Shape (r,)."""
    effects: NDArray
    """Columns of the effects. Shape (e,)."""
    member: Mapping[str, NDArray]
    """Where each effect's numbers are among those of the effects."""
    share: NDArray
    """Prior variance of each number, as a multiple of its effect's. Shape (e,)."""
    S: NDArray
    """H_ee - H_er H_rr^-1 H_re. Shape (e, e)."""
    s: NDArray
    """g_e - H_er H_rr^-1 g_r. Shape (e,)."""
    gain: NDArray
    """H_rr^-1 H_re. Shape (r, e)."""
    alone: NDArray
    """H_rr^-1 g_r. Shape (r,)."""

    @classmethod
    def of(
        cls, H: NDArray, g: NDArray, member: Mapping[str, NDArray], share: NDArray
    ) -> "_Reduced":
        effects = np.concatenate([np.zeros(0, dtype=int), *member.values()])
        rigid = np.delete(np.arange(len(g)), effects)
        A = H[np.ix_(rigid, rigid)]
        size = np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
        units = np.outer(size, size)
        inverse = np.linalg.pinv(A / units, rcond=1e-11, hermitian=True) / units
        across = H[np.ix_(rigid, effects)]
        gain, alone = inverse @ across, inverse @ g[rigid]
        ends = np.cumsum([0, *(len(own) for own in member.values())])
        places = {e: np.arange(a, b) for e, a, b in zip(member, ends[:-1], ends[1:], strict=True)}
        S, s = H[np.ix_(effects, effects)] - across.T @ gain, g[effects] - across.T @ alone
        return cls(rigid, effects, places, share[effects], S, s, gain, alone)

    def solve(self, start: NDArray, variance: Mapping[str, float]) -> tuple[NDArray, NDArray]:
        """Return covariance and step of the effects; those that are gone go back to nothing.

        Args:
            start: What each column's number is now, above no effect. Shape (r + e,).
            variance: Of each effect's numbers; 0 where it is gone.
        """
        now = start[self.effects]
        v = np.concatenate([variance[e] * self.share[p] for e, p in self.member.items()] or [now])
        there = v > 0.0
        step, C = np.where(there, 0.0, -now), np.zeros_like(self.S)
        if there.any():
            root = np.sqrt(v[there])
            inside = self.S[np.ix_(there, there)] * np.outer(root, root) + np.eye(len(root))
            own = np.linalg.inv(inside) * np.outer(root, root)
            right = (self.s - self.S @ step)[there] - now[there] / v[there]
            C[np.ix_(there, there)], step[there] = own, own @ right
        return C, step

    def whole(self, step: NDArray) -> NDArray:
        """Return the step of all columns from that of the effects. Shape (r + e,)."""
        out = np.zeros(len(self.rigid) + len(self.effects))
        out[self.effects], out[self.rigid] = step, self.alone - self.gain @ step
        return out
