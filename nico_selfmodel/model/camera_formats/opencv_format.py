"""OpenCV's FileStorage, YAML or JSON: M1 D1 M2 D2 R T, or camera_matrix of one camera.

p_R = R p_L + T takes points from the left camera's frame to the right one's. `fisheye_model` says
whether D is a fisheye's, as OpenCV's sample camera_calibration writes it.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.camera_formats.coefficients import (
    camera_of,
    coefficients_of,
    matrix,
    require_no_skew,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE

_ONE = ("camera_matrix", "distortion_coefficients")


def opencv_text(cameras: Mapping[str, Camera], *, as_json: bool) -> str:
    """Return cameras as `cv2.FileStorage` reads them.

    Args:
        cameras: Left and right, or one of them.

    Raises:
        ModelError: If pixels are sheared, or two cameras have lenses or images of different kinds.
    """
    entries: dict[str, Any] = {}
    if len({(camera.image_size, camera.lens == FISHEYE) for camera in cameras.values()}) > 1:
        raise ModelError(
            "OpenCV's file of a pair has one image size, and fisheyes alone or none: export these "
            "cameras with --format kalibr or mrcal, which have a place for each"
        )
    for number, camera in enumerate(cameras.values(), start=1):
        require_no_skew(camera, "OpenCV")
        names = _ONE if len(cameras) == 1 else (f"M{number}", f"D{number}")
        entries["image_width"], entries["image_height"] = camera.image_size
        entries["fisheye_model"] = int(camera.lens == FISHEYE)
        entries[names[0]], entries[names[1]] = camera.K, coefficients_of(camera)[None]
    if len(cameras) == 2:
        left, right = cameras.values()
        X_RL = right.X_CW @ left.X_WC
        entries |= {"R": X_RL[:3, :3], "T": X_RL[:3, 3:]}
    return _json(entries) if as_json else _yaml(entries)


def _yaml(entries: Mapping[str, Any]) -> str:
    lines = ["%YAML:1.0", "---"]
    for name, value in entries.items():
        if not isinstance(value, np.ndarray):
            lines.append(f"{name}: {value}")
            continue
        data = ", ".join(repr(float(x)) for x in value.ravel())
        lines += [f"{name}: !!opencv-matrix", f"   rows: {value.shape[0]}"]
        lines += [f"   cols: {value.shape[1]}", "   dt: d", f"   data: [ {data} ]"]
    return "\n".join(lines) + "\n"


def _json(entries: Mapping[str, Any]) -> str:
    def plain(value: Any) -> Any:
        if not isinstance(value, np.ndarray):
            return value
        rows, cols = value.shape
        data = value.ravel().tolist()
        return {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data}

    return json.dumps({name: plain(value) for name, value in entries.items()}, indent=4) + "\n"


def opencv_cameras(document: Mapping[str, Any], where: str) -> dict[str, Camera]:
    """Return the cameras of a file that was parsed.

    Raises:
        DataError: If something is missing or wrong.
    """
    size = (document.get("image_width"), document.get("image_height"))
    # Files that this package wrote before call it `fisheye`.
    fisheye = bool(document.get("fisheye_model", document.get("fisheye", 0)))
    if _ONE[0] in document:
        return {"left": _camera(document, *_ONE, size, where, fisheye)}
    left = _camera(document, "M1", "D1", size, where, fisheye)
    if "M2" not in document:
        return {"left": left}
    X_RL = transform(
        matrix(_data(document, "R", where), (3, 3), f"{where}, R"),
        matrix(_data(document, "T", where), (3,), f"{where}, T"),
    )
    right = _camera(document, "M2", "D2", size, where, fisheye, inverse(X_RL))
    return {"left": left, "right": right}


def _camera(
    document: Mapping[str, Any],
    intrinsics: str,
    distortion: str,
    size: tuple[Any, Any],
    where: str,
    fisheye: bool,
    X_WC: NDArray | None = None,
) -> Camera:
    K = matrix(_data(document, intrinsics, where), (3, 3), f"{where}, {intrinsics}")
    bends = matrix(_data(document, distortion, where), (-1,), f"{where}, {distortion}").tolist()
    focal = (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    place = f"{where}, {intrinsics}"
    return camera_of(focal, bends, size, place, fisheye=fisheye, X_WC=X_WC)


def _data(document: Mapping[str, Any], name: str, where: str) -> Any:
    entry = document.get(name)
    if isinstance(entry, Mapping) and "data" in entry:
        return entry["data"]
    raise DataError(f"{where}: the matrix {name!r} is missing")
