"""The calibration file of a lerobot arm as a servo configuration.

JSON: name of a motor -> `id`, `drive_mode`, `homing_offset`, `range_min`, `range_max`. The offset
is in the servo already, so that the range is in counts of its position register. As in lerobot the
angle is 0 in the middle of the range.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.json_text import parse_json
from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text
from nico_selfmodel.files.yaml_mapping import check_keys, integer_value
from nico_selfmodel.names import check_name, shown
from nico_selfmodel.servos.arm.servo_config import JointServo, ServoConfig
from nico_selfmodel.servos.makes import Make

_KEYS = ("id", "drive_mode", "homing_offset", "range_min", "range_max")
_BAUD = 1_000_000
_TO_STOP = 4.0
"""Accelerations are so many times the speed, each second."""


def import_lerobot(path: str | Path, make: Make, name: str, *, max_velocity: float) -> ServoConfig:
    """Return the servo configuration of a lerobot arm.

    Args:
        path: Its calibration file.
        max_velocity: Of every joint [rad/s]; the file has none.

    Raises:
        DataError: If the file is missing or not valid; names motor and key.
        ValueError: If servos of the make cannot be described so.
    """
    path = Path(path)
    content = parse_json(read_text(path, LARGEST_DOCUMENT), str(path))
    if not isinstance(content, Mapping) or not content:
        raise DataError(f"{path}: expected an object: motor -> calibration, got {shown(content)}")
    if not make.keeps_zero:
        raise ValueError(f"lerobot drives no {make.title}: give the make of the servos")
    joints = tuple(
        _joint(motor, entry, make, max_velocity, f"{path}, motor {shown(motor)}")
        for motor, entry in content.items()
    )
    try:
        return ServoConfig(name, joints, baud=_BAUD)
    except ValueError as error:
        raise DataError(f"{path}: {error}") from None


def _joint(motor: str, entry: Any, make: Make, max_velocity: float, where: str) -> JointServo:
    if not isinstance(entry, Mapping):
        raise DataError(f"{where}: expected an object with {', '.join(_KEYS)}, got {shown(entry)}")
    check_keys(entry, _KEYS, where)
    numbers = {key: integer_value(entry, key, where) for key in _KEYS}
    for key, value in numbers.items():
        if value is None:
            raise DataError(f"{where}: key {key!r} is missing")
    address, drive, offset, low, high = (number or 0 for number in numbers.values())
    if drive not in (0, 1):
        raise DataError(f"{where}: 'drive_mode' must be 0 or 1, got {drive}")
    if not low < high:
        raise DataError(f"{where}: 'range_min' must be less than 'range_max', got {low}, {high}")
    sign, zero = -1 if drive else 1, round((low + high) / 2)
    counts = make.counts_per_turn or 0.0
    ends = sorted(sign * (end - zero) * 2.0 * math.pi / counts for end in (low, high))
    try:
        check_name(motor, "the name of a motor")
        return JointServo(
            motor,
            address,
            counts,
            lower=ends[0],
            upper=ends[1],
            max_velocity=max_velocity,
            max_acceleration=_TO_STOP * max_velocity,
            sign=sign,
            make=make,
            zero_counts=zero,
            homing_offset=offset,
        )
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None
