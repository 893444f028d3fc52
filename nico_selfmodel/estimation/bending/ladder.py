"""Which effects an arm keeps: a ladder, each step only where poses that were left out gain.

Backlash, sag, bearing sag, ripple, gears, coupling, in this order. A step stays if twice the log
evidence rises by more than 10, and if the mean over poses of log(error before / error after), each
pose predicted without its fold, is above 1 % and above its standard error. All at once over-fits
small sets; evidence alone finds couplings in rigid arms; squared errors miss the swept arm.
Poses count that are no outliers for sure: the most bent ones look like outliers. Whatever sags, its
loads are free about those of uniform rods: held, they bias what is told of unseen poses by more
than its sigma; as a step of their own they seldom gain enough.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.bending.asked_poses import (
    FEWEST_POSES,
    certain_outliers,
    mean_by_pose,
    thinned,
    verticals,
)
from nico_selfmodel.estimation.bending.effect_fit import EffectFit, fit_effects
from nico_selfmodel.estimation.bending.implausible import (
    GEAR,
    LIFTS,
    NO_GEAR,
    gear_fault,
    implausible,
    lifts,
)
from nico_selfmodel.estimation.noise.arm_solution import ArmSolution
from nico_selfmodel.estimation.noise.pose_refinement import refine_by_pose
from nico_selfmodel.estimation.observations.observations import Observations, gears_known
from nico_selfmodel.model.arm.bending import (
    BACKLASH,
    BEARING,
    COUPLING,
    LOADS,
    PARTS,
    RIPPLE,
    SAG,
    Bending,
)
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.uniform_rods import uniform_rods

STEPS = (BACKLASH, SAG, BEARING, RIPPLE, GEAR, COUPLING)
"""What is asked, in this order; backlash where the data say from which side joints came, gears that
a unit tells and nobody holds. Backlash is first: where it is, its scatter looks like much else."""
_WORTH = 10.0
"""By how much twice the log evidence must rise."""
_GAIN = 0.01
"""Mean logarithm of the errors' ratio that unseen poses must gain."""
_GEARS_DO = "gears that are a little off explain it better"
_PASSES = 2
"""Times that what went is tried: another effect may have hidden it."""
_SURE = (8.0, 40.0)
"""Robust standard deviations of a rigid arm beyond which its outliers are left out: both are tried
where they differ, for the most bent poses look like outliers, and outliers like bends."""
_LOADS = 0.2
"""Standard deviation of a load's coordinate about that of uniform rods, as a part of their rms:
motors and shells are no rods."""


@dataclass(frozen=True)
class Step:
    """One effect, and what became of it."""

    effect: str
    """Its name, of `STEPS`."""
    kept: bool
    """Whether it stayed."""
    before_mm: float
    """Geometric mean over poses of the error of unseen poses without it."""
    after_mm: float
    """The same with it."""
    gain: float
    """Mean over poses of log(before / after)."""
    gain_sigma: float
    """Its standard error."""
    worth: float
    """By how much twice the log evidence rose."""
    reason: str
    """Why it went; empty where it stayed."""


@dataclass(frozen=True, eq=False)
class Ladder:
    """What was asked of an arm, and the arm that came of it."""

    steps: tuple[Step, ...]
    """In the order of trial; none where the data are too few."""
    solution: ArmSolution
    """The arm with what it keeps; the rigid one where it keeps nothing, or may keep nothing."""
    bent: DhParameters | None = None
    """The arm as the last step that stayed left it, whether it may be kept or not."""
    adopted: bool = False
    """Whether the solution has what stayed."""
    unseen_mm: tuple[float, float] = (np.nan, np.nan)
    """Geometric means over poses of the errors of unseen poses, rigid and with what stayed."""
    wanted: tuple[str, ...] = ()
    """Effects that the user asked for by name."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the effects that stayed."""
        return tuple(step.effect for step in self.steps if step.kept)


def climb(
    observations: Observations,
    solved: ArmSolution,
    effects: Sequence[str] | None = STEPS,
    up: NDArray | None = None,
    *,
    held: frozenset[str] = frozenset(),
    trim: bool = True,
    seed: int = 0,
) -> Ladder:
    """Ask a rigid arm which effects its unseen poses gain from.

    Args:
        observations: What was measured.
        solved: The rigid arm.
        effects: What is asked for; of an empty one everything is, and the arm stays rigid all the
            same. Nothing if None.
        up: Unit vertical in W, shape (3,); where it is not known the first axis and those of W are
            tried.
        held: Parameters that the user holds.
        trim: Look for outliers again at the end.
        seed: Of the poses that are asked where there are many.
    """
    wanted = () if effects is None or tuple(effects) == STEPS else tuple(effects)
    if effects is None or solved.noise is None or not _enough(observations, solved):
        return Ladder((), solved, wanted=wanted)
    aside = {sure: certain_outliers(observations, solved, sure) for sure in _SURE}
    found = []
    for without in np.unique(np.stack([*aside.values()]), axis=0):
        few = thinned(observations, solved, without, seed)
        climber = _Climber(*few, held, up)
        steps = climber.pruned(climber.climb(effects or STEPS))
        solution = solved
        if climber.kept and effects:
            solution = climber.solution(observations, without, trim)
        bent = climber.parameters if climber.kept else None
        adopted = bool(effects and climber.kept)
        found.append(Ladder(steps, solution, bent, adopted, climber.unseen_mm))
    best = min(found, key=lambda ladder: _log_error(observations, ladder))
    if not _is_better(best, solved, observations):
        best = _left_rigid(best, solved)
    return replace(best, wanted=wanted)


def _is_better(ladder: Ladder, rigid: ArmSolution, observations: Observations) -> bool:
    """Whether an arm, once solved with what stayed, is one, and nearer to its poses."""
    if not ladder.adopted:
        return True
    if np.any(ladder.solution.parameters.servos.gear <= 0.0):
        return False
    return _log_error(observations, ladder) < _log_error(observations, Ladder((), rigid))


def _left_rigid(ladder: Ladder, rigid: ArmSolution) -> Ladder:
    """Return what was tried, none of it kept."""
    why = "solved together, the arm is no better"
    steps = (replace(s, kept=False, reason=why) if s.kept else s for s in ladder.steps)
    return Ladder(tuple(steps), rigid, None, False, ladder.unseen_mm)


def _log_error(observations: Observations, ladder: Ladder) -> float:
    """Return the mean over poses of log(error), outliers included, of the arm that bends."""
    parameters = ladder.solution.parameters
    if not ladder.adopted and ladder.bent is not None:
        parameters = ladder.bent
    p = parameters.points(observations.angles, observations.marker, observations.approach)
    errors = np.linalg.norm(p - observations.p_WH, axis=1)
    return float(np.log(mean_by_pose(errors, observations.pose)).mean())


def _enough(observations: Observations, solved: ArmSolution) -> bool:
    poses = len(np.unique(observations.pose))
    return poses >= FEWEST_POSES and 3 * len(observations) >= 2 * len(solved.free)


class _Climber:
    """A ladder under way."""

    def __init__(
        self,
        observations: Observations,
        solved: ArmSolution,
        keep: NDArray,
        held: frozenset[str],
        up: NDArray | None,
    ) -> None:
        assert solved.noise is not None
        ups = ((up, True),) if up is not None else verticals(solved.parameters)
        self.observations, self.rigid, self.keep, self.ups = observations, solved, keep, ups
        self.kept: tuple[str, ...] = ()
        joints = observations.joints
        known = gears_known(observations.units)
        side = observations.approach
        self.sides = bool(((side < 0.0).any(axis=0) & (side > 0.0).any(axis=0)).any())
        names = (f"{joint}.gear" for joint, k in zip(joints, known, strict=True) if k)
        self.gears = tuple(name for name in names if name not in held | solved.free)
        loads, pivots = uniform_rods(solved.parameters.table)
        self.still = Bending.none(joints, ups[0][0], loads, pivots)
        weighty = self.still.with_effects(LOADS)
        self.rods = dict(zip(weighty.names, weighty.values.tolist(), strict=True))
        self.load_variance = (_LOADS * float(np.sqrt(np.mean(np.sum(loads**2, axis=1))))) ** 2
        self.parameters, self.noise = solved.parameters, solved.noise
        self.first: EffectFit | None = None
        self.fit: EffectFit | None = None

    def climb(self, asked: Sequence[str]) -> list[Step]:
        """Try one effect after the other, and again those that others may have hidden.

        A gear that contradicts its unit is a fault, no bend.
        """
        steps: dict[str, Step] = {}
        for _ in range(_PASSES):
            before = self.kept
            for effect in STEPS:
                if effect not in asked or effect in self.kept:
                    continue
                if (effect == GEAR and not self.gears) or (effect == BACKLASH and not self.sides):
                    continue
                steps[effect] = self.try_step(effect)
                if steps[effect].reason.startswith(NO_GEAR):
                    self.kept = ()
                    why = steps[effect].reason
                    return [replace(step, kept=False, reason=why) for step in steps.values()]
            if self.kept == before:
                break
        return list(steps.values())

    def try_step(self, effect: str) -> Step:
        """Try an effect; keep it if unseen poses gain."""
        if self.first is None:
            self.first = self._fitted((), self.still)
        before = self.first if self.fit is None else self.fit
        wanted = (*self.kept, effect)
        if effect == SAG and BEARING not in self.kept:
            candidates = [self._fitted(wanted, self._about(up)) for up, _ in self.ups]
            best = int(np.argmin([fit.evidence for fit in candidates]))
            after, (up, certain) = candidates[best], self.ups[best]
            if not certain and lifts(after):
                after = self._fitted(wanted, self._about(-up))
        else:
            after = self._fitted(wanted, self.still)
        step = self._judged(effect, before, after)
        if step.reason == LIFTS and SAG in self.kept:
            # What stayed as sag was this.
            wanted = tuple(other for other in wanted if other != SAG)
            after = self._fitted(wanted, self.still)
            step = self._judged(effect, before, after)
        if effect == RIPPLE and step.kept and self.gears and GEAR not in self.kept:
            # Over a part of a turn a ripple looks like a gear, of which there are fewer numbers.
            rival = self._again(self._fitted((*self.kept, GEAR), self.still))
            if rival.evidence < self._again(after).evidence:
                step = replace(step, kept=False, reason=gear_fault(rival) or _GEARS_DO)
        if step.kept:
            assert after.parameters.bending is not None
            self.kept = wanted
            self._adopt(after)
        return step

    @property
    def unseen_mm(self) -> tuple[float, float]:
        """Geometric means over poses of the errors of unseen poses: rigid, and now."""
        first = self.first or self._fitted((), self.still)
        pose = self.observations.pose[self.keep]
        fits = (first, self.fit or first)
        errors = (mean_by_pose(fit.left_out, pose) for fit in fits)
        one, two = (1e3 * float(np.exp(np.log(e).mean())) for e in errors)
        return one, two

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

    def _about(self, up: NDArray) -> Bending:
        return replace(self.still, up=up)

    def _fitted(self, effects: tuple[str, ...], bending: Bending) -> EffectFit:
        """Return the fit of some effects about the arm so far."""
        known = {LOADS: self.load_variance} if {SAG, BEARING} & set(effects) else {}
        effects = (*effects, *known)
        bending = bending.with_effects(*(effect for effect in effects if effect in PARTS))
        parameters = replace(self.parameters, bending=bending)
        groups = {e: bending.names_of(e) if e in PARTS else self.gears for e in effects}
        means = dict.fromkeys(self.gears, 1.0) | self.rods
        return fit_effects(
            self.observations,
            parameters,
            self.rigid.free,
            groups,
            means,
            known,
            {} if self.fit is None else self.fit.variance,
            self.keep,
            self.noise,
        )

    def _again(self, fit: EffectFit) -> EffectFit:
        """Return the same fit about where it ended: one step of a large effect is not enough."""
        parameters = fit.parameters.with_values(fit.values)
        known = {LOADS: self.load_variance} if LOADS in fit.groups else {}
        return fit_effects(
            self.observations,
            parameters,
            self.rigid.free,
            fit.groups,
            fit.means,
            known,
            fit.variance,
            self.keep,
            fit.noise,
        )

    def _judged(self, effect: str, before: EffectFit, after: EffectFit) -> Step:
        pose = self.observations.pose[self.keep]
        one, two = (mean_by_pose(fit.left_out, pose) for fit in (before, after))
        gains = np.log(one / two)
        gain = float(gains.mean())
        sigma = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        worth = before.evidence - after.evidence
        reason = self._reason(effect, after, gain, sigma, worth)
        means = [float(1e3 * np.exp(np.log(errors).mean())) for errors in (one, two)]
        return Step(effect, not reason, means[0], means[1], gain, sigma, worth, reason)

    def _reason(
        self, effect: str, after: EffectFit, gain: float, sigma: float, worth: float
    ) -> str:
        if worth <= _WORTH:
            return "the data do not tell it"
        if gain <= _GAIN or gain <= sigma:
            return "unseen poses do not gain"
        return implausible(after, self.observations)

    def _adopt(self, fit: EffectFit) -> None:
        """Go on about the arm that bends: one more step of the same fit."""
        self.parameters, self.noise = fit.parameters.with_values(fit.values), fit.noise
        assert self.parameters.bending is not None
        self.still = self.parameters.bending
        self.fit = fit  # where the next search for its variances begins
        self.fit = self._fitted(self.kept, self.still)

    def solution(self, observations: Observations, outliers: NDArray, trim: bool) -> ArmSolution:
        """Return the arm with what it keeps, outliers of all observations looked for anew."""
        fit = self.fit
        assert fit is not None
        start = fit.parameters.with_values(fit.values)
        solved = refine_by_pose(
            observations,
            start,
            frozenset(fit.free),
            outliers,
            fit.noise.sensor_sigma,
            trim=trim,
            priors=fit.priors,
            noise=fit.noise,
        )
        bending = solved.parameters.bending
        assert bending is not None
        bent = bending if bending.effects else None
        return replace(
            solved,
            parameters=replace(solved.parameters, turn=None, bending=bent),
            iterations=solved.iterations + self.rigid.iterations,
            converged=solved.converged and self.rigid.converged,
        )
