"""Errors of a joint that is read worse than others, asked by themselves for what makes them.

A joint may be as noisy as it likes: beside noise that a late encoder or a jump made, either gains
little in the scores of all residuals. Its errors, all as uncertain, are what is asked for and a
line in its reading, which nobody tells from where its zero is and from its gear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.score_test import ScoreTest


@dataclass(frozen=True, eq=False)
class ErrorsOfJoint:
    """See `diagnosis.score_test.Weighed`: one number a sample."""

    residuals: NDArray
    by_angle: NDArray
    rows: NDArray

    @property
    def whitened_residuals(self) -> NDArray:
        """The errors."""
        return self.residuals[:, 0]

    def whitened(self, columns: NDArray) -> NDArray:
        """Return columns as they are. Shape (N, 1, m) -> (N, m)."""
        return columns[:, 0]


def errors_beside_a_line(errors: NDArray, place: NDArray) -> ScoreTest[ErrorsOfJoint]:
    """Prepare the test of what makes errors, beside a line.

    Args:
        errors: How far the joint was from its readings, by sample [rad or m]. Shape (N,).
        place: Where it was. Shape (N, 1).
    """
    by_angle = np.ones((len(errors), 1, 1))
    linear = ErrorsOfJoint(errors[:, None], by_angle, np.arange(len(errors)))
    return ScoreTest(linear, np.concatenate([by_angle, place[:, None]], axis=2))
