"""An encoder that jumped, where its joint's noise explains it: see `diagnosis.errors_of_joint`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.changes_in_time import FEWEST_VISITS
from nico_selfmodel.estimation.diagnosis.errors_of_joint import errors_beside_a_line
from nico_selfmodel.estimation.diagnosis.lag_in_time import BESIDE, SURE, Steps, likelier

_FEWEST = 4
"""Samples before and after a jump, at least."""


@dataclass(frozen=True, eq=False)
class Jump:
    """A joint's readings that jumped."""

    size: float
    """By how much [rad or m]."""
    last: int
    """Sample after which they did."""


def jump_taken_for_noise(errors: NDArray, place: NDArray, sample: NDArray) -> Jump | None:
    """Find the jump that makes the errors of a joint.

    It must explain what the joint's places and sides do not, as a lag must.

    Args:
        errors: How far the joint was from its readings [rad or m]. Shape (N,).
        place: Where it was. Shape (N,).
        sample: Numbers of the samples, in the order of time. Shape (N,).

    Returns:
        The likeliest, or None where there is none.
    """
    n = len(errors)
    if n < FEWEST_VISITS:
        return None
    firsts = np.arange(_FEWEST, n - _FEWEST + 1)
    after = (np.arange(n)[:, None, None] >= firsts).astype(float)
    test = errors_beside_a_line(errors, place[:, None])
    gain, sizes = likelier(test, after)
    best = int(np.argmax(gain))
    if gain[best] <= SURE + 2.0 * np.log(len(firsts)):
        return None
    alone = np.stack(list(Steps.of(sample, place[:, None]).alone), axis=2)
    beside = test.beside(alone[:, :, alone.any(axis=(0, 1))])
    if likelier(beside, after[:, :, [best]])[0][0] <= BESIDE:
        return None
    return Jump(float(sizes[best]), int(sample[firsts[best] - 1]))
