"""ROS' camera_info, one camera a file: plumb_bob, rational_polynomial or equidistant.

Of a pair each file tells how its camera stands to the rectified frame, whose x axis runs from the
left camera to the right one: `rectification_matrix` R turns points into it, and of
`projection_matrix` P = [f 0 cx -f B; 0 f cy 0; 0 0 1 0] the fourth column tells the baseline B.
Source: the message sensor_msgs/CameraInfo.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.camera_formats.coefficients import (
    camera_of,
    coefficients_of,
    matrix,
    require_no_skew,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, POLYNOMIAL, RATIONAL

_MODELS = {POLYNOMIAL: "plumb_bob", RATIONAL: "rational_polynomial", FISHEYE: "equidistant"}
_APART = 0.5
"""Cosine of how far a camera looks aside below which no picture of straight lines holds what both
cameras see: 60 deg."""


def ros_texts(cameras: Mapping[str, Camera]) -> dict[str, str]:
    """Return cameras as `camera_calibration_parsers` reads them, by name; a pair rectified.

    Raises:
        ModelError: If pixels are sheared.
    """
    alone = [(np.eye(3), np.column_stack([camera.K, np.zeros(3)])) for camera in cameras.values()]
    told = zip(cameras.items(), rectified_pair(cameras) or alone, strict=True)
    return {name: _text(name, camera, R, P) for (name, camera), (R, P) in told}


def rectified_pair(cameras: Mapping[str, Camera]) -> list[tuple[NDArray, NDArray]] | None:
    """Return R (3, 3) and P (3, 4) of two cameras; None of others, and of two that look apart.

    x (of cameras above each other y) runs along the baseline, z as near as can be to where both
    look, as in A. Fusiello, E. Trucco and A. Verri, *A compact algorithm for rectification of
    stereo pairs* (2000); images keep the scale and the place of their middles.
    """
    if len(cameras) != 2:
        return None
    left, right = cameras.values()
    X_LR = left.X_CW @ right.X_WC
    R_LR, baseline = X_LR[:3, :3], X_LR[:3, 3]
    looks = np.array([0.0, 0.0, 1.0]) + R_LR[:, 2]
    along = int(abs(baseline[1]) > abs(baseline[0]))
    if np.linalg.norm(np.cross(looks, baseline)) <= _APART * np.linalg.norm(baseline):
        return None  # one place, or one before the other
    first = baseline * np.copysign(1.0 / np.linalg.norm(baseline), baseline[along])
    second = np.cross(looks, first) if along == 0 else np.cross(first, looks)
    second /= np.linalg.norm(second)
    x, y = (first, second) if along == 0 else (second, first)
    R_l = np.stack([x, y, np.cross(x, y)])
    R_r = R_l @ R_LR
    if min(R_l[2, 2], R_r[2, 2]) < _APART:
        return None
    f = min(left.fx, left.fy, right.fx, right.fy)
    middle = [R[:2, 2] / R[2, 2] for R in (R_l, R_r)]
    c = np.array(left.image_size) / 2.0 - f * np.mean(middle, axis=0)
    P_l = np.array([[f, 0.0, c[0], 0.0], [0.0, f, c[1], 0.0], [0.0, 0.0, 1.0, 0.0]])
    P_r = P_l.copy()
    P_r[:2, 3] = -f * (R_l @ baseline)[:2]
    return [(R_l, P_l), (R_r, P_r)]


def _text(name: str, camera: Camera, R: NDArray, P: NDArray) -> str:
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
            "rectification_matrix": _matrix(R),
            "projection_matrix": _matrix(P),
        }
    )


def _matrix(values: Any) -> dict[str, Any]:
    rows, cols = values.shape
    return {"rows": rows, "cols": cols, "data": values.ravel().tolist()}


def ros_camera(document: Mapping[str, Any], where: str) -> Camera:
    """Return the camera of a file that was parsed, its pose in the rectified frame.

    Raises:
        DataError: If something is missing or wrong, or the lens has no counterpart.
    """
    model = document.get("distortion_model")
    if model not in _MODELS.values():
        raise DataError(
            f"{where}: distortion_model {model!r} has no counterpart; there are "
            f"{', '.join(_MODELS.values())}"
        )
    K = _read(document, "camera_matrix", (3, 3), where)
    bends = _read(document, "distortion_coefficients", (-1,), where).tolist()
    size = (document.get("image_width"), document.get("image_height"))
    focal = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    fisheye, X_WC = model == _MODELS[FISHEYE], _pose(document, where)
    return camera_of(focal, bends, size, where, fisheye=fisheye, X_WC=X_WC)


def _pose(document: Mapping[str, Any], where: str) -> NDArray:
    """Return the pose in the rectified frame; that of a camera by itself if nothing tells it."""
    if "rectification_matrix" not in document and "projection_matrix" not in document:
        return np.eye(4)
    R = _read(document, "rectification_matrix", (3, 3), where)
    P = _read(document, "projection_matrix", (3, 4), where)
    if P[0, 0] <= 0.0 or P[1, 1] <= 0.0:
        raise DataError(f"{where}, projection_matrix: focal lengths must be positive")
    return transform(R, [-P[0, 3] / P[0, 0], -P[1, 3] / P[1, 1], 0.0])


def _read(document: Mapping[str, Any], key: str, shape: tuple[int, ...], where: str) -> NDArray:
    entry = document.get(key)
    if not isinstance(entry, Mapping) or "data" not in entry:
        raise DataError(f"{where}: {key!r} is missing")
    return matrix(entry["data"], shape, f"{where}, {key}")
