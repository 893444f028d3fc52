"""Residuals that depend on the pose: what an arm that bends, or gears off centre, leave.

Noise of joints and tracker takes up what the model lacks, so that its size says nothing; whether
it depends on joint angles, gravity, the other joints or the direction of approach does. An encoder
or a gear that is uneven in places turns its joint by any function of the angle: hats h_k, one every
20 deg, sum_k f_k h_k(q), of which zero, gear and ripple take their part.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.score_test import ArmTest, Score
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters

LARGEST_CHANCE = 1e-5
"""Of a pattern in noise alone; some fifty are looked for."""
_SIMPLER = 7.0
"""Chi square that each further number of a pattern must bring to be named first."""
FEWEST_POSES = 20
"""Poses below which no pattern is looked for."""
MUCH = 1.5
"""Times that the mean residual is smaller with a pattern from which on that is most of it."""
_HAT = np.radians(20.0)
"""From one hat to the next ..."""
_TOUCHED = 1e-3
"""Height of a hat below which no pose is in it."""
_POSES_A_HAT = 5
"""... of which there are so few that each has so many poses."""
FAR = 0.005
"""Share of a body's size, and turn of a joint [rad], from which on such a pattern is a fault."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """Something that residuals depend on."""

    cause: str
    """In words: `the angle of elbow (eccentric gear or encoder, 0.4 deg)`."""
    score: Score
    """How sure, and how large."""
    columns: NDArray
    """What its numbers change of the predictions. Shape (N, 3, m)."""
    ripple_of: str | None = None
    """The joint, where it is waves in that joint's angle."""
    side_of: str | None = None
    """The joint, where it is the side from which that came."""
    uneven: str | None = None
    """The joint, where it is any function of that joint's angle."""
    size: float = 0.0
    """Half of what it turns the joint by, beside what a fit takes of it [rad]."""

    def __str__(self) -> str:
        """Say it in words."""
        return (
            f"the residuals depend on {self.cause}, by {1e3 * self.score.rms:.2g} mm at the hand "
            f"(chance {self.score.chance:.0e})"
        )


def systematic_patterns(
    observations: Observations, parameters: DhParameters, test: ArmTest
) -> tuple[Pattern, ...]:
    """Name what the residuals depend on.

    Returns:
        Patterns that noise does not make, the surest first. That a joint is uneven, which explains
        whatever its gear or waves do, is told where nothing simpler is, and where that is most of
        what is missed: every gear is, a little.
    """
    if test.linear.whitening.groups.poses < FEWEST_POSES:
        return ()
    found = []
    for effect in _effects(observations, parameters, test.linear.rows):
        by_angle = test.linear.by_angle[:, :, effect.joint, None]
        columns = by_angle * effect.turns[:, None]
        score = test.of(columns)
        if score.chance < LARGEST_CHANCE:
            joint = parameters.table.joints[effect.joint]
            ripple, side, uneven = (
                joint if kind else None for kind in (effect.ripple, effect.side, effect.uneven)
            )
            words, size = effect.told_by(score)
            found.append(Pattern(words, score, columns, ripple, side, uneven, size))
    found.sort(key=lambda p: _SIMPLER * p.score.dof - p.score.gain)
    simplest = found[:1] if found and found[0].score.improvement > MUCH else []
    return tuple(p for p in found if p.uneven is None or p in simplest)


@dataclass(frozen=True, eq=False)
class _Effect:
    """Something that turns a joint, and that lines and gears do not have."""

    cause: str
    """In words, with a place for its size in degrees."""
    joint: int
    """Index of the joint."""
    turns: NDArray
    """What its numbers turn the joint by [rad]. Shape (N, m)."""
    taken: NDArray
    """What the fit has for the joint's angle: its zero, of a ripple its gear, of what is uneven its
    ripple. Shape (N, k)."""
    ripple: bool = False
    """Whether it is waves in the joint's angle."""
    side: bool = False
    """Whether it is the side from which the joint came."""
    uneven: bool = False
    """Whether it is any function of the joint's angle."""

    def told_by(self, score: Score) -> tuple[str, float]:
        """Return words, and half of what it turns the joint by, beside what a fit takes of it."""
        turned = self.turns @ score.values
        turned = turned - self.taken @ np.linalg.lstsq(self.taken, turned, rcond=None)[0]
        size = 0.5 * float(np.ptp(turned))
        return self.cause.format(np.degrees(size)), size


def _effects(
    observations: Observations, parameters: DhParameters, counted: NDArray
) -> Iterator[_Effect]:
    """Yield what an arm may do. `counted` are the rows that count, shape (K,)."""
    q = (observations.angles - parameters.servos.offset) / parameters.servos.gear
    zero = np.ones((len(q), 1))
    waves = np.stack([np.sin(q), np.cos(q), np.sin(2.0 * q), np.cos(2.0 * q)], axis=2)
    moments, sides = _moments(parameters, q), _sides(observations)
    for i, joint in enumerate(parameters.table.joints):
        words = f"the angle of {joint} (eccentric gear or encoder, {{:.2g}} deg)"
        line = np.column_stack([zero, q[:, i]])
        yield _Effect(words, i, waves[:, i], line, ripple=True)
        words = f"the angle of {joint}, in places (uneven encoder or gear, {{:.2g}} deg)"
        hats = _hats(q[:, i], counted, len(observations.poses) // _POSES_A_HAT)
        yield _Effect(words, i, hats, np.hstack([line, waves[:, i]]), uneven=True)
        yield _Effect(f"gravity (sag of {joint}, {{:.2g}} deg)", i, moments[:, i], zero)
        others = np.delete(q, i, axis=1)
        if others.shape[1]:
            words = f"the other joints at {joint} (coupling)"
            yield _Effect(words, i, others - others.mean(axis=0), zero)
        words = f"the direction from which {joint} came (backlash, half width {{:.2g}} deg)"
        yield _Effect(words, i, sides[:, i, None], zero, side=True)


def _hats(place: NDArray, counted: NDArray, most: int) -> NDArray:
    """Return hats over where a joint was, those that no row that counts is in left out.

    Args:
        place: Displacements of a joint. Shape (N,).
        counted: Which rows count. Shape (K,).
        most: How many hats there may be.

    Returns:
        Shape (N, m).
    """
    lowest, width = place.min(), max(float(np.ptp(place)), np.finfo(float).tiny)
    count = max(min(most, 1 + int(np.ceil(width / _HAT))), 2)
    steps = (place - lowest)[:, None] * ((count - 1) / width) - np.arange(count)
    hats = np.maximum(1.0 - np.abs(steps), 0.0)
    return hats[:, hats[counted].max(axis=0, initial=0.0) > _TOUCHED]


def tell_sides(joint: str) -> str:
    """Say what is to be done where a joint's errors are those of the side from which it came."""
    return (
        f"say from which side it came (`approach.{joint}`, -1 or 1, in every sample; `record` "
        "writes it), then its backlash is learned"
    )


def _moments(parameters: DhParameters, q: NDArray) -> NDArray:
    """Return the moment about each joint of a load in the hand, for weights along x, y and z.

    d_i . ((p - c_i) x e) = e . (d_i x (p - c_i)), over its largest length. The load is the same
    whichever marker was seen. Shape (N, n, 3).
    """
    frames = parameters.table.frames(q)
    axes, places = frames[:-1, :, :3, 2], frames[:, :, :3, 3]
    moments = np.cross(axes, places[-1] - places[:-1]).transpose(1, 0, 2)
    return moments / np.maximum(np.abs(moments).max(axis=(0, 2), keepdims=True), 1e-12)


def backlash_columns(observations: Observations, by_angle: NDArray) -> NDArray:
    """Return what a radian of half width does, by the side from which each joint came.

    The sample before tells it; a joint that stands still is where its last motion left it.

    Args:
        observations: What was measured; samples are numbered in the order of time.
        by_angle: Derivatives of its points by the joint angles. Shape (N, 3, n).

    Returns:
        Shape (N, 3, n).
    """
    return by_angle * _sides(observations)[:, None]


def likeliest_backlash(observations: Observations, test: ArmTest) -> NDArray:
    """Return `backlash_columns` where joints that have not moved yet stand on the likelier side.

    No sample tells from which side a joint came before its first motion; the half width is that of
    all other samples.

    Args:
        observations: What was measured; samples are numbered in the order of time.
        test: Residuals at the solution.

    Returns:
        Shape (N, 3, n).
    """
    by_angle, sides = test.linear.by_angle, _sides(observations)
    likeliest = []
    for i, side in enumerate(sides.T):
        cases = [np.where(side == 0.0, first, side) for first in (0.0, -1.0, 1.0)]
        columns = [by_angle[:, :, i] * case[:, None] for case in cases]
        gains = [test.of(column[:, :, None]).gain for column in columns]
        likeliest.append(columns[int(np.argmax(gains))])
    return np.stack(likeliest, axis=2)


def _sides(observations: Observations) -> NDArray:
    """Return from which side each joint came; 0 before its first motion. Shape (N, n).

    Where the data say so themselves, they are right: who recorded them may have left poses out.
    """
    told = observations.approach
    if told.any():
        return told
    _, first, of = np.unique(observations.sample, return_index=True, return_inverse=True)
    return sides_in_order(observations.angles[first])[of.reshape(-1)]


def sides_in_order(readings: NDArray) -> NDArray:
    """Return from which side joints came, of samples in the order of time. Shape (S, n).

    A joint that stands still is where its last motion left it; 0 before the first.
    """
    side = np.zeros(readings.shape)
    side[1:] = np.sign(np.diff(readings, axis=0))
    last = np.maximum.accumulate(np.where(side != 0.0, np.arange(len(side))[:, None], 0))
    return np.take_along_axis(side, last, axis=0)
