"""Statistics of errors: one summary for distances in space and in images, and for angles."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class ErrorStatistics:
    """Statistics of Euclidean distances between predicted and measured points."""

    n: int
    """Number of points."""
    mean: float
    """[m]."""
    sd: float
    """Standard deviation of the distances [m]."""
    rms: float
    """Root of the mean squared distance [m]."""
    median: float
    """[m]."""
    p95: float
    """95th percentile [m]."""
    max: float
    """[m]."""

    @classmethod
    def from_distances(cls, distances: NDArray) -> "ErrorStatistics":
        """Summarise distances [m]. Shape (N,), N >= 1."""
        d = np.asarray(distances, dtype=float)
        return cls(
            len(d),
            float(d.mean()),
            float(d.std(ddof=1)) if len(d) > 1 else 0.0,
            float(np.sqrt(np.mean(d * d))),
            float(np.median(d)),
            float(np.percentile(d, 95.0)),
            float(d.max()),
        )

    def as_mm(self) -> dict[str, float]:
        """Return the statistics in millimetres, keyed as in `result.json`."""
        return {name: 1e3 * value for name, value in self.as_dict().items()}

    def as_deg(self) -> dict[str, float]:
        """Return the statistics of angles [rad] in degrees, keyed as in `result.json`."""
        return {name: float(np.degrees(value)) for name, value in self.as_dict().items()}

    def as_dict(self) -> dict[str, float]:
        """Return the statistics in their own unit, keyed as in `result.json`."""
        names = ("mean", "sd", "rms", "median", "p95", "max")
        return {name: float(getattr(self, name)) for name in names}
