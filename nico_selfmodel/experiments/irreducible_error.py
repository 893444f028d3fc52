"""What the mechanics leave: the errors of a body that knows itself exactly.

Whoever knew every axis, gear and lens would still not know where in their play the joints rest, nor
what the tracker adds. Nothing that is learned predicts new poses better in the mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset


@dataclass(frozen=True)
class Limit:
    """Errors on held-out poses that no learning takes away."""

    tracker: str
    """How the hand is tracked."""
    px: tuple[float, float]
    """Error in the images: mean and SD over the test poses and both cameras."""
    true_mm: tuple[float, float]
    """Distance from the real hand: mean and SD over robots."""

    @classmethod
    def of(
        cls, tracker: str, test: Dataset, pixels_expected: NDArray, p_LH_expected: NDArray
    ) -> "Limit":
        """Hold what a body that knows itself exactly expects against what was seen.

        Args:
            test: Held-out rows of one marker, with points measured from outside.
            pixels_expected: Pixels in both cameras without play [px]. Shape (N, 4).
            p_LH_expected: Places without play, in the left camera's frame [m]. Shape (N, 3).
        """
        px = np.linalg.norm((test.pixels - pixels_expected).reshape(-1, 2), axis=1)
        mm = 1e3 * np.linalg.norm(test.p_WH_measured - p_LH_expected, axis=1)
        return cls(
            tracker,
            (float(np.nanmean(px)), float(np.nanstd(px))),
            (float(np.nanmean(mm)), 0.0),
        )

    @staticmethod
    def mean(found: Sequence["Limit"]) -> "Limit":
        """Average over robots that were tracked alike."""
        px = np.mean([one.px for one in found], axis=0)
        mm = np.array([one.true_mm[0] for one in found])
        return Limit(
            found[0].tracker,
            (float(px[0]), float(px[1])),
            (float(mm.mean()), float(mm.std())),
        )
