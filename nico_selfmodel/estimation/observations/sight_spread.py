"""What two cameras are uncertain by where they see a point: more along the sights than across.

A coordinate of a pixel that errs by 1 px moves the point that both cameras reconstruct by
C = (J'J)^-1, J the derivatives of the pixels by the point. At twice the cameras' distance from each
other depth errs by several times what errs across; taken as round, it decides where it should not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_LEAST = 1e-12
"""Part of the largest eigenvalue of J'J below which sights do not cross to rounding."""


@dataclass(frozen=True, eq=False)
class SightSpread:
    """Covariances of points that two cameras reconstruct, beside that of a typical one."""

    rig: StereoRig
    """Both cameras, the left one at the world."""
    unit: float
    """Standard deviation of a coordinate of a typical point for 1 px [m]."""

    @classmethod
    def of(cls, rig: StereoRig, p_WH: NDArray) -> "SightSpread":
        """Take cameras and the points that tell what is typical.

        Args:
            p_WH: At least one [m]. Shape (N, 3).
        """
        each = np.trace(_covariances(rig, p_WH), axis1=1, axis2=2) / 3.0
        return cls(rig, float(np.sqrt(np.median(each))))

    def covariances(self, p_WH_predicted: NDArray, p_WH_measured: NDArray) -> NDArray:
        """Return C of points, over the variance of a typical coordinate.

        Args:
            p_WH_predicted: Where they should be, which one that was seen wrongly does not move [m].
                Shape (N, 3).
            p_WH_measured: Where they were seen, for those that no camera could see there [m].
                Shape (N, 3).

        Returns:
            Shape (N, 3, 3), of a mean diagonal about 1.
        """
        seen = np.asarray(np.isfinite(self.rig.project(p_WH_predicted)).all(axis=1))
        p_WH = np.where(seen[:, None], p_WH_predicted, p_WH_measured)
        return _covariances(self.rig, p_WH) / self.unit**2


def _covariances(rig: StereoRig, p_WH: NDArray) -> NDArray:
    """Return C for 1 px [m^2]. Shape (N, 3, 3)."""
    _, by_point, _ = project_to_cameras(p_WH.T, rig.values, rig.lenses)
    slopes = by_point.transpose(2, 0, 1)
    values, vectors = np.linalg.eigh(np.swapaxes(slopes, 1, 2) @ slopes)
    values = np.maximum(values, _LEAST * values[:, -1:])
    return (vectors / values[:, None]) @ np.swapaxes(vectors, 1, 2)
