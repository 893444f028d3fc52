"""dataset.yaml: what a data set is, and what its columns mean."""

from pathlib import Path
from typing import Any

import yaml

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import (
    check_keys,
    integer_value,
    number_value,
    read_yaml_mapping,
    text_value,
)
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.names import found_instead, shown

FORMAT = "nico-dataset/1"
_KEYS = (
    "format",
    "name",
    "joints",
    "point_sigma_m",
    "pixel_sigma_px",
    "image_size",
    "cameras",
    "source",
    "seed",
)


def read_metadata(path: Path) -> dict[str, Any]:
    """Read and check the metadata of a data set.

    Returns:
        The fields of a `Dataset` that are not columns, by name.

    Raises:
        DataError: If the file is missing, not YAML, of another format or version, or not valid.
    """
    content = read_yaml_mapping(path)
    _check_format(content, path)
    check_keys(content, _KEYS, str(path))
    cameras = content.get("cameras")
    if not isinstance(cameras, dict | None):
        raise DataError(f"{path}: 'cameras' must be a mapping, got {shown(cameras)}")
    return {
        "name": text_value(content, "name", str(path)),
        "joints": read_joint_list(content, str(path)),
        "point_sigma_m": number_value(content, "point_sigma_m", str(path)),
        "pixel_sigma_px": number_value(content, "pixel_sigma_px", str(path)),
        "image_size": _image_size(content, path),
        "cameras": cameras,
        "source": text_value(content, "source", str(path), default=""),
        "seed": integer_value(content, "seed", str(path)),
    }


def read_joint_list(content: dict[str, Any], where: str) -> tuple[JointInfo, ...]:
    """Read the `joints` of a YAML mapping, from the base to the hand.

    Raises:
        DataError: If there are none, one is not valid, or two have one name.
    """
    entries = content.get("joints")
    if not isinstance(entries, list) or not entries:
        raise DataError(
            f"{where}: 'joints' must be a list with one entry per joint ('name' and"
            f" 'encoder_unit'), got {shown(entries)}"
        )
    joints: dict[str, JointInfo] = {}
    for number, entry in enumerate(entries, 1):
        joint = JointInfo.from_mapping(entry, f"{where}, joint {number}")
        if joint.name in joints:
            raise DataError(f"{where}, joint {number}: {joint.name!r} is already an earlier joint")
        joints[joint.name] = joint
    return tuple(joints.values())


def metadata_text(dataset: Dataset) -> str:
    """Return the metadata of a data set as YAML; floats read back exactly.

    Returns:
        Contents of `dataset.yaml`.

    Raises:
        ValueError: If `cameras` holds something that is not plain data.
    """
    size = dataset.image_size
    content = {
        "format": FORMAT,
        "name": dataset.name,
        "joints": [joint.to_mapping() for joint in dataset.joints],
        "point_sigma_m": dataset.point_sigma_m,
        "pixel_sigma_px": dataset.pixel_sigma_px,
        "image_size": None if size is None else list(size),
        "cameras": dataset.cameras,
        "source": dataset.source or None,
        "seed": dataset.seed,
    }
    content = {key: value for key, value in content.items() if value is not None}
    try:
        return yaml_text(content)
    except yaml.YAMLError as error:
        raise ValueError(f"cameras must be plain data (numbers, text, lists): {error}") from None


def _check_format(content: dict[str, Any], path: Path) -> None:
    found = content.get("format")
    if found == FORMAT:
        return
    if found is None:
        hint = found_instead("format", map(str, content))
        raise DataError(f"{path}: key 'format' is missing{hint}; expected 'format: {FORMAT}'")
    if found == "nico-dataset/2":
        raise DataError(
            f"{path}: it is a recording of any body ({found}); give it to `calibrate body` or "
            "`calibrate hand-eye`, or with a body to `evaluate`, `monitor` or `choose-poses`"
        )
    kind, _, version = str(found).partition("/")
    if kind == FORMAT.partition("/")[0] and version:
        raise DataError(
            f"{path}: version {version} of the format ({shown(found)}) is not supported; this"
            f" program reads {FORMAT!r}: use a newer one"
        )
    raise DataError(f"{path}: not a data set: format is {shown(found)}, expected {FORMAT!r}")


def _image_size(content: dict[str, Any], path: Path) -> tuple[int, int] | None:
    size = content.get("image_size")
    if size is None:
        return None
    whole = isinstance(size, list) and all(type(side) is int and side > 0 for side in size)
    if not whole or len(size) != 2:
        raise DataError(
            f"{path}: 'image_size' must be [width, height] in pixels, got {shown(size)}"
        )
    return (size[0], size[1])
