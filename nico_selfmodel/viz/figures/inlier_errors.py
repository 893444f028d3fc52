"""The errors that figures and scenes show: of training without outliers, and held out."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.arm.evaluation import Evaluation
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration


def inlier_rows(calibration: KinematicCalibration) -> list[tuple[str, Evaluation, NDArray]]:
    """Return name, evaluation and rows of training without outliers, and of held-out data."""
    found = [("training", calibration.train, np.flatnonzero(~calibration.outliers))]
    if calibration.test is not None:
        found.append(("held_out", calibration.test, np.arange(len(calibration.test.observations))))
    return found


def inlier_lengths(calibration: KinematicCalibration) -> NDArray:
    """Return the errors of `inlier_rows` in their order [m]. Shape (n,)."""
    return np.concatenate([e.distances[rows] for _, e, rows in inlier_rows(calibration)])


def largest_shown(calibration: KinematicCalibration) -> float:
    """Return the length at the dark end of the colour scale [m].

    1.3 times the 90th percentile: about the 99th of Gaussian errors, and outliers that nobody
    has sorted out do not stretch it.
    """
    return 1.3 * float(np.percentile(inlier_lengths(calibration), 90.0))
