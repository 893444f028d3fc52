"""What a pair of cameras must be before its calibration means anything, and how far it is apart."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.results.calibration_result import Parameter, finite
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.uncertainty import Uncertainty

_LARGEST_EPIPOLAR = 1.5
"""Distance from epipolar lines [px] above which a pair is looked at twice."""
_LARGEST_RATIO = 5.0
"""The same against what each camera alone leaves unexplained."""
_STANDS_OUT = 2.0
"""Times what half of the views leave at most, from which on one is named."""
_LARGEST_AT_START = 8.0
"""Median distance from epipolar lines [px] that a start may have beside what a camera leaves."""
_SHORTEST_BASELINE = 1e-3
"""Baseline over the boards' distance below which two cameras are one."""


def baseline(apart: NDArray, known: Uncertainty, cameras: tuple[str, ...] = SIDES) -> Parameter:
    """Return the distance of two cameras, whose slope by a position is its direction.

    Args:
        apart: From one to the other, in the frame of the first camera of their rig [m]. Shape (3,).
        known: How well the free parameters are known.
    """
    slope, length = np.zeros(len(known.names)), float(np.linalg.norm(apart))
    for camera, sign in zip(cameras, (-1.0, 1.0), strict=True):
        for axis, share in zip("xyz", apart / length, strict=True):
            slope[np.array(known.names) == f"{camera}.pose.{axis}"] = sign * share
    return Parameter(length, finite(known.sigma_of(slope)), "m")


def check_pair(calibration: CameraCalibration, link: tuple[str, str], alone_rms: float) -> None:
    """Refuse what is no pair of cameras.

    Args:
        link: Two of them that saw boards at once.
        alone_rms: What the cameras leave unexplained when each is calibrated alone [px].

    Raises:
        DataError: If left and right are swapped.
        EstimationError: If the cameras stand at one place, or do not hold still against each other.
    """
    rig = calibration.pair(*link)
    views = calibration.views.pair(*link).select(~calibration.outliers)
    error = float(np.mean(_epipolar_errors(rig, views)))
    misfit = max(error, float(np.median(calibration.view_rms)))
    if misfit > max(_LARGEST_EPIPOLAR, _LARGEST_RATIO * alone_rms):
        raise _no_pair(error, alone_rms, _worst(rig, views))
    shared = np.all(views.seen.any(axis=2), axis=1)
    X_CG = rig.left.X_CW @ calibration.X_LG[~calibration.outliers][shared]
    depth = float(np.median(X_CG[:, 2, 3]))
    if rig.baseline < _SHORTEST_BASELINE * depth:
        raise EstimationError(
            f"the {' and '.join(link)} cameras stand at one place (baseline "
            f"{1e3 * rig.baseline:.2f} mm, boards at {1e3 * depth:.0f} mm, epipolar error "
            f"{error:.2f} px): depth cannot be seen; are both images from the same camera?"
        )
    sideways = float(rig.X_LR[0, 3])
    if link == SIDES and sideways < -0.5 * rig.baseline:
        raise DataError(
            f"left and right are swapped: the right camera comes out {-1e3 * sideways:.0f} mm to "
            "the left of the left one; exchange the images, or call `calibrate stereo` with "
            "--swap-cameras"
        )


def check_start(rig: StereoRig, views: BoardViews, alone_rms: float) -> None:
    """Refuse pairs of which most do not belong together, where no adjustment could tell.

    It alone is no judgement: small boards far away place two good cameras as badly.

    Args:
        rig: The cameras as the closed forms place them.
        alone_rms: What the cameras leave unexplained when each is calibrated alone [px].

    Raises:
        EstimationError: If half the corners lie far from their epipolar lines.
    """
    error = float(np.median(_epipolar_errors(rig, views)))
    if error > _LARGEST_AT_START + _LARGEST_RATIO * alone_rms:
        raise _no_pair(error, alone_rms)


def _no_pair(error: float, alone_rms: float, worst: str = "") -> EstimationError:
    return EstimationError(
        f"this is no rigid pair of cameras: corners lie {error:.1f} px from their epipolar lines "
        f"on average{worst}, while each camera alone fits to {alone_rms:.2f} px; were the images "
        "of a pair taken together, is every left image paired with its own right one, and did the "
        "cameras keep still against each other?"
    )


def _worst(rig: StereoRig, views: BoardViews) -> str:
    """Name the view that lies farthest from its epipolar lines, if one stands out."""
    each = [float(np.mean(_epipolar_errors(rig, views.select([v])))) for v in range(len(views))]
    worst = int(np.argmax(each))
    others = np.delete(each, worst)
    if not len(others) or each[worst] < _STANDS_OUT * float(np.median(others)):
        return ""
    return f" (view {views.names[worst]} {each[worst]:.1f} px, the others less)"


def _epipolar_errors(rig: StereoRig, views: BoardViews) -> NDArray:
    """Return distances in both images [px]; inf where no corner has a ray. Shape (n, 2)."""
    flat = views.pixels.reshape(-1, 4)
    usable = rig.left.has_rays(flat[:, :2]) & rig.right.has_rays(flat[:, 2:])
    return rig.epipolar_errors(flat[usable]) if usable.any() else np.full((1, 2), np.inf)
