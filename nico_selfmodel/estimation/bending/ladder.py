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
from typing import Any

import numpy as np

from nico_selfmodel.estimation.bending.bendable import Bendable, Posture
from nico_selfmodel.estimation.bending.climber import Climber
from nico_selfmodel.estimation.bending.effect_fit import EffectFit
from nico_selfmodel.estimation.bending.steps import STEPS, Step
from nico_selfmodel.estimation.bending.uncertain_variances import with_uncertain_variances
from nico_selfmodel.estimation.diagnosis.gear_check import DoubtfulGear
from nico_selfmodel.optimization.uncertainty import Uncertainty


@dataclass(frozen=True, eq=False)
class Ladder:
    """What was asked of a body, and what came of it."""

    steps: tuple[Step, ...]
    """In the order of trial; none where the data are too few."""
    solution: Any
    """The body with what it keeps, as its own solver returns it; the rigid one where it keeps
    nothing, or may keep nothing."""
    bent: Any = None
    """Its `Posture` as the last step that stayed left it, whether it may be kept or not."""
    adopted: bool = False
    """Whether the solution has what stayed."""
    unseen: tuple[float, float] = (np.nan, np.nan)
    """Geometric means over poses of the errors of unseen poses, rigid and with what stayed [mm or
    px]."""
    unit: str = "mm"
    """Of errors."""
    fit: EffectFit | None = None
    """Whose variances hold what the solution has; None of a rigid one."""
    wanted: tuple[str, ...] = ()
    """Effects that the user asked for by name."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the effects that stayed."""
        return tuple(step.effect for step in self.steps if step.kept)

    @property
    def gain(self) -> float:
        """Times that unseen poses are met better with what stayed; 1 where nothing did."""
        return self.unseen[0] / self.unseen[1] if self.kept else 1.0

    @property
    def doubtful_gears(self) -> tuple[DoubtfulGear, ...]:
        """The gear that contradicts its unit most, if one does."""
        return tuple(step.gear for step in self.steps if step.gear is not None)[:1]

    def in_doubt(self, known: Uncertainty, posture: Posture) -> Uncertainty:
        """Return the solution's uncertainty, how well its effects' variances are known counted.

        Args:
            known: As if they were known.
            posture: The solution's parameters.
        """
        if self.fit is None:
            return known
        values = dict(zip(posture.names, posture.values.tolist(), strict=True))
        return with_uncertain_variances(known, values, self.fit)


def climb(body: Bendable, effects: Sequence[str] | None = STEPS) -> Ladder:
    """Ask a rigid body which effects its unseen poses gain from.

    Args:
        body: The body at its rigid solution.
        effects: What is asked for; of an empty one everything is, and the body stays rigid all the
            same. Nothing if None.
    """
    wanted = () if effects is None or tuple(effects) == STEPS else tuple(effects)
    if effects is None or not body.enough:
        return Ladder((), body.solution, wanted=wanted)
    climbed = []
    for few in body.few():
        climber = Climber(few)
        steps = climber.pruned(climber.climb(effects or STEPS))
        if effects or climber.kept:
            climber.accompany(effects or STEPS, steps)
        climbed.append((climber, steps))
    if not climbed:  # hardly a pose is no outlier
        return Ladder((), body.solution, wanted=wanted)
    climber, steps = min(climbed, key=lambda one: body.log_errors(one[0].parameters).mean())
    solved = climber.solution() if effects and climber.bends else body.solution
    # What goes beside may go again when all is solved: see `Climber.solution`.
    adopted = bool(effects) and climber.bends
    solution = solved if adopted else body.solution
    bent = climber.parameters if climber.bends else None
    fit = climber.fit if adopted else None
    best = Ladder(steps, solution, bent, adopted, climber.unseen, body.unit, fit)
    if not _is_better(best, body):
        best = _left_rigid(best, body)
    return replace(best, wanted=wanted)


def _is_better(ladder: Ladder, body: Bendable) -> bool:
    """Whether a body, once solved with what stayed, is one, and not farther from its poses.

    That unseen poses gain was seen before. Here only a search that went astray is refused: one
    whose poses are worse by more than the standard error of their mean. What joints turn by noise
    is most of some errors, and a body that fits better need not leave less of it.
    """
    if not ladder.adopted:
        return True
    if np.any(body.posture_of(ladder.solution).gears <= 0.0):
        return False
    solved = body.posture_of(ladder.solution)
    lost = body.log_errors(solved) - body.log_errors(body.posture)
    return bool(lost.mean() <= lost.std(ddof=1) / np.sqrt(len(lost)))


def _left_rigid(ladder: Ladder, body: Bendable) -> Ladder:
    """Return what was tried, none of it kept."""
    why = "solved together, the arm is no better"
    steps = (replace(s, kept=False, reason=why) if s.kept else s for s in ladder.steps)
    return Ladder(tuple(steps), body.solution, unseen=ladder.unseen, unit=ladder.unit)
