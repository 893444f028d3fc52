"""Backlash or an eccentric gear, where a joint's noise explains it: see `errors_of_joint`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.errors_of_joint import errors_beside_a_line
from nico_selfmodel.estimation.diagnosis.systematic_residuals import (
    FEWEST_POSES,
    LARGEST_CHANCE,
    MUCH,
    sides_in_order,
)


@dataclass(frozen=True)
class NoisePattern:
    """What most of a joint's noise is."""

    side: bool
    """Whether it is the side from which the joint came, else waves in its angle."""
    size: float
    """Half of what it turns the joint by, beside a line [rad or m]."""


def pattern_taken_for_noise(
    errors: NDArray, place: NDArray, sample: NDArray
) -> NoisePattern | None:
    """Find what a joint's errors follow: the side from which it came, or its angle.

    That of two samples tells the side where none is missing between them.

    Args:
        errors: How far the joint was from its readings [rad or m]. Shape (N,).
        place: Where it was. Shape (N,).
        sample: Numbers of the samples, in the order of time. Shape (N,).

    Returns:
        None where neither is most of the errors, or they are of another moment.
    """
    if len(errors) < FEWEST_POSES:
        return None
    step, gap = np.diff(place, prepend=place[0]), np.diff(sample, prepend=sample[0])
    next_ = gap == np.median(gap[1:])
    side = np.where(next_, sides_in_order(place[:, None])[:, 0], 0.0)
    waves = np.stack([f(h * place) for h in (1.0, 2.0) for f in (np.sin, np.cos)], axis=1)
    asked = (side[:, None], waves, np.where(next_, step, 0.0)[:, None])
    told, line = next_.nonzero()[0], np.stack([np.ones(len(place)), place], axis=1)
    if len(told) < FEWEST_POSES:
        return None
    test = errors_beside_a_line(errors[told], place[told, None])
    scores = [test.of(columns[told, None]) for columns in asked]
    best = int(np.argmax([score.gain for score in scores]))
    score = scores[best]
    left = 1.0 - score.gain / test.redundancy  # of the squares
    if best == 2 or score.chance > LARGEST_CHANCE or left > MUCH**-2:
        return None
    turned = asked[best] @ score.values
    turned = turned - line @ np.linalg.lstsq(line, turned, rcond=None)[0] if best else turned
    return NoisePattern(not best, 0.5 * float(np.ptp(turned)))
