"""Calibrate any number of cameras from views of a flat board: the thesis' algorithm 3, put right.

Zhang's start for each camera, a refinement of each camera alone, relative poses by the essential
matrix and cheirality, then one adjustment of all cameras and all boards.
"""

import time

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import (
    DataError,
    EstimationError,
    ModelError,
    NotConvergedError,
    NotIdentifiableError,
)
from nico_selfmodel.estimation.cameras.camera_adjustment import Adjustment, CameraCalibration
from nico_selfmodel.estimation.cameras.camera_initialization import (
    check_tilts,
    fisheye_start,
    rational_like,
    zhang_start,
)
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions, by_full_name
from nico_selfmodel.estimation.cameras.pair_checks import check_pair, check_start
from nico_selfmodel.estimation.cameras.parts_of_boards import told_places
from nico_selfmodel.estimation.cameras.rig_start import rig_links, rig_start
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, RATIONAL
from nico_selfmodel.model.cameras.rig_parameters import rig_names
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

FEWEST_VIEWS = 3
"""Boards below which a camera with a free principal point is not determined."""


@on_one_blas_thread
def calibrate_cameras(
    views: BoardViews,
    options: CameraOptions | None = None,
    near: CameraCalibration | None = None,
) -> CameraCalibration:
    """Calibrate the cameras that saw a board.

    Args:
        views: Corners in any number of cameras.
        options: What is held and free; by default skew and tangential distortion are held at zero.
        near: The same cameras as they were learned from these and other views, to begin with.

    Returns:
        The cameras, the boards and what is known of them.

    Raises:
        NotIdentifiableError: If there are too few boards, or all are parallel.
        DataError: If left and right are swapped.
        EstimationError: If no start can be found, the cameras are no rigid pair, or nothing tells
            which parts of a board they saw.
        NotConvergedError: If a camera that cannot be comes out.
        ValueError: If an option names no parameter.
    """
    began = time.perf_counter()
    options = options or CameraOptions()
    views = views.placeable()
    _check_names(views, options)
    if near is not None:
        X_LG = near.X_LG[_rows_in(near, views)]
        adjustment = Adjustment(views, near.cameras, X_LG, options)
        adjustment.solve(options.loss)
        return adjustment.result(time.perf_counter() - began)
    if len(views.cameras) == 1:
        adjustment = _refine_alone(views, options, alone=True)
        adjustment.solve(options.loss)
        check_tilts(adjustment.X_LG, views.cameras[0])
        return adjustment.result(time.perf_counter() - began)
    alone = {
        camera: _refine_alone(views.only(camera), options, alone=False) for camera in views.cameras
    }
    for camera, found in alone.items():
        check_tilts(found.X_LG, camera)
    placed = [_among(views, found) for found in alone.values()]
    if views.loose.any():
        views, placed = told_places(views, placed)
    links = rig_links(views)
    cameras, X_LG = rig_start(placed, views)
    adjustment = Adjustment(views, cameras, X_LG, options)
    leaves = {link: max(alone[camera].rms for camera in link) for link in links}
    try:
        adjustment.solve(options.loss)
        result = adjustment.result(time.perf_counter() - began)
    except (NotConvergedError, ModelError):
        # Pairs that do not belong together may end in cameras that cannot be: say that of them.
        placed = dict(zip(views.cameras, cameras, strict=True))
        for (first, second), rms in leaves.items():
            rig = StereoRig(placed[first], placed[second])
            check_start(rig, views.pair(first, second), rms)
        raise
    for link, rms in leaves.items():
        try:
            check_pair(result, link, rms)
        except (DataError, EstimationError) as error:
            if not (told := options.told):
                raise
            raise type(error)(f"{error}; or what is told is wrong: try without {told}") from None
    return result


def cameras_of_fewer(
    calibration: CameraCalibration, views: BoardViews, options: CameraOptions
) -> tuple[Camera, ...]:
    """Return the cameras that a part of the views tells, near those that all told.

    Of the losses that trim nothing or boards, the boards that all told to be outliers are.

    Raises:
        NotConvergedError: If a camera that cannot be comes out.
    """
    rows = _rows_in(calibration, views)
    adjustment = Adjustment(views, calibration.cameras, calibration.X_LG[rows], options)
    known = calibration.outliers[rows] if options.loss in ("none", "trimmed") else None
    adjustment.solve(options.loss, known)
    return adjustment.cameras


def _rows_in(calibration: CameraCalibration, views: BoardViews) -> list[int]:
    return [calibration.views.names.index(name) for name in views.names]


def _check_names(views: BoardViews, options: CameraOptions) -> None:
    """Raise before any work if an option names a parameter that does not exist."""
    names = rig_names(views.cameras, options.lenses(views.cameras))
    options.held(names)
    by_full_name(options.priors, names)


def _refine_alone(views: BoardViews, options: CameraOptions, *, alone: bool) -> Adjustment:
    """Start one camera and adjust it roughly, first with the principal point held."""
    (side,) = views.cameras
    if len(views) < FEWEST_VIEWS:
        raise NotIdentifiableError(
            f"the {side} camera saw {len(views)} board{'s' * (len(views) != 1)}, at least "
            f"{FEWEST_VIEWS} in different attitudes are needed, 10 to 20 are better"
        )
    own = options.of_camera(side)
    (lens,) = own.lenses(views.cameras)
    if lens == RATIONAL:
        return _finished(_like_a_fisheye(views, own), own, alone=alone)
    start = fisheye_start if lens == FISHEYE else zhang_start
    return _finished(_approached(views, *start(views), own), own, alone=alone)


def _like_a_fisheye(views: BoardViews, options: CameraOptions) -> Adjustment:
    """Begin with the rational lens that bends light as the fisheye does that fits the boards best.

    From elsewhere an adjustment may end where a zero stands beside a pole, anywhere: a fisheye has
    one minimum, and bends light as most lenses do.
    """
    fisheye = _approached(views, *fisheye_start(views), CameraOptions(lens=FISHEYE))
    fisheye.approach(tolerance=0.01)
    camera = rational_like(fisheye.cameras[0], views.pixels)
    return Adjustment(views, (camera,), fisheye.X_LG, options)


def _approached(
    views: BoardViews, camera: Camera, X_CG: NDArray, options: CameraOptions
) -> Adjustment:
    """Adjust one camera roughly from a start, with the principal point held."""
    adjustment = Adjustment(views, (camera,), X_CG, options)
    centre = [name for name in _centre(views) if name not in adjustment.held]
    for name in centre:
        adjustment.program.fix(name)
    adjustment.approach(tolerance=0.1)
    for name in centre:
        adjustment.program.release(name)
    return adjustment


def _centre(views: BoardViews) -> tuple[str, str]:
    (side,) = views.cameras
    return f"{side}.cx", f"{side}.cy"


def _finished(adjustment: Adjustment, options: CameraOptions, *, alone: bool) -> Adjustment:
    """Go on with the principal point free, and without boards that stand out.

    Args:
        adjustment: Of one camera.
        options: Of the adjustment that follows.
        alone: Whether that one is of this camera alone, and begins where this ends.
    """
    if not alone or options.loss != "none":
        adjustment.approach(tolerance=0.01)
    if options.loss != "none":
        adjustment.approach_without_outliers()
    return adjustment


def _among(views: BoardViews, alone: Adjustment) -> tuple[Camera, NDArray]:
    """Return one camera and its boards among all views, nan where it saw nothing."""
    X_CG = np.full((len(views), 4, 4), np.nan)
    X_CG[[views.names.index(name) for name in alone.views.names]] = alone.X_LG
    return alone.cameras[0], X_CG
