"""What a pair of eyes must be before its calibration means anything."""

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.estimation.camera_adjustment import CameraCalibration

_LARGEST_EPIPOLAR = 1.5
"""Distance from epipolar lines [px] above which a pair is looked at twice."""
_LARGEST_RATIO = 5.0
"""The same against what each eye alone leaves unexplained."""
_SHORTEST_BASELINE = 1e-3
"""Baseline over the boards' distance below which two eyes are one."""


def check_pair(calibration: CameraCalibration, alone_rms: float) -> None:
    """Refuse what is no stereo pair.

    Args:
        calibration: Both eyes.
        alone_rms: What the eyes leave unexplained when each is calibrated alone [px].

    Raises:
        DataError: If left and right are swapped.
        EstimationError: If the eyes stand at one place, or do not hold still against each other.
    """
    rig, believed = calibration.rig, ~calibration.outliers
    error = mean_epipolar_error(calibration.views.select(believed), calibration)
    misfit = max(error, float(np.median(calibration.view_rms)))
    if misfit > max(_LARGEST_EPIPOLAR, _LARGEST_RATIO * alone_rms):
        raise EstimationError(
            f"this is no rigid pair of eyes: corners lie {error:.1f} px from their epipolar lines "
            f"on average, while each eye alone fits to {alone_rms:.2f} px; were the images of a "
            "pair taken together, is every left image paired with its own right one, and did the "
            "cameras keep still against each other?"
        )
    depth = float(np.median(calibration.X_LG[:, 2, 3]))
    if rig.baseline < _SHORTEST_BASELINE * depth:
        raise EstimationError(
            f"the eyes stand at one place (baseline {1e3 * rig.baseline:.2f} mm, boards at "
            f"{1e3 * depth:.0f} mm, epipolar error {error:.2f} px): depth cannot be seen; are both "
            "images from the same camera?"
        )
    sideways = float(rig.X_LR[0, 3])
    if sideways < -0.5 * rig.baseline:
        raise DataError(
            f"left and right are swapped: the right camera comes out {-1e3 * sideways:.0f} mm to "
            "the left of the left one; exchange the images"
        )


def mean_epipolar_error(views: BoardViews, calibration: CameraCalibration) -> float:
    """Return the mean distance of corners from their epipolar lines, over both images [px]."""
    flat, rig = views.pixels.reshape(-1, 4), calibration.rig
    usable = rig.left.has_rays(flat[:, :2]) & rig.right.has_rays(flat[:, 2:])
    return float(np.mean(rig.epipolar_errors(flat[usable]))) if usable.any() else np.inf
