"""The numbers of a rig of cameras: what is inside each, and where all but the first stand."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_vector_of
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, intrinsic_units, intrinsics_of

SIDES = ("left", "right")
"""The cameras of a pair, in the order of the pixel columns."""
POSE_NAMES = ("rx", "ry", "rz", "x", "y", "z")
"""Pose of a camera in the first one's frame: rotation vector [rad] and position [m]."""


def rig_names(cameras: Sequence[str] = SIDES, lens: str = POLYNOMIAL) -> tuple[str, ...]:
    """Return names of parameters: `left.fx` ... `right.p2`, then `right.pose.rx` ...

    The first camera is where the others' poses are told.

    Args:
        cameras: Their names.
        lens: Of all of them.
    """
    inside = tuple(f"{camera}.{name}" for camera in cameras for name in intrinsics_of(lens))
    return inside + tuple(f"{camera}.pose.{name}" for camera in cameras[1:] for name in POSE_NAMES)


def rig_units(count: int = 2, lens: str = POLYNOMIAL) -> tuple[str, ...]:
    """Return the units of `rig_names` of some cameras."""
    pose = ("rad",) * 3 + ("m",) * 3
    return (*intrinsic_units(lens) * count, *pose * (count - 1))


def rig_values(cameras: Sequence[Camera]) -> NDArray:
    """Return the numbers that `rig_names` names, in the first camera's frame."""
    inside = [camera.values for camera in cameras]
    X_FC = [cameras[0].X_CW @ camera.X_WC for camera in cameras[1:]]
    return np.concatenate([*inside, *(part for X in X_FC for part in pose_values(X))])


def pose_values(X: NDArray) -> tuple[NDArray, NDArray]:
    """Return the rotation vector [rad] and the position [m] of a pose, as `POSE_NAMES`."""
    return rotation_vector_of(X[:3, :3]), X[:3, 3]
