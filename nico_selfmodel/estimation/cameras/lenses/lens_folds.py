"""Lenses that fold their image: pixels to which no ray belongs."""

import numpy as np

from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, POLYNOMIAL, RATIONAL

_TOLD_FROM_ZERO = 3.0
"""Standard deviations below which the term that folds an image may as well be zero."""


def folds_of(sides: tuple[str, ...], cameras: tuple[Camera, ...]) -> dict[str, str]:
    """Return camera -> what to say of it, for each lens that folds its image."""
    words = {}
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    for side, camera in zip(sides, cameras, strict=True):
        edge = corners * (np.array(camera.image_size) - 1.0)
        if camera.folds(edge).any():
            words[side] = (
                f"the distortion of the {side} camera is not monotone up to the image's corners: "
                f"it turns at {_turn(camera)}; fix {side}.{_last(camera)}=0, "
                "or record boards in the corners"
            )
    return words


def _last(camera: Camera) -> str:
    """Return the term that is held at zero first."""
    return "k4" if camera.lens == FISHEYE else "k3"


def _turn(camera: Camera) -> str:
    """Say where a lens folds its image."""
    if camera.lens == FISHEYE:
        return f"{np.degrees(camera.reach):.0f} deg off the axis"
    return f"a radius of {camera.reach:.2f}"


def ends_early(calibration: CameraCalibration) -> bool:
    """Tell whether a wide lens ends at some angle in front: at a fold, or at a pole.

    Light comes from all directions: rays just beyond what boards told would be shown nowhere.
    """
    ends = {RATIONAL: np.inf, FISHEYE: np.pi / 2.0}
    return any(camera.reach < ends.get(camera.lens, 0.0) for camera in calibration.cameras)


def folds_by_chance(calibration: CameraCalibration) -> set[str]:
    """Return the cameras whose fold hangs on a term that is not to be told from zero.

    What the boards leave open bends the image where none was seen; the lens is none the worse. Wide
    lenses reach beyond any board: what they do there is a matter of where boards were seen.
    """
    found = set()
    for side, camera in zip(calibration.views.cameras, calibration.cameras, strict=True):
        free = [k for k in ("k6", "k5", "k4", "k3", "k2") if f"{side}.{k}" in calibration.names]
        if free:
            sigma = calibration.uncertainty.sigma[calibration.names.index(f"{side}.{free[0]}")]
            if abs(getattr(camera, free[0])) < _TOLD_FROM_ZERO * float(sigma):
                found.add(side)
        pixels = calibration.views.of_camera(side)[~calibration.outliers].reshape(-1, 2)
        if camera.lens != POLYNOMIAL and not camera.folds(pixels).any():
            found.add(side)
    return found
