"""mrcal's .cameramodel, one camera a file: OPENCV4, 5 or 8 and PINHOLE.

`extrinsics` is rt_cam_ref: a rotation vector and a position that take points from the reference
frame to the camera's. The file is a Python literal.
"""

import ast
from typing import Any

import numpy as np

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_of
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.camera_formats.coefficients import (
    camera_of,
    coefficients_of,
    matrix,
    require_no_skew,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, RATIONAL

_COUNTS = {"PINHOLE": 0, "OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8}


def mrcal_text(camera: Camera) -> str:
    """Return a camera as mrcal reads it.

    Raises:
        ModelError: If its lens or pixels have no counterpart.
    """
    require_no_skew(camera, "mrcal")
    if camera.lens == FISHEYE:
        raise ModelError(
            "a fisheye has no counterpart in mrcal's file: learn the camera with --lens rational"
        )
    X_CW = camera.X_CW
    numbers = [camera.fx, camera.fy, camera.cx, camera.cy, *coefficients_of(camera).tolist()]
    pose = [*rotation_vector_of(X_CW[:3, :3]).tolist(), *X_CW[:3, 3].tolist()]
    kind = "OPENCV8" if camera.lens == RATIONAL else "OPENCV5"
    lines = {
        "lensmodel": repr(f"LENSMODEL_{kind}"),
        "extrinsics": repr(pose),
        "intrinsics": repr(numbers),
        "imagersize": repr(list(camera.image_size)),
    }
    return "{\n" + "".join(f"    {key!r}: {value},\n" for key, value in lines.items()) + "}\n"


def mrcal_camera(text: str, where: str) -> Camera:
    """Return the camera of a file.

    Raises:
        DataError: If it does not parse, or its lens has no counterpart.
    """
    try:
        found: Any = ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        raise DataError(f"{where}: no .cameramodel of mrcal: it does not parse") from None
    if not isinstance(found, dict) or "lensmodel" not in found:
        raise DataError(f"{where}: no .cameramodel of mrcal: 'lensmodel' is missing")
    kind = str(found["lensmodel"]).removeprefix("LENSMODEL_")
    if kind not in _COUNTS:
        raise DataError(
            f"{where}: the lens {found['lensmodel']!r} has no counterpart; those of "
            f"{', '.join(_COUNTS)} have"
        )
    numbers = matrix(found.get("intrinsics"), (4 + _COUNTS[kind],), f"{where}, intrinsics")
    pose = matrix(found.get("extrinsics", np.zeros(6)), (6,), f"{where}, extrinsics")
    X_CW = transform(rotation_from_vector(pose[:3]), pose[3:])
    focal, bends = numbers[:4].tolist(), numbers[4:].tolist()
    return camera_of(focal, bends, found.get("imagersize"), where, X_WC=inverse(X_CW))
