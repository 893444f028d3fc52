"""Write cameras for other programs, and read theirs."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.json_text import parse_json
from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text
from nico_selfmodel.files.yaml_text import parse_yaml
from nico_selfmodel.model.camera_formats.kalibr_format import kalibr_cameras, kalibr_text
from nico_selfmodel.model.camera_formats.mrcal_format import mrcal_camera, mrcal_text
from nico_selfmodel.model.camera_formats.opencv_format import opencv_cameras, opencv_text
from nico_selfmodel.model.camera_formats.ros_format import ros_camera, ros_texts
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.names import refuse_unknown

FORMATS = {"opencv": ".yaml", "opencv-json": ".json", "ros": ".yaml", "kalibr": ".yaml"}
FORMATS["mrcal"] = ".cameramodel"
"""Name of each, and how its files end."""


def camera_texts(cameras: Mapping[str, Camera], kind: str) -> dict[str, str]:
    """Return files with cameras, by name.

    Args:
        cameras: Any number; a file of OpenCV's holds a pair at most.
        kind: One of `FORMATS`.

    Raises:
        ModelError: If a camera has no counterpart there, or there is none.
        ValueError: If there is no such format.
    """
    refuse_unknown("format", kind, FORMATS)
    if not cameras:
        raise ModelError("the self-model has no camera: learn them with `calibrate stereo`")
    end = FORMATS[kind]
    if kind == "ros":
        return {f"{side}{end}": text for side, text in ros_texts(cameras).items()}
    if kind == "mrcal":
        return {f"{side}{end}": mrcal_text(camera) for side, camera in cameras.items()}
    if kind == "kalibr":
        return {f"camchain{end}": kalibr_text(cameras)}
    if len(cameras) > 2:
        raise ModelError(
            f"{len(cameras)} cameras have no counterpart in OpenCV's files, which hold a pair: "
            "take kalibr, mrcal or ros"
        )
    return {f"cameras{end}": opencv_text(cameras, as_json=kind == "opencv-json")}


def read_cameras(paths: Sequence[Path]) -> dict[str, Camera]:
    """Read cameras of any of `FORMATS`, told by what is in the file.

    Args:
        paths: One file, or one for each camera; or intrinsics.yml and extrinsics.yml of a pair, as
            OpenCV's stereo_calib writes them.

    Returns:
        `left`, and `right` of two; more are called as their files. Of ROS' pairs the left camera's
        frame is the world, as of OpenCV's.

    Raises:
        DataError: If a file is missing, does not parse, or has no counterpart here; if files of two
            cameras say nothing of how these stand to each other.
    """
    documents = [_document(path) for path in paths]
    if len(paths) == 1:
        kind, found = _cameras_in(documents[0], str(paths[0]))
        return _in_the_first_ones(found) if kind == "ros" else found
    whole = _of_two_parts(*documents)
    if whole:
        return opencv_cameras(whole, " and ".join(map(str, paths)))
    stems = [path.stem for path in paths]
    names = SIDES if len(paths) == 2 else stems
    if len(set(names)) < len(names):
        raise DataError(f"files of cameras have names of their own, got {', '.join(stems)}")
    read = [_only_camera(*one) for one in zip(documents, paths, strict=True)]
    kinds, cameras = zip(*read, strict=True)
    found = dict(zip(names, cameras, strict=True))
    if set(kinds) == {"ros"}:
        found = _in_the_first_ones(found)
    places = [camera.X_WC for camera in found.values()]
    for (one, X), (other, Y) in combinations(zip(paths, places, strict=True), 2):
        if (X == Y).all():
            raise DataError(
                f"{one} and {other} put both cameras in one place: files that know how cameras "
                "stand to each other are those of opencv, kalibr and mrcal, and of ROS' pairs"
            )
    return found


def _in_the_first_ones(cameras: Mapping[str, Camera]) -> dict[str, Camera]:
    """Return cameras in the first one's frame."""
    first = next(iter(cameras.values()))
    others = list(cameras.items())[1:]
    found = {name: camera.at(first.X_CW @ camera.X_WC) for name, camera in others}
    return {next(iter(cameras)): first.at(np.eye(4)), **found}


def _only_camera(document: str | dict[str, Any], path: Path) -> tuple[str, Camera]:
    kind, found = _cameras_in(document, str(path))
    if len(found) != 1:
        raise DataError(f"{path}: holds {len(found)} cameras: give it alone")
    return kind, next(iter(found.values()))


def _cameras_in(document: str | dict[str, Any], where: str) -> tuple[str, dict[str, Camera]]:
    if isinstance(document, str):
        return "mrcal", {"left": mrcal_camera(document, where)}
    if "distortion_model" in document:
        return "ros", {"left": ros_camera(document, where)}
    if any(str(key).startswith("cam") and str(key)[3:].isdigit() for key in document):
        return "kalibr", kalibr_cameras(document, where)
    if "M1" in document or "camera_matrix" in document:
        return "opencv", opencv_cameras(document, where)
    raise DataError(f"{where}: holds no cameras of {', '.join(FORMATS)}")


def _of_two_parts(*documents: str | dict[str, Any]) -> dict[str, Any]:
    """Return OpenCV's intrinsics and extrinsics of a pair as one, nothing of other files."""
    one, two = documents if len(documents) == 2 else ("", "")
    if isinstance(one, str) or isinstance(two, str):
        return {}
    parts = ((one, two), (two, one))
    is_pair = any({"M1", "M2"} <= a.keys() and {"R", "T"} <= b.keys() for a, b in parts)
    return one | two if is_pair else {}


def _document(path: Path) -> str | dict[str, Any]:
    """Return what a file holds: a text of mrcal's, and what others parse to."""
    text = read_text(path, LARGEST_DOCUMENT)
    is_mrcals = path.suffix == FORMATS["mrcal"] or "lensmodel" in text[:1000]
    return text if is_mrcals else _parsed(text, str(path))


def _parsed(text: str, where: str) -> dict[str, Any]:
    if text.lstrip().startswith("{"):
        document = parse_json(text, where)
    else:
        # OpenCV's first line is no YAML, nor are its tags of this world.
        body = text.removeprefix("%YAML:1.0").replace("!!opencv-matrix", "")
        document = parse_yaml(body.lstrip().removeprefix("---"), where)
    if not isinstance(document, dict):
        raise DataError(f"{where}: holds no cameras")
    return document
