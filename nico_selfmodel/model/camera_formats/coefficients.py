"""Lens coefficients in the order that OpenCV, and all who follow it, write them in."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, POLYNOMIAL, RATIONAL
from nico_selfmodel.names import shown

_RIGID = 1e-4
"""How far a rotation that was written with few digits may be from one."""
_ORDER = {
    POLYNOMIAL: ("k1", "k2", "p1", "p2", "k3"),
    RATIONAL: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    FISHEYE: ("k1", "k2", "k3", "k4"),
}


def coefficients_of(camera: Camera) -> NDArray:
    """Return a lens' coefficients: k1 k2 p1 p2 k3 [k4 k5 k6], of a fisheye k1 to k4."""
    return np.array([getattr(camera, name) for name in _ORDER[camera.lens]])


def require_no_skew(camera: Camera, program: str) -> None:
    """Refuse a camera whose pixels are sheared, which other programs do not know.

    Raises:
        ModelError: If so.
    """
    if camera.skew != 0.0:
        raise ModelError(
            f"skew {camera.skew:.3g} px has no counterpart in {program}: learn the cameras without "
            "`--free skew`"
        )


def camera_of(
    focal: Sequence[float],
    coefficients: Sequence[float],
    image_size: Any,
    where: str,
    *,
    fisheye: bool = False,
    X_WC: ArrayLike | None = None,
) -> Camera:
    """Build a camera from what such files hold.

    Args:
        focal: fx, fy, cx, cy [px]. Length 4.
        coefficients: In `coefficients_of`'s order; what is missing at the end is zero.
        image_size: Width and height [px].
        where: Place for messages.
        fisheye: Whether they are those of a fisheye.
        X_WC: Its pose. Shape (4, 4).

    Raises:
        DataError: If they are no camera, or a lens that has no counterpart here.

    Warns:
        UserWarning: If the principal point lies outside the images.
    """
    found = [float(value) for value in np.ravel(coefficients)]
    while len(found) > 8 and found[-1] == 0.0:
        found.pop()
    kind = FISHEYE if fisheye else POLYNOMIAL if len(found) <= 5 else RATIONAL
    names = _ORDER[kind]
    if len(found) > len(names):
        raise DataError(
            f"{where}: {len(found)} lens coefficients, of which only {len(names)} have a "
            "counterpart here: thin prisms and tilted sensors are not known"
        )
    pose = np.eye(4) if X_WC is None else np.asarray(X_WC, dtype=float)
    R = pose[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > _RIGID or np.linalg.det(R) < 0.0:
        raise DataError(f"{where}: the pose of the camera is no rotation and translation")
    fx, fy, cx, cy = (float(value) for value in focal)
    bends = dict(zip(names, found, strict=False))
    if any(side is None for side in np.ravel(image_size)):
        raise DataError(
            f"{where}: the size of its images is missing: add it, in OpenCV's and ROS' files "
            "image_width and image_height, in Kalibr's resolution, in mrcal's imagersize"
        )
    width, height = (int(side) for side in matrix(image_size, (2,), f"{where}, image size"))
    if not (0.0 <= cx <= width and 0.0 <= cy <= height):
        warnings.warn(
            f"{where}: the principal point {cx:.4g}, {cy:.4g} lies outside images of {width} x "
            f"{height}: is this the size of the images that the camera was calibrated by?",
            stacklevel=2,
        )
    try:
        X_WC = transform(nearest_rotation(R), pose[:3, 3])
        return Camera(fx, fy, cx, cy, (width, height), lens=kind, X_WC=X_WC, **bends)
    except (TypeError, ValueError) as error:
        raise DataError(f"{where}: no camera: {error}") from None


def matrix(value: Any, shape: tuple[int, ...], where: str) -> NDArray:
    """Return numbers of a shape, however they were nested.

    Raises:
        DataError: If they are others.
    """
    try:
        found = np.asarray(value, dtype=float).reshape(shape)
    except (TypeError, ValueError):
        count = "" if -1 in shape else f"{' x '.join(map(str, shape))} "
        raise DataError(f"{where}: expected {count}numbers, got {shown(value)}") from None
    if not np.isfinite(found).all():
        raise DataError(f"{where}: numbers must be finite, got {shown(value)}")
    return found
