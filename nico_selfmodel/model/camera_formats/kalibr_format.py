"""Kalibr's camchain: pinhole cameras with radtan (k1 k2 p1 p2) or equidistant lenses.

T_cn_cnm1 takes points from the frame of the camera before to that of a camera.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.camera_formats.coefficients import (
    camera_of,
    coefficients_of,
    matrix,
    require_no_skew,
)
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import FISHEYE, RATIONAL
from nico_selfmodel.model.cameras.rig_parameters import SIDES


def kalibr_text(cameras: Mapping[str, Camera]) -> str:
    """Return cameras as Kalibr writes them.

    Args:
        cameras: Any number, in the order of the chain.

    Raises:
        ModelError: If a lens or pixels have no counterpart.
    """
    chain: dict[str, Any] = {}
    before: Camera | None = None
    for number, camera in enumerate(cameras.values()):
        require_no_skew(camera, "Kalibr")
        if camera.lens == RATIONAL or (camera.lens != FISHEYE and camera.k3 != 0.0):
            raise ModelError(
                "a lens with k3 to k6 has no counterpart in Kalibr: learn the cameras with "
                "`--lens polynomial --fix k3=0`, or `--lens fisheye`"
            )
        entry: dict[str, Any] = {
            "camera_model": "pinhole",
            "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
            "distortion_model": "equidistant" if camera.lens == FISHEYE else "radtan",
            "distortion_coeffs": coefficients_of(camera)[:4].tolist(),
            "resolution": list(camera.image_size),
        }
        if before is not None:
            entry["T_cn_cnm1"] = (camera.X_CW @ before.X_WC).tolist()
        chain[f"cam{number}"], before = entry, camera
    return yaml_text(chain)


def kalibr_cameras(document: Mapping[str, Any], where: str) -> dict[str, Camera]:
    """Return the cameras of a file that was parsed, the first one at the world.

    One or two are `left` and `right`, more keep Kalibr's names.

    Raises:
        DataError: If something is missing or wrong.
    """
    chain = [f"cam{number}" for number in range(len(document))]
    if set(document) != set(chain):
        raise DataError(
            f"{where}: expected {', '.join(chain)}, got {', '.join(map(str, document))}"
        )
    found: dict[str, Camera] = {}
    before = np.eye(4)
    for name, called in zip(chain, SIDES if len(chain) <= 2 else chain, strict=False):
        entry, place = document[name], f"{where}, {name}"
        if not isinstance(entry, Mapping):
            raise DataError(f"{place}: expected a camera")
        if entry.get("camera_model") != "pinhole":
            raise DataError(
                f"{place}: camera_model {entry.get('camera_model')!r} has no counterpart, only "
                "pinhole has"
            )
        kind = entry.get("distortion_model")
        if kind not in ("radtan", "equidistant"):
            raise DataError(f"{place}: distortion_model {kind!r} has no counterpart")
        bends = matrix(entry.get("distortion_coeffs"), (4,), f"{place}, distortion_coeffs")
        focal = matrix(entry.get("intrinsics"), (4,), f"{place}, intrinsics")
        if found:
            X_RL = matrix(entry.get("T_cn_cnm1"), (4, 4), f"{place}, T_cn_cnm1")
            before = before @ inverse(X_RL)
        size, fish = entry.get("resolution"), kind == "equidistant"
        found[called] = camera_of(
            focal.tolist(), bends.tolist(), size, place, fisheye=fish, X_WC=before
        )
    return found
