"""Why an arm does not explain its data: what the residuals would be if the readings were mended.

Each suspicion mends the readings in one way and searches again from random axes. What then explains
the data is named. Nothing of it goes into the result: the data are the user's to correct.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.exchanged_distances import exchanged_by_distance
from nico_selfmodel.estimation.diagnosis.suspected_readings import (
    LateReadings,
    Suspicion,
    Worth,
    suspicions_of,
    with_starts,
)
from nico_selfmodel.estimation.initialization.start_search import (
    ASTRAY,
    ENOUGH_AGREE,
    LineSolution,
    StartSearch,
    distances_between,
    few_rows,
    left_by,
    refine_lines,
)
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.results.verdict import MOST_OUTLIERS
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.model.arm.line_kinematics import CarriedLines
from nico_selfmodel.optimization.losses import Loss, robust_scale

_MOST_STARTS = 500
"""Starts that the search may cost in all."""
_BETTER = 3.0
"""The residuals must fall to this part of what they were, inverse."""
_EXPLAINED = 0.02
"""... and below this share of the workspace."""
_FEWER_OUTLIERS = 0.5
"""Or, at the same residuals, outliers to this share."""
_WORTH_A_LOOK, _WORTH_A_SEARCH = 0.01, 0.025
"""Residuals over the workspace's size above which readings that leave out a gap are looked at, and
above which all causes are."""
_MANY_OUTLIERS = 0.1
"""... as above this share of outliers, in readings that left out a gap; above `MOST_OUTLIERS`, all
causes are looked for."""
_EXPLAINED_BESIDE = 0.1
"""Share of the residuals' squares that a little of neighbours' readings must explain for it to be
asked whether these are exchanged or sums of each other: of readings that are, it explains 0.35 of
what arms leave and more, of noise 0.03."""
_RIGID = 0.02
"""Scatter of a distance over the workspace's size above which two markers are not on one link."""
_NORMAL_THIRD = 2.3219
"""Standard deviation over the deviation that a third of normal values lie within."""
_AGREE = "then the starts agree"
_UNIT_HINTS = ((180.0 / np.pi, "rad stated as deg"), (np.pi / 180.0, "deg stated as rad"))


@dataclass(frozen=True)
class Causes:
    """What a search for the cause of a misfit came to."""

    words: tuple[str, ...] = ()
    """What would make the data fit, a sentence each."""
    stopped_after: int | None = None
    """Starts after which the search gave up; None where it tried all it knows."""
    late: LateReadings | None = None
    """What is of another sample, where that is what would."""
    left: str = ""
    """What remains then, in words."""


def causes_of_misfit(
    observations: Observations,
    search: StartSearch,
    gear_pinned: NDArray,
    gear_known: NDArray,
    zero: NDArray,
    sigma: float,
    loss: str,
    scatter: float,
    beside: Sequence[Suspicion] = (),
) -> Causes:
    """Name what would make the data fit, where they do not.

    Args:
        observations: What was measured.
        search: The best arm, and how many starts reached it.
        gear_pinned: Gears that are held. Shape (n,).
        gear_known: Joints said to be read in rad or deg. Shape (n,).
        zero: Encoder angles of the zero configuration [rad]. Shape (n,).
        sigma: Whitening of the residuals [m].
        loss: One of `optimization.robust_solve.ROBUST_METHODS`.
        scatter: Of an inlier coordinate about the refined arm, whatever is said to explain it [m].
        beside: What may be wrong besides, of an arm that is part of a body; asked last.

    Returns:
        What was found; empty where the arm explains the data or nothing tried does.
    """
    before = _Misfit.of(search.best, sigma)
    unexplained = max(before.noise, scatter) / observations.size
    bad = unexplained > _WORTH_A_LOOK or before.wrong > _MANY_OUTLIERS
    lonely = search.agreeing < 2 <= len(search.labels)
    if not bad and not lonely:
        return Causes()
    held, robust = gear_pinned & gear_known, "none" if loss == "none" else "cauchy"
    searched = unexplained > _WORTH_A_SEARCH or before.wrong > MOST_OUTLIERS
    left = _MOST_STARTS + sum(one.starts for one in beside)
    # What a start leaves falls little any more when it is refined.
    worst = before.noise * (1.0 if bad and before.wrong <= _MANY_OUTLIERS else _BETTER)
    worst = min(worst, ASTRAY * observations.size)
    look = unexplained > _WORTH_A_LOOK and (
        searched or neighbours_explain(few_rows(observations, 0), search.best.arm)
    )
    worth = Worth.EVERYTHING if searched else Worth.NEIGHBOURS if look else Worth.GAPS
    suspicions = chain(
        suspicions_of(observations, gear_pinned, held, worth), beside if searched else ()
    )
    for suspicion, drawn in with_starts(suspicions, gear_known, zero, worst):
        mended, pinned, reached = suspicion.few, suspicion.gear_pinned, 0
        if left <= 0:
            return Causes(stopped_after=_MOST_STARTS)
        for start in drawn[:left]:
            left -= 1
            if left_by(start, mended) > worst:
                continue
            found = refine_lines(mended, start, pinned, sigma, robust, rough=True)
            after = _Misfit.of(found, sigma)
            reached += after.explains(before, observations.size, lonely=not bad)
            if reached == (1 if bad else ENOUGH_AGREE):
                gears = suspicion.gears_in_question
                asked = _gears_in_words(observations.joints, found.arm.gear, held) if gears else ""
                rest = f"then {after} remain instead of {before}" if bad else _AGREE
                words = f"{suspicion.words}{asked if bad else ''}; {rest}"
                return Causes((words,), late=suspicion.late, left=rest)
    return Causes()


def neighbours_explain(observations: Observations, arm: ArmEstimate) -> bool:
    """Return whether parts of neighbours' readings explain any of what an arm leaves.

    What two joints turn is a matrix times what is read of them. However far from 1 it is, an arm
    that was fitted without it gains by a little of it: q_i + c q_j.

    Args:
        observations: Some of what was measured.
        arm: As it was fitted.
    """
    chain, q = arm.chain, ((observations.angles - arm.zero) / arm.gear).T
    bases = tangent_basis(chain.directions)
    lines = CarriedLines.at(chain.directions, q, bases, bases)
    d = lines.derivatives(chain.points, chain.p_WH_zero[observations.marker].T)
    own = observations.marker == np.arange(len(chain.markers))[:, None]
    fitted = [d.by_direction, d.by_point, d.by_angle * q, d.by_hand[:, :, None] * own]
    beside = [d.by_angle[:, :-1] * q[1:], d.by_angle[:, 1:] * q[:-1]]
    columns = np.concatenate([part.reshape(3, -1, len(own.T)) for part in fitted + beside], axis=1)
    r = d.p - observations.p_WH.T
    squares = np.sum(r**2, axis=0)
    weight = Loss("cauchy", robust_scale(np.sqrt(squares), 3)).rho_and_weight(squares, 3)[1]
    A = (columns * np.sqrt(weight)).swapaxes(1, 2).reshape(r.size, -1)
    r = (r * np.sqrt(weight)).ravel()
    left = r - A @ np.linalg.lstsq(A, r, rcond=1e-9)[0]
    return bool(left @ left <= (1.0 - _EXPLAINED_BESIDE) * (r @ r))


@dataclass(frozen=True)
class _Misfit:
    """What an arm leaves unexplained."""

    noise: float
    """Standard deviation of an inlier coordinate [m]."""
    wrong: float
    """Share of outliers."""

    @classmethod
    def of(cls, solution: LineSolution, sigma: float) -> "_Misfit":
        """Return what a solution leaves."""
        robust = solution.robust
        return cls(sigma * robust.scale, float(np.mean(robust.outliers)))

    def explains(self, before: "_Misfit", size: float, *, lonely: bool) -> bool:
        """Return whether this is so much less that the readings were to blame."""
        if lonely:
            return self.noise < 1.1 * before.noise
        explained = self.noise < _EXPLAINED * size
        less = self.noise < before.noise / _BETTER
        less = less and self.wrong <= max(_MANY_OUTLIERS, before.wrong)
        fewer = self.noise < 1.5 * before.noise and self.wrong < _FEWER_OUTLIERS * before.wrong
        fewer = fewer and before.wrong > _MANY_OUTLIERS
        return explained and (less or fewer)

    def __str__(self) -> str:
        """Say it in words."""
        outliers = f" and {100.0 * self.wrong:.0f} % outliers" if self.wrong else ""
        return f"{1e3 * self.noise:.3g} mm a coordinate{outliers}"


def foreign_marker(observations: Observations) -> str | None:
    """Say which markers are not on one link: the hand is rigid, their distances must not change.

    Returns:
        A sentence, or None where all distances stay.
    """
    m = len(observations.markers)
    scatter = np.full((m, m), np.nan)
    for (i, j), apart in distances_between(observations).items():
        # Of two points with outliers each, fewer than half of the distances may be sound.
        off = np.abs(apart - np.median(apart))
        scatter[i, j] = scatter[j, i] = _NORMAL_THIRD * np.quantile(off, 1.0 / 3.0)
    loose = scatter > _RIGID * observations.size
    if not loose.any():
        return None
    largest = float(np.nanmax(scatter))
    exchanged = exchanged_by_distance(observations, _RIGID * observations.size)
    if exchanged is not None:
        return exchanged
    # Who is at odds with most others is the stranger; of two nobody can tell.
    odds = loose.sum(axis=1)
    worst = np.flatnonzero(odds == odds.max())
    named = ", ".join(observations.markers[k] for k in worst)
    if len(worst) == 1:
        words, them = f"marker {named} does not move with the hand", "it"
    elif odds.max() > np.median(odds):
        words, them = f"markers {named} do not move with the hand", "them"
    else:
        words, them = f"markers {named} are not on one link", "them"
    return (
        f"{words}: distances between markers scatter by up to {1e3 * largest:.2g} mm, or labels "
        f"are exchanged; leave {them} out, or track markers of the last link only"
    )


def _gears_in_words(joints: tuple[str, ...], gear: NDArray, held: NDArray) -> str:
    listed = ", ".join(f"{joints[i]}.gear {gear[i]:.4g}" for i in np.flatnonzero(held))
    for ratio, words in _UNIT_HINTS:
        if (np.abs(gear[held] * ratio - 1.0) < 0.05).all():
            return f"{listed}, as readings in {words} do: correct encoder_unit"
    frees = " ".join(f"--free {joints[i]}.gear" for i in np.flatnonzero(held))
    return f"{listed}: correct the unit, or add {frees}"
