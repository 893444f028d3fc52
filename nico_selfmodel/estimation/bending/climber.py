"""One step of the ladder after the other: fit, hold out, judge, keep or leave.

A step stays if twice the log evidence rises by more than 10, and if the mean over poses of
log(error before / error after), each pose predicted without its fold, is above 1 % and above its
standard error.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.asked_poses import mean_by_pose
from nico_selfmodel.estimation.bending.bendable import GEAR, Bendable, Posture
from nico_selfmodel.estimation.bending.effect_fit import (
    DOUBT,
    Beforehand,
    EffectFit,
    Glance,
    fit_effects,
)
from nico_selfmodel.estimation.bending.implausible import (
    FAR_TURNS,
    TURNS,
    farthest_turned,
    gear_fault,
    implausible,
    lifts,
    no_gear,
)
from nico_selfmodel.estimation.bending.steps import HIDDEN, STEPS, Step
from nico_selfmodel.model.arm.bending import (
    BACKLASH,
    BEARING,
    COUPLING,
    LOADS,
    PARTS,
    PIVOTS,
    RIPPLE,
    SAG,
    Bending,
)

_WORTH = 10.0
"""By how much twice the log evidence must rise."""
_GAIN = 0.01
"""Mean logarithm of the errors' ratio that unseen poses must gain."""
_NOTHING = 1.0
"""What an effect of a rigid body explains of twice the log evidence, at the noise of the body
without it, below which it is asked no further: what explains nothing leaves the noise as it is."""
_GEARS_DO = "gears that are a little off explain it better"
_COUPLINGS_DO = "couplings explain it better"
_BEFORE_GEARS = STEPS[: STEPS.index(GEAR)]
"""What is asked before gears, and may take their part."""
_PIVOTS = 1.0
"""Standard deviation of a bearing's place on its axis, as a part of the rms of loads: it may be
anywhere on its link."""


class Climber:
    """A ladder under way."""

    def __init__(self, body: Bendable) -> None:
        """Stand before the first step, at the rigid body."""
        self.body, self.ups = body, body.ups
        self.kept: tuple[str, ...] = ()
        self.besides: tuple[str, ...] = ()
        self.doubt = 0.0
        self.probable: dict[str, float] = {}
        self.gears = body.known_gears
        loads, pivots = body.rods()
        self.still = Bending.none(body.joints, self.ups[0][0], loads, pivots)
        weighty = self.still.with_effects(LOADS, PIVOTS)
        self.rods = dict(zip(weighty.names, weighty.values.tolist(), strict=True))
        rms = float(np.sqrt(np.mean(np.sum(loads**2, axis=1))))
        squares = body.load_sigmas() ** 2
        size = float(squares.mean())
        shares = (squares / max(size, np.finfo(float).tiny)).ravel().tolist()
        self.shares = dict(zip(self.still.names_of(LOADS), shares, strict=True))
        self.known = {LOADS: size, PIVOTS: (_PIVOTS * rms) ** 2}
        self.parameters, self.noise = body.posture, body.noise
        self.first: EffectFit | None = None
        self.fit: EffectFit | None = None
        self.glance: Glance | None = None
        self.too_far = np.inf
        """Least `EffectFit.evidence` of what turned joints too far to be a bend."""

    def climb(self, asked: Sequence[str]) -> list[Step]:
        """Try one effect after the other, and again those that others may have hidden.

        A gear that contradicts its unit is a fault, no bend, and so is what turns joints farther.
        """
        steps: dict[str, Step] = {}
        beside: dict[str, tuple[str, ...]] = {}
        for effect in (*STEPS, *STEPS):
            # What went beside all that is kept now would go again.
            again = effect in self.kept or beside.get(effect) == self.kept
            if effect not in asked or again or not self._may_be(effect):
                continue
            beside[effect] = self.kept
            steps[effect] = self.try_step(effect)
            if steps[effect].gear is not None or steps[effect].reason == FAR_TURNS:
                self.kept = ()
                why = steps[effect].reason
                return [replace(step, kept=False, reason=why) for step in steps.values()]
        return list(steps.values())

    def _may_be(self, effect: str) -> bool:
        """Whether anything in the data could tell an effect."""
        if effect == GEAR:
            return bool(self.gears)
        return effect != BACKLASH or self.body.sides

    def try_step(self, effect: str) -> Step:
        """Try an effect; keep it if unseen poses gain."""
        if self.first is None:
            self.first = self._fitted((), self.still)
        before = self.first if self.fit is None else self.fit
        wanted = (*self.kept, effect)
        if not self.kept and self.body.quieter(before.noise) is None:
            seen = self._at_a_glance(effect, before.noise)
            told = np.log(self._wide(before.noise).weighed.coordinates)
            if before.evidence - seen.evidence + told < _NOTHING:
                return self._judged(effect, before, seen)
        after = self._likeliest(wanted)
        step = self._judged(effect, before, after)
        if step.kept and effect in _BEFORE_GEARS and self.gears and GEAR not in self.kept:
            step = self._or_gears(step, before, after)
        if step.gear is not None and after.evidence > self.too_far:
            step = replace(step, reason=FAR_TURNS, gear=None)
        elif step.gear is not None and self._couplings_do():
            step = replace(step, reason=_COUPLINGS_DO, gear=None)
        if step.reason == TURNS:
            self.too_far = min(self.too_far, after.evidence)
        if step.kept:
            assert after.parameters.bending is not None
            self.kept = wanted
            self._adopt(after)
        return step

    def _or_gears(self, step: Step, before: EffectFit, after: EffectFit) -> Step:
        """Refuse a step where told gears, of which there are fewer numbers, explain it.

        Over a part of a turn sag and ripple look like gears, which are asked next. What looks like
        one that contradicts its unit must be told apart from it; beside gears a little off a
        ripple must be better, and all else not decisively worse.
        """
        rival = self._again(self._fitted((*self.kept, GEAR), self.still))
        better = self._again(after).evidence - rival.evidence
        geared = self._judged(GEAR, before, rival)
        if geared.gear is not None and better > -_WORTH:
            return replace(step, kept=False, reason=geared.reason)
        if geared.kept and better > (0.0 if step.effect == RIPPLE else _WORTH):
            return replace(step, kept=False, reason=_GEARS_DO)
        return step

    def _couplings_do(self) -> bool:
        """Whether coupled drives, of which gears take a part for their own, explain more."""
        wanted = ((*self.kept, effect) for effect in (GEAR, COUPLING))
        geared, coupled = (self._again(self._fitted(one, self.still)) for one in wanted)
        return coupled.evidence < geared.evidence

    @property
    def unseen(self) -> tuple[float, float]:
        """`_typical` errors of unseen poses: rigid, and now."""
        first = self.first or self._fitted((), self.still)
        one, two = (self._typical(fit) for fit in (first, self.fit or first))
        return one, two

    def _typical(self, fit: EffectFit) -> float:
        """Return the geometric mean over poses of the errors of unseen poses [mm or px]."""
        scale = 1e3 if self.body.unit == "mm" else 1.0
        return scale * float(np.exp(np.log(mean_by_pose(fit.left_out, fit.pose)).mean()))

    def pruned(self, steps: list[Step]) -> tuple[Step, ...]:
        """Return the steps, those taken back that what stayed later explains as well."""
        found = []
        for step in steps:
            if step.kept and len(self.kept) > 1 and step.effect != self.kept[-1]:
                assert self.fit is not None
                less = tuple(effect for effect in self.kept if effect != step.effect)
                again = self._judged(step.effect, self._fitted(less, self.still), self.fit)
                if not again.kept or self.fit.variance[step.effect] <= 0.0:
                    self.kept = less
                    self._adopt(self._fitted(less, self.still))
                    step = replace(step, kept=False, reason="what stayed explains it as well")
            found.append(step)
        return tuple(found)

    def _likeliest(self, effects: tuple[str, ...]) -> EffectFit:
        """Return the likeliest fit of some effects, over what may be the vertical if it is new."""
        heavy = {SAG, BEARING}
        new = heavy & set(effects) and not heavy & {*self.kept, *self.besides}
        ups = [up for up, _ in self.ups] if new else [self.still.up]
        found = [self._upright(effects, replace(self.still, up=up)) for up in ups]
        return min(found, key=lambda fit: fit.evidence)

    def _upright(self, effects: tuple[str, ...], bending: Bending) -> EffectFit:
        """Return the fit of some effects, the vertical turned over where that is up for the arm."""
        found = self._fitted(effects, bending)
        told = all(certain for _, certain in self.ups)
        if told or not {SAG, BEARING} & set(effects) or not lifts(found, self.body):
            return found
        gives = {SAG: -bending.sag, BEARING: -bending.bearing_sag}
        return self._fitted(effects, replace(bending, up=-bending.up, **gives))

    def _fitted(self, effects: tuple[str, ...], bending: Bending) -> EffectFit:
        """Return the fit of some effects about the arm so far."""
        begin = {} if self.fit is None else self.fit.variance
        return fit_effects(self.body, *self._question(effects, bending), begin, self.noise)

    def _question(
        self, effects: tuple[str, ...], bending: Bending
    ) -> tuple[Posture, dict[str, tuple[str, ...]], Beforehand]:
        """Return what a fit of some effects is about, their numbers, and what is known of them."""
        known = {LOADS: self.known[LOADS]} if {SAG, BEARING} & set(effects) else {}
        known |= {PIVOTS: self.known[PIVOTS]} if BEARING in effects else {}
        effects = (*effects, *known)
        bending = bending.with_effects(*(effect for effect in effects if effect in PARTS))
        body = self.body
        groups = {e: body.names_of(bending, e) if e in PARTS else self.gears for e in effects}
        means = dict.fromkeys(self.gears, 1.0) | self.rods
        beforehand = Beforehand(means, known, self.shares, self.doubt, self.probable)
        return self.parameters.with_bending(bending), groups, beforehand

    def _at_a_glance(self, effect: str, noise: Any) -> EffectFit:
        """Return the likeliest fit of one effect of a rigid body at its noise."""
        found = []
        for up, _ in self.ups if effect in (SAG, BEARING) else self.ups[:1]:
            question = self._question((effect,), replace(self.still, up=up))
            if up is self.ups[0][0]:
                glance = self._wide(noise)
            else:
                names = [name for group in question[1].values() for name in group]
                glance = Glance.at(self.body, question[0], names, noise)
            found.append(glance.fit(self.body, *question))
        return min(found, key=lambda fit: fit.evidence)

    def _wide(self, noise: Any) -> Glance:
        """Return all effects of a rigid body, weighed once."""
        if self.glance is None:
            told = [effect for effect in PARTS if self._may_be(effect)]
            bending = self.still.with_effects(*told)
            names = [name for effect in told for name in self.body.names_of(bending, effect)]
            parameters = self.parameters.with_bending(bending)
            self.glance = Glance.at(self.body, parameters, [*names, *self.gears], noise)
        return self.glance

    def _again(self, fit: EffectFit) -> EffectFit:
        """Return the same fit about where it ended: one step of a large effect is not enough."""
        parameters = fit.parameters.with_values(fit.values)
        known = {effect: v for effect, v in self.known.items() if effect in fit.groups}
        beforehand = Beforehand(fit.means, known, self.shares)
        return fit_effects(self.body, parameters, fit.groups, beforehand, fit.variance, fit.noise)

    def _judged(self, effect: str, before: EffectFit, after: EffectFit) -> Step:
        gains = self._gains(before, after)
        gain = float(gains.mean())
        sigma = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        worth = before.evidence - after.evidence
        reason = self._reason(effect, after, gain, sigma, worth)
        means = self._typical(before), self._typical(after)
        gear = gear_fault(after)
        gear = None if gear is None or reason != no_gear(gear) else gear
        joint = farthest_turned(after, self.body) if reason == TURNS else ""
        return Step(effect, not reason, *means, gain, sigma, worth, reason, gear, joint)

    def _gains(self, before: EffectFit, after: EffectFit) -> NDArray:
        """Return log(error before / error after) of unseen poses. Shape (P,)."""
        one, two = (mean_by_pose(fit.left_out, fit.pose) for fit in (before, after))
        return np.log(one / two)

    def _reason(
        self, effect: str, after: EffectFit, gain: float, sigma: float, worth: float
    ) -> str:
        if worth <= _WORTH:
            return "the data do not tell it"
        if gain <= _GAIN or gain <= sigma:
            return HIDDEN
        return implausible(after, self.body)

    def _adopt(self, fit: EffectFit) -> None:
        """Go on about the arm that bends: one more step of the same fit."""
        self.parameters, self.noise = fit.parameters.with_values(fit.values), fit.noise
        assert self.parameters.bending is not None
        self.still = self.parameters.bending
        self.fit = fit  # where the next search for its variances begins
        self.fit = self._fitted((*self.kept, *self.besides), self.still)

    def accompany(self, effects: Sequence[str], steps: Sequence[Step]) -> None:
        """Let what is too little to stay by itself be uncertain, in a body that bends at all.

        Held near zero by its evidence, it costs unseen poses nothing; without it joint noise takes
        its place, and what is told of unseen poses is too sure. The odds that it is there are its
        evidence, exp(worth / 2).
        """
        rest = [e for e in effects if e not in self.kept and self._may_be(e)]
        if not self.kept:
            # Of a body that keeps nothing, only a sag that other errors hide.
            rest = [step.effect for step in steps if step.effect == SAG and step.hidden]
            self.fit = self.first
        stiff = [e for e in rest if e not in (SAG, BEARING)]
        self.doubt = DOUBT
        odds = {step.effect: step.worth for step in steps if step.effect in rest}
        self.probable = {e: 0.5 + 0.5 * float(np.tanh(0.25 * w)) for e, w in odds.items()}
        if not rest or self.fit is None or self._beside(rest) or self._beside(stiff):
            return
        self._adopt(self.fit)
        for effect in rest:
            self._beside([*self.besides, effect])

    def _beside(self, effects: Sequence[str]) -> bool:
        """Take some effects beside those that stayed, if unseen poses do not lose by them."""
        assert self.fit is not None
        found = self._likeliest((*self.kept, *effects))
        gains = self._gains(self.fit, found)
        loses = gains.mean() < -gains.std(ddof=1) / np.sqrt(len(gains))
        if loses or implausible(found, self.body):
            return False
        self.besides = tuple(effects)
        self._adopt(found)
        return True

    @property
    def bends(self) -> bool:
        """Whether anything stayed, or goes beside."""
        return bool(self.kept or self.besides)

    def solution(self) -> Any:
        """Return the body with what it keeps, outliers of all observations looked for anew.

        Where most is exact and few poses are wrong, outliers take all noise with them, and what is
        beside would fit the rest: it goes.
        """
        solved = self._solved()
        if self.besides and not self.body.ended(solved):
            self.besides, self.doubt = (), 0.0
            assert self.fit is not None
            self._adopt(self._fitted(self.kept, self.still))
            solved = self._solved()
        return solved

    def _solved(self) -> Any:
        fit = self.fit
        assert fit is not None
        start = fit.parameters.with_values(fit.values)
        return self.body.bent(start, fit.free, fit.priors, fit.noise)
