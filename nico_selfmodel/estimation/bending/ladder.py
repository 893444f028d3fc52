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
)
from nico_selfmodel.estimation.bending.climber import Climber
from nico_selfmodel.estimation.bending.steps import STEPS, Step
from nico_selfmodel.estimation.noise.arm_solution import ArmSolution
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters

_SURE = (8.0, 40.0)
"""Robust standard deviations of a rigid arm beyond which its outliers are left out: both are tried
where they differ, for the most bent poses look like outliers, and outliers like bends."""


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
        climber = Climber(*few, held, up)
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
