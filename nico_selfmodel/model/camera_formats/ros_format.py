"""ROS' camera_info, one camera a file: plumb_bob, rational_polynomial or equidistant."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.model.camera_formats.coefficients import (
    camera_of,
    coefficients_of,
    matrix,
    require_no_skew,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, POLYNOMIAL, RATIONAL

_MODELS = {POLYNOMIAL: "plumb_bob", RATIONAL: "rational_polynomial", FISHEYE: "equidistant"}


def ros_text(name: str, camera: Camera) -> str:
    """Return a camera as `camera_calibration_parsers` reads it.

    Raises:
        ModelError: If pixels are sheared.
    """
    require_no_skew(camera, "ROS")
    width, height = camera.image_size
    return yaml_text(
        {
            "image_width": width,
            "image_height": height,
            "camera_name": name,
            "camera_matrix": _matrix(camera.K),
            "distortion_model": _MODELS[camera.lens],
            "distortion_coefficients": _matrix(coefficients_of(camera)[None]),
            "rectification_matrix": _matrix(np.eye(3)),
            "projection_matrix": _matrix(np.column_stack([camera.K, np.zeros(3)])),
        }
    )


def _matrix(values: Any) -> dict[str, Any]:
    rows, cols = values.shape
    return {"rows": rows, "cols": cols, "data": values.ravel().tolist()}


def ros_camera(document: Mapping[str, Any], where: str) -> Camera:
    """Return the camera of a file that was parsed.

    Raises:
        DataError: If something is missing or wrong, or the lens has no counterpart.
    """
    model = document.get("distortion_model")
    if model not in _MODELS.values():
        raise DataError(
            f"{where}: distortion_model {model!r} has no counterpart; there are "
            f"{', '.join(_MODELS.values())}"
        )
    parts = {}
    for key in ("camera_matrix", "distortion_coefficients"):
        entry = document.get(key)
        if not isinstance(entry, Mapping) or "data" not in entry:
            raise DataError(f"{where}: {key!r} is missing")
        parts[key] = entry["data"]
    K = matrix(parts["camera_matrix"], (3, 3), f"{where}, camera_matrix")
    place = f"{where}, distortion_coefficients"
    bends = matrix(parts["distortion_coefficients"], (-1,), place).tolist()
    size = (document.get("image_width"), document.get("image_height"))
    focal = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    return camera_of(focal, bends, size, where, fisheye=model == _MODELS[FISHEYE])
