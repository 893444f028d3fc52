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

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.bendable import Bendable, Posture, Weighed
from nico_selfmodel.estimation.bending.effect_sums import Reduced, Sums
from nico_selfmodel.estimation.noise.arm_solution import Priors
from nico_selfmodel.estimation.results.folds import Fold, cross_validate, fold_of

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
"""Step, of `Weighed.U`'s columns, and variances."""


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
    hold_out: Callable[[], NDArray]
    """Predicts each row that counts without its fold of poses."""
    pose: NDArray
    """Pose of each row that counts. Shape (K,)."""

    @cached_property
    def left_out(self) -> NDArray:
        """Error of each of them, predicted without its fold [m or px]. Shape (K,)."""
        return self.hold_out()

    @property
    def values(self) -> NDArray:
        """All parameters after the step."""
        out = np.array(self.parameters.values)
        place = {name: i for i, name in enumerate(self.parameters.names)}
        out[[place[name] for name in self.free]] += self.step
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
    task = _Task.of(body, parameters, groups, beforehand)
    weighed, quieter = body.weighed(parameters, task.free, noise), body.quieter(noise)
    # A joint that is read worse than others may be so by what the effect explains.
    both = [weighed] if quieter is None else [weighed, weighed.with_noise(quieter)]
    fits = [
        task.at_its_noise(one, *told) for one in both for told in task.starts(Sums.of(one), begin)
    ]
    return task.whole(min(fits, key=lambda fit: fit.evidence))


@dataclass(frozen=True, eq=False)
class Glance:
    """A rigid body and all that may bend in it, weighed once, at the noise of a fit before."""

    weighed: Weighed
    sums: Sums

    @classmethod
    def at(cls, body: Bendable, parameters: Posture, free: Collection[str], noise: Any) -> "Glance":
        """Weigh.

        Args:
            body: What was measured, and what is rigid in it.
            parameters: The body; its `bending` has what may be asked.
            free: Names of all numbers that may be asked.
            noise: Which stays.
        """
        wanted = set(body.free) | set(free)
        names = tuple(name for name in parameters.names if name in wanted)
        weighed = body.weighed(parameters, names, noise)
        return cls(weighed, Sums.of(weighed))

    def fit(
        self,
        body: Bendable,
        parameters: Posture,
        groups: Mapping[str, tuple[str, ...]],
        beforehand: Beforehand,
    ) -> EffectFit:
        """Return what `fit_effects` would where the noise stayed as it is."""
        task = _Task.of(body, parameters, groups, beforehand)
        columns = [self.weighed.free.index(name) for name in task.free]
        sums = self.sums.part([*columns, *range(len(self.weighed.free), len(self.sums.g))])
        reduced, starts = sums.reduced(task.member, task.share), task.starts(sums, {})
        fits = [task.judged(self.weighed, sums, reduced, columns, *told) for told in starts]
        return task.whole(min(fits, key=lambda fit: fit.evidence))


@dataclass(frozen=True, eq=False)
class _Task:
    parameters: Posture
    free: tuple[str, ...]
    groups: Mapping[str, tuple[str, ...]]
    member: Mapping[str, NDArray]
    start: NDArray
    """What each column's number is now, above the value at which it has no effect. Shape (k,)."""
    share: NDArray
    """Prior variance of each column's number, as a multiple of its effect's. Shape (k,)."""
    beforehand: Beforehand

    @classmethod
    def of(
        cls,
        body: Bendable,
        parameters: Posture,
        groups: Mapping[str, tuple[str, ...]],
        beforehand: Beforehand,
    ) -> "_Task":
        wanted = set(body.free).union(*groups.values())
        free = tuple(n for n in parameters.names if n in wanted)
        place = {name: i for i, name in enumerate(free)}
        member = {e: np.array([place[n] for n in names], dtype=int) for e, names in groups.items()}
        index = {name: i for i, name in enumerate(parameters.names)}
        now = parameters.values[[index[n] for n in free]]
        start = now - np.array([beforehand.means.get(n, 0.0) for n in free])
        share = np.array([beforehand.shares.get(n, 1.0) for n in free])
        return cls(parameters, free, groups, member, start, share, beforehand)

    @property
    def known(self) -> Mapping[str, float]:
        """Variances that are not learned."""
        return self.beforehand.variance

    def starts(self, sums: Sums, begin: Mapping[str, float]) -> list[_Told]:
        """Return the answers, by evidence, of effects that begin large and small; one if alike."""
        new = set(self.member) - set(self.known) - set(begin)
        reduced, sizes = sums.reduced(self.member, self.share), _SIZES if new else _SIZES[:1]
        large, *small = (self.by_evidence(sums, reduced, begin, size) for size in sizes)
        others = [
            told
            for told in small
            if any(abs(told[1][e] - v) > _ALIKE * v for e, v in large[1].items())
        ]
        return [large, *others]

    def at_its_noise(
        self, weighed: Weighed, step: NDArray, variance: dict[str, float]
    ) -> "_Judged":
        """Return the fit at the noise that is left."""
        pull, spread_of = np.zeros(len(self.free)), np.full(len(self.free), np.inf)
        for effect, own in self.member.items():
            pull[own], spread_of[own] = -self.start[own], variance[effect] * self.share[own]
        weighed = weighed.with_noise(weighed.likeliest(pull, spread_of))
        sums = Sums.of(weighed)
        reduced = sums.reduced(self.member, self.share)
        told = self.by_evidence(sums, reduced, variance, _SIZES[1])
        return self.judged(weighed, sums, reduced, range(len(self.free)), *told)

    def judged(
        self,
        weighed: Weighed,
        sums: Sums,
        reduced: Reduced,
        columns: Sequence[int],
        step: NDArray,
        variance: dict[str, float],
    ) -> "_Judged":
        """Return a step and variances with their evidence.

        Args:
            weighed: About the body, of all columns there are.
            sums: Of those of this task.
            reduced: Of its effects alone.
            step: Of them.
            variance: Of each effect's numbers.
        """
        deviance = weighed.log_determinant + sums.missed(step)
        asked = sum(effect not in self.known for effect in self.member)
        cost = self.occam(reduced, step, variance)
        cost += asked * np.log(weighed.coordinates)
        return _Judged(weighed, sums, reduced, columns, step, variance, deviance + cost)

    def whole(self, judged: "_Judged") -> EffectFit:
        """Return a fit with all that is told of it."""
        return EffectFit(
            self.parameters,
            self.free,
            judged.step[: len(self.free)],
            self.groups,
            self.beforehand.means,
            judged.variance,
            frozenset(self.known),
            self.beforehand.shares,
            judged.reduced.solve(self.start, judged.variance)[0],
            judged.weighed.noise,
            judged.evidence,
            partial(self.without_folds, judged),
            judged.weighed.pose,
        )

    def by_evidence(
        self, sums: Sums, reduced: Reduced, begin: Mapping[str, float], size: float
    ) -> _Told:
        """Return the step and the variances."""
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

    def occam(self, reduced: Reduced, step: NDArray, variance: Mapping[str, float]) -> float:
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
        total = self.start[own] + step[own]
        return cost + float(np.sum(total**2 / v))

    def without_folds(self, judged: "_Judged") -> NDArray:
        """Return errors of rows that count, each predicted without its fold of poses. (K,)."""
        weighed, columns = judged.weighed, list(judged.columns)

        def learn(part: Fold) -> NDArray:
            reduced = judged.sums.without(part.number).reduced(self.member, self.share)
            whole = reduced.whole(reduced.solve(self.start, judged.variance)[1])
            step = np.zeros(len(weighed.free))
            step[columns] = whole[: len(columns)]
            return step

        return cross_validate(
            fold_of(weighed.pose), learn, lambda step, part: weighed.errors(step, part.left)
        )


@dataclass(frozen=True, eq=False)
class _Judged:
    """A step and variances, with their evidence: see `_Task.judged`."""

    weighed: Weighed
    sums: Sums
    reduced: Reduced
    columns: Sequence[int]
    step: NDArray
    variance: dict[str, float]
    evidence: float
