"""What a recording says about a body: residuals and their derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class TreeLinear:
    """Residuals about a body, predicted minus measured, in the sensors' units."""

    r: NDArray
    """Shape (R,)."""
    J: NDArray
    """By all parameters. Shape (P, R)."""
    by_joint: NDArray
    """By what is read with noise, `TreeObservations.noisy_joints`. Shape (R, m)."""
    pulled: NDArray | None = None
    """A e, what the joint errors e about which all this is linear add to r. Shape (R,); None where
    it is linear about the readings."""
    taken: NDArray | None = None
    """Freedoms of each noise group that poses apart took, see `boards.poses_apart`. Shape (G,)."""
    took: NDArray | None = None
    """What they took of each scalar, as orthonormal columns: Q of A A^+ = Q Q'. Shape (R, 6)."""
    poses: NDArray | None = None
    """Whole poses there, see `TreeResiduals.whole_poses`. Shape (P, n, 4, 4)."""

    @classmethod
    def together(cls, parts: Sequence["TreeLinear"]) -> "TreeLinear":
        """Return it of several runs of sensors, one after the other, about their readings."""
        if len(parts) == 1:
            return parts[0]
        r, by_joint = (np.concatenate([getattr(p, k) for p in parts]) for k in ("r", "by_joint"))
        return cls(r, np.concatenate([p.J for p in parts], axis=1), by_joint)
