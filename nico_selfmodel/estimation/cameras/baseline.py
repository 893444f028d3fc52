"""How far cameras stand apart, with what that is uncertain by."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.results.calibration_result import Parameter, finite
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.optimization.uncertainty import Uncertainty


def baseline(apart: NDArray, known: Uncertainty, cameras: tuple[str, ...] = SIDES) -> Parameter:
    """Return the distance of two cameras, whose slope by a position is its direction.

    Args:
        apart: From one to the other, in the frame of the first camera of their rig [m]. Shape (3,).
        known: How well the free parameters are known.
        cameras: What the two are called.
    """
    slope, length = np.zeros(len(known.names)), float(np.linalg.norm(apart))
    for camera, sign in zip(cameras, (-1.0, 1.0), strict=True):
        for axis, share in zip("xyz", apart / length, strict=True):
            slope[np.array(known.names) == f"{camera}.pose.{axis}"] = sign * share
    return Parameter(length, finite(known.sigma_of(slope)), "m")
