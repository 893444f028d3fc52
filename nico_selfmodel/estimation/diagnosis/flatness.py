"""Is a mirror flat? One plane against reflected cameras that are free, by whitened residuals.

In a flat mirror each camera becomes a reflected camera, and both follow from three numbers. Two
such cameras with six parameters each can follow what a bent mirror does to the cameras; whether
they fit better than chance is the test (docs/mirrors.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEADYING = 8
"""Pixel coordinates that noise which is known at least roughly counts as, and how many more than
camera parameters the test needs."""
_BY_CHANCE = 1e-3
"""A flat mirror fails the test this often."""


@dataclass(frozen=True)
class Flatness:
    """How a plane fares against free cameras."""

    chi_square: float
    """By how much the free cameras lower the whitened sum of squares, in units of the noise."""
    freedom: int
    """How many parameters more they have."""
    redundancy: int
    """How many pixel coordinates there are more than parameters of the free cameras."""
    by_chance: float
    """Probability of as much in a flat mirror (F distribution; Paulson 1942)."""

    @property
    def flat(self) -> bool:
        """Whether the mirror may be flat."""
        return self.by_chance >= _BY_CHANCE

    def to_json(self) -> dict[str, Any]:
        """Return the entry in `result.json`."""
        return {
            "flat": bool(self.flat),
            "chi_square": self.chi_square,
            "freedom": self.freedom,
            "redundancy": self.redundancy,
            "by_chance": self.by_chance,
        }

    def reason(self, mirror: str) -> str:
        """Say why a mirror of some name is not taken for flat."""
        return (
            f"mirror {mirror!r} is not flat, or the body is not what the self-model says: two free "
            f"cameras fit better than one plane, chi-square {self.chi_square:.0f} for "
            f"{self.freedom} parameters more ({self.by_chance:.1g} by chance)"
        )


def bent_reasons(tests: Mapping[str, Flatness | None]) -> list[str]:
    """Say which mirrors are not flat, by their names."""
    return [test.reason(name) for name, test in tests.items() if test is not None and not test.flat]


def flatness_by(
    white: NDArray, by_plane: NDArray, by_cameras: NDArray, freedom: int, redundancy: int
) -> Flatness | None:
    """Hold what a plane leaves against what free cameras leave.

    Args:
        white: Whitened residuals. Shape (R,).
        by_plane: Whitened derivatives by the plane, and by all else that is not known. Shape
            (R, a).
        by_cameras: Those by free cameras, and by all else that is not known. Shape (R, b).
        freedom: How many parameters more these have.
        redundancy: How many pixel coordinates there are more than parameters of the cameras.

    Returns:
        The test; None where there are too few coordinates for it.
    """
    if redundancy < STEADYING:
        return None
    plane, cameras = _left_over(white, by_plane), _left_over(white, by_cameras)
    # Noise that is known at least roughly steadies the scale where poses are few.
    scale = (cameras + STEADYING) / (redundancy + STEADYING)
    gain = max(plane - cameras, 0.0) / scale
    chance = exceeded_by_chance(gain / freedom, freedom, redundancy + STEADYING)
    return Flatness(gain, freedom, redundancy, chance)


def _left_over(white: NDArray, rows: NDArray) -> float:
    """Return what a linear model leaves of whitened residuals."""
    # Columns in natural size, so that rank is no question of units.
    rows = rows / np.linalg.norm(rows, axis=0)
    return float(np.sum((white - rows @ np.linalg.lstsq(rows, white, rcond=1e-9)[0]) ** 2))


def exceeded_by_chance(ratio: float, first: int, second: int) -> float:
    """Return the probability that an F variable exceeds a ratio (Paulson 1942).

    Args:
        ratio: Ratio of two mean squares.
        first: Degrees of freedom of the numerator.
        second: Of the denominator, three or more.

    Returns:
        The upper tail, right to a few per cent down to 1e-4.
    """
    from math import erfc, sqrt

    if ratio <= 0.0:
        return 1.0
    a, b = 2.0 / (9.0 * first), 2.0 / (9.0 * second)
    root = ratio ** (1.0 / 3.0)
    score = ((1.0 - b) * root - (1.0 - a)) / sqrt(b * root * root + a)
    return 0.5 * erfc(score / sqrt(2.0))
