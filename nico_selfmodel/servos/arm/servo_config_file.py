"""The servo configuration on disk: YAML, `format: nico-servos/1`, angles in degrees."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.whole import write_whole
from nico_selfmodel.files.yaml_mapping import (
    check_keys,
    integer_value,
    number_value,
    read_yaml_mapping,
    text_value,
)
from nico_selfmodel.names import check_name, shown
from nico_selfmodel.servos.arm.servo_config import HomePlan, JointServo, ServoConfig
from nico_selfmodel.servos.makes import Make, make_named
from nico_selfmodel.servos.pic_servo.protocol.gains import Gains

FORMAT = "nico-servos/1"
_KEYS = ("format", "name", "make", "baud", "heartbeat_s", "latency_ms", "joints")
_NUMBERS = ("counts_per_turn", "lower_deg", "upper_deg", "max_velocity_deg_s")
_JOINT_KEYS = (
    *("name", "address", *_NUMBERS, "max_acceleration_deg_s2"),
    *("sign", "output", "gains", "home", "zero_counts", "homing_offset"),
)
_BOARD_KEYS = ("output", "gains")
_HOME_KEYS = ("method", "at_deg", "speed_deg_s", "travel_deg")


def load_servo_config(path: str | Path) -> ServoConfig:
    """Read a servo configuration.

    Raises:
        DataError: If the file is missing or not valid; names file and key.
    """
    path = Path(path)
    content = read_yaml_mapping(path)
    if content.get("format") != FORMAT:
        raise DataError(
            f"{path}: not a servo configuration: format is {shown(content.get('format'))}, "
            f"expected {FORMAT!r}"
        )
    where = str(path)
    check_keys(content, _KEYS, where)
    entries = content.get("joints")
    if not isinstance(entries, list) or not entries:
        raise DataError(
            f"{where}: 'joints' must be a list with one entry a joint, got {shown(entries)}"
        )
    make = _make(content, where)
    joints = tuple(_joint(entry, make, f"{where}, joint {k}") for k, entry in enumerate(entries, 1))
    options = {}
    if (baud := integer_value(content, "baud", where)) is not None:
        options["baud"] = baud
    if (heartbeat := number_value(content, "heartbeat_s", where)) is not None:
        options["heartbeat"] = heartbeat
    if (latency := number_value(content, "latency_ms", where)) is not None:
        options["latency"] = latency * 1e-3
    try:
        return ServoConfig(_name(content, where), joints, **options)
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None


def save_servo_config(config: ServoConfig, path: str | Path) -> None:
    """Write a servo configuration, one line a joint; reading it gives the same one.

    Raises:
        OSError: If the folder is missing or cannot be written to.
    """
    lines = [
        f"format: {FORMAT}",
        f"name: {json.dumps(config.name)}",
        f"make: {config.make.name}",
        f"baud: {config.baud}",
        f"heartbeat_s: {config.heartbeat}",
        f"latency_ms: {1e3 * config.latency}",
        "joints:",
        *(f"  - {json.dumps(_entry(joint))}" for joint in config.joints),
    ]
    write_whole(Path(path), "\n".join(lines) + "\n")


def _entry(joint: JointServo) -> dict[str, Any]:
    home = joint.home
    entry = {
        "name": joint.name,
        "address": joint.address,
        "counts_per_turn": joint.counts_per_turn,
        "sign": joint.sign,
        "lower_deg": math.degrees(joint.lower),
        "upper_deg": math.degrees(joint.upper),
        "max_velocity_deg_s": math.degrees(joint.max_velocity),
        "max_acceleration_deg_s2": math.degrees(joint.max_acceleration),
        "home": {
            "method": home.method,
            "at_deg": math.degrees(home.at),
            "speed_deg_s": math.degrees(home.speed),
            "travel_deg": math.degrees(home.travel),
        },
    }
    if not joint.make.keeps_zero:
        return {**entry, "output": joint.output, "gains": asdict(joint.gains)}
    offset = {} if joint.homing_offset is None else {"homing_offset": joint.homing_offset}
    return {**entry, "zero_counts": joint.zero_counts, **offset}


def _make(content: Mapping[str, Any], where: str) -> Make:
    try:
        return make_named(text_value(content, "make", where) if "make" in content else "pic-servo")
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None


def _joint(entry: Any, make: Make, where: str) -> JointServo:
    if not isinstance(entry, Mapping):
        raise DataError(
            f"{where}: must be a mapping with 'name', 'address', ..., got {shown(entry)}"
        )
    name = _name(entry, where)
    where = f"{where} ({name})"
    check_keys(entry, _JOINT_KEYS, where)
    strange = [key for key in _BOARD_KEYS if key in entry and make.keeps_zero]
    if strange:
        raise DataError(f"{where}: {strange[0]!r} is for PIC-SERVO boards: leave it out")
    address = integer_value(entry, "address", where)
    sign = integer_value(entry, "sign", where)
    numbers = {key: number_value(entry, key, where) for key in _NUMBERS}
    numbers["max_acceleration_deg_s2"] = number_value(entry, "max_acceleration_deg_s2", where)
    if numbers["counts_per_turn"] is None:
        numbers["counts_per_turn"] = make.counts_per_turn
    missing = [key for key, value in {"address": address, **numbers}.items() if value is None]
    if missing or address is None:
        raise DataError(f"{where}: key {missing[0]!r} is missing")
    try:
        return JointServo(
            name=name,
            address=address,
            counts_per_turn=numbers["counts_per_turn"] or 0.0,
            lower=math.radians(numbers["lower_deg"] or 0.0),
            upper=math.radians(numbers["upper_deg"] or 0.0),
            max_velocity=math.radians(numbers["max_velocity_deg_s"] or 0.0),
            max_acceleration=math.radians(numbers["max_acceleration_deg_s2"] or 0.0),
            sign=1 if sign is None else sign,
            output="three_phase" if make.keeps_zero else text_value(entry, "output", where),
            gains=_gains(entry.get("gains"), f"{where}, gains"),
            home=_home(entry.get("home"), f"{where}, home"),
            make=make,
            zero_counts=integer_value(entry, "zero_counts", where),
            homing_offset=integer_value(entry, "homing_offset", where),
        )
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None


def _name(entry: Mapping[str, Any], where: str) -> str:
    name = text_value(entry, "name", where)
    if not name.strip():
        raise DataError(f"{where}: 'name' must not be empty")
    try:
        check_name(name, "'name'")
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None
    return name


def _gains(entry: Any, where: str) -> Gains:
    entry = {} if entry is None else entry
    if not isinstance(entry, Mapping):
        raise DataError(f"{where}: must be a mapping of gains, got {shown(entry)}")
    names = [field.name for field in fields(Gains)]
    check_keys(entry, names, where)
    values = {name: integer_value(entry, name, where) for name in names}
    return Gains(**{name: value for name, value in values.items() if value is not None})


def _home(entry: Any, where: str) -> HomePlan:
    if entry is None:
        return HomePlan()
    if not isinstance(entry, Mapping):
        raise DataError(
            f"{where}: must be a mapping with 'method' and 'at_deg', got {shown(entry)}"
        )
    check_keys(entry, _HOME_KEYS, where)
    angles = [
        math.radians(number_value(entry, key, where) or 0.0)
        for key in ("at_deg", "speed_deg_s", "travel_deg")
    ]
    return HomePlan(text_value(entry, "method", where), *angles)
