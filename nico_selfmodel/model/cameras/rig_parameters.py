"""The numbers of a rig of cameras: what is inside each, and where all but the first stand."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import rotation_vector_of
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import POLYNOMIAL, intrinsic_units, intrinsics_of

SIDES = ("left", "right")
"""The cameras of a pair, in the order of the pixel columns."""
POSE_NAMES = ("rx", "ry", "rz", "x", "y", "z")
"""Pose of a camera in the first one's frame: rotation vector [rad] and position [m]."""


Lenses = str | Sequence[str]
"""The lens of all cameras, or one each; of `projection.LENSES`."""


def each_lens(lens: Lenses, count: int) -> tuple[str, ...]:
    """Return a lens for each of some cameras.

    Raises:
        ValueError: If there are more or fewer.
    """
    lenses = (lens,) * count if isinstance(lens, str) else tuple(lens)
    if len(lenses) != count:
        raise ValueError(f"{count} cameras have {count} lenses, got {len(lenses)}")
    return lenses


def inside_of(lens: Lenses) -> tuple[slice, ...]:
    """Return where the intrinsics of each of two cameras stand among `rig_names`."""
    ends = np.cumsum([0, *(len(intrinsics_of(own)) for own in each_lens(lens, 2))]).tolist()
    return tuple(slice(a, b) for a, b in pairwise(ends))


def rig_names(cameras: Sequence[str] = SIDES, lens: Lenses = POLYNOMIAL) -> tuple[str, ...]:
    """Return names of parameters: `left.fx` ... `right.p2`, then `right.pose.rx` ...

    The first camera is where the others' poses are told.

    Args:
        cameras: Their names.
        lens: Of all of them, or one each.
    """
    own = zip(cameras, each_lens(lens, len(cameras)), strict=True)
    inside = tuple(f"{camera}.{name}" for camera, kind in own for name in intrinsics_of(kind))
    return inside + tuple(f"{camera}.pose.{name}" for camera in cameras[1:] for name in POSE_NAMES)


def rig_units(count: int = 2, lens: Lenses = POLYNOMIAL) -> tuple[str, ...]:
    """Return the units of `rig_names` of some cameras."""
    pose = ("rad",) * 3 + ("m",) * 3
    inside = (unit for own in each_lens(lens, count) for unit in intrinsic_units(own))
    return (*inside, *pose * (count - 1))


def rig_values(cameras: Sequence[Camera]) -> NDArray:
    """Return the numbers that `rig_names` names, in the first camera's frame."""
    inside = [camera.values for camera in cameras]
    X_FC = [cameras[0].X_CW @ camera.X_WC for camera in cameras[1:]]
    return np.concatenate([*inside, *(part for X in X_FC for part in _pose_values(X))])


def _pose_values(X: NDArray) -> tuple[NDArray, NDArray]:
    """Return the rotation vector [rad] and the position [m] of a pose, as `POSE_NAMES`."""
    return rotation_vector_of(X[:3, :3]), X[:3, 3]
