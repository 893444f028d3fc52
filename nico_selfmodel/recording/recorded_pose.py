"""One pose of a recording, as sensed."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class RecordedPose:
    """One pose of the plan, as sensed."""

    index: int
    label: str
    encoders: NDArray
    approach: NDArray
    """How each reading changed when the joint last moved, -1 or 1; 0 where it is not known."""
    points: NDArray
    """Shape (m, 3), nan where lost."""
    pixels: NDArray
    """Shape (m, 4), nan where not seen."""
    mirror: str = ""
    """Name of the mirror before the body, empty where there was none."""
    reflected: NDArray | None = None
    """Pixels in that mirror. Shape (m, 4), nan where not seen."""
    visits: int = 1
    """How often the pose was visited until something was seen."""

    @property
    def views(self) -> dict[str, NDArray]:
        """Mirror, empty for the direct view, -> pixels."""
        shown = {"": self.pixels}
        return shown if self.reflected is None else {**shown, self.mirror: self.reflected}

    @cached_property
    def complete(self) -> bool:
        """Whether every marker was located, by both cameras where there are cameras."""
        by_pixels = np.isfinite(self.pixels).all(axis=1)
        return bool((np.isfinite(self.points).all(axis=1) | by_pixels).all())
