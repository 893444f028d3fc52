"""Losses on whole observations: what a pose with a large residual is still allowed to say.

A loss acts on the norm z = |r| / scale of an observation (all coordinates of one measured point
together), never on single coordinates. rho and its weight w = rho'(s), s = z^2, follow Holland and
Welsch (1977); tuning constants are for norms of three coordinates.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.names import refuse_unknown

LOSSES = ("none", "huber", "cauchy", "tukey")

TUNING = {"huber": 2.8, "cauchy": 2.5, "tukey": 5.5}
"""In units of the scale, for three coordinates; other counts are scaled by sqrt(k / 3)."""

_MEDIAN_OF_CHI = {1: 0.6745, 2: 1.1774, 3: 1.5382, 4: 1.8325}


@dataclass(frozen=True)
class Loss:
    """A robust loss with its scale fixed, so that it is one smooth function of the parameters."""

    kind: str = "none"
    """One of `LOSSES`."""
    scale: float = 1.0
    """Standard deviation of a good coordinate, in units of the residual."""

    def __post_init__(self) -> None:
        """Check the kind and the scale."""
        refuse_unknown("loss", self.kind, LOSSES)
        if not self.scale > 0.0:
            raise ValueError(f"scale must be positive, got {self.scale}")

    def rho_and_weight(self, squared: NDArray, coordinates: int) -> tuple[NDArray, NDArray]:
        """Return rho(s) and w = d rho / d s of squared norms, in the squared unit of the residual.

        Args:
            squared: Squared norms |r|^2 of the observations. Shape (N,).
            coordinates: How many coordinates an observation has.

        Returns:
            rho, which replaces |r|^2 in the sum, and the weight. Each of shape (N,).
        """
        if self.kind == "none":
            return squared, np.ones_like(squared)
        k2 = (TUNING[self.kind] * self.scale) ** 2 * coordinates / 3.0
        if self.kind == "huber":
            norm = np.sqrt(np.maximum(squared, k2))
            rho = np.where(squared <= k2, squared, 2.0 * np.sqrt(k2) * norm - k2)
            return rho, np.sqrt(k2) / norm
        if self.kind == "cauchy":
            return k2 * np.log1p(squared / k2), 1.0 / (1.0 + squared / k2)
        inside = np.maximum(1.0 - squared / k2, 0.0)
        return k2 / 3.0 * (1.0 - inside**3), inside**2


def robust_scale(norms: NDArray, coordinates: int) -> float:
    """Return the scale of a coordinate from the median norm (MAD for vectors).

    Args:
        norms: Norms of the observations. Shape (N,).
        coordinates: How many coordinates an observation has.

    Returns:
        median / median of a chi variable; never zero.
    """
    floor = np.finfo(float).tiny ** 0.25
    return max(float(np.median(norms)) / _median_of_chi(coordinates), floor)


def _median_of_chi(coordinates: int) -> float:
    """Return the median norm of a standard normal vector (beyond four: Wilson, Hilferty 1931)."""
    wilson_hilferty = np.sqrt(coordinates) * (1.0 - 2.0 / (9.0 * coordinates)) ** 1.5
    return _MEDIAN_OF_CHI.get(coordinates, float(wilson_hilferty))
