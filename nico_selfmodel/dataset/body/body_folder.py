"""A recording of a body as a folder: `dataset.yaml`, `poses.csv`, `observations.csv`."""

import warnings
from collections.abc import Collection, Sequence
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import numbered_rows
from nico_selfmodel.dataset.array_hash import array_hash
from nico_selfmodel.dataset.body.body_dataset import (
    ANY_POSE,
    WIDTH,
    BodyDataset,
    ObservationTable,
    check_names,
)
from nico_selfmodel.dataset.body.copies import without_copies
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.plausible_body import check_plausible_body
from nico_selfmodel.dataset.body.sensors import SENSOR_COLUMNS, MarkerInfo, SensorInfo
from nico_selfmodel.dataset.columns import APPROACH, ENCODER
from nico_selfmodel.dataset.csv_table import CsvTable
from nico_selfmodel.dataset.plain_table import plain_integers
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_cells import number_cells, table_text, text_cells
from nico_selfmodel.files.folder_contents import found_at
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.files.whole import folder_in_place_of, refuse_existing
from nico_selfmodel.files.yaml_mapping import (
    check_keys,
    integer_value,
    read_yaml_mapping,
    text_value,
)
from nico_selfmodel.files.yaml_text import yaml_text
from nico_selfmodel.geometry.rotation import rotation_from_quaternion, rotation_vectors_of
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD_NAME
from nico_selfmodel.names import listed, shown

FORMAT = "nico-dataset/2"
FILES = ("dataset.yaml", "poses.csv", "observations.csv")
_OF_ROWS = ("pose", "sensor", "marker", "other", "values", "mirror")
_KEYS = ("format", "name", "joints", "markers", "sensors", "source", "seed")
_POSE = ("x_m", "y_m", "z_m", "rx", "ry", "rz")
_QUATERNION = ("qx", "qy", "qz", "qw")
_VALUES = tuple(dict.fromkeys(chain.from_iterable(SENSOR_COLUMNS.values())))
"""Every column that a sensor of some kind fills."""


def is_body_dataset(folder: str | PathLike[str]) -> bool:
    """Return whether a folder holds a recording of this form: `poses.csv`, `observations.csv`."""
    return any((Path(folder) / name).is_file() for name in FILES[1:])


def load_body_dataset(folder: str | PathLike[str]) -> BodyDataset:
    """Read a recording.

    Args:
        folder: With `dataset.yaml`, `poses.csv` and `observations.csv`.

    Raises:
        DataError: If anything is missing, not valid or not plausible; names file, line and column.
    """
    folder = Path(folder)
    if not any((folder / name).is_file() for name in FILES[1:]):
        makes = f"; `nico-selfmodel convert {folder} --out {folder}_recording` makes one of it"
        raise DataError(
            f"{found_at(folder)}; a recording of any body is a folder with "
            f"{listed(FILES)}{makes if (folder / 'samples.csv').is_file() else ''}"
        )
    for name in FILES:
        if not (folder / name).is_file():
            raise DataError(
                f"{folder}: {name} is missing; a recording of any body has {listed(FILES)}"
            )
    head = _read_head(folder / FILES[0])
    poses = CsvTable.read(folder / FILES[1])
    sample = poses.integers("sample")
    readings, flanges = _read_joints(poses, head["joints"])
    sides = [poses.sides(f"{APPROACH}.{joint.name}") for joint in head["joints"]]
    columns = tuple(poses.columns)
    del poses  # a million rows of text take half a gigabyte
    table = CsvTable.read(folder / FILES[2])
    observations = _read_observations(table, sample, head["markers"], head["sensors"])
    try:
        data = BodyDataset(
            sample=sample,
            readings=readings,
            flanges=flanges,
            approach=np.column_stack(sides),
            observations=observations,
            **head,
        )
        check_plausible_body(data)
        _refuse_unused_readings(data.joints, columns)
    except (DataError, ValueError) as error:
        raise DataError(f"{folder}: {error}") from None
    return without_copies(data)


def save_body_dataset(
    data: BodyDataset, folder: str | PathLike[str], *, force: bool = False
) -> None:
    """Write a recording to a folder, whole or not at all.

    Raises:
        DataError: If the folder exists (without `force`) or cannot be written, or the recording
            could not be loaded again, for what `load_body_dataset` refuses.
    """
    folder = real_path(folder)
    refuse_existing(folder, force=force)
    lines = range(2, len(data.observations) + 2)
    _refuse_copies(data.observations, folder / FILES[2], lines)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # whoever loads it is warned
            check_plausible_body(data)
    except DataError as error:
        raise DataError(f"{folder}: {error}") from None
    texts = (_head_text(data), _poses_text(data), _observations_text(data))
    try:
        with folder_in_place_of(folder, keep_others=True) as fresh:
            for name, text in zip(FILES, texts, strict=True):
                (fresh / name).write_bytes(text.encode())
    except OSError as error:
        raise DataError(f"{folder}: cannot be written: {error.strerror or error}") from error


def body_content_hash(data: BodyDataset) -> str:
    """Return the hash by which a recording is known again, however its files are written."""
    told = np.array([joint.motion == FLANGE for joint in data.joints])
    read = np.array([joint.is_read for joint in data.joints]) & ~told
    poses = {
        "sample": data.sample,
        "readings": np.where(read, data.readings, np.nan),
        "flanges": np.where(told[:, None], np.asarray(data.flanges), np.nan),
        "approach": np.where(read, np.asarray(data.approach), 0),
    }
    rows = {name: getattr(data.observations, name) for name in _OF_ROWS}
    return array_hash(_head_text(data), poses | rows)


def _read_head(path: Path) -> dict[str, Any]:
    content = read_yaml_mapping(path)
    if content.get("format") != FORMAT:
        raise DataError(f"{path}: expected 'format: {FORMAT}', got {shown(content.get('format'))}")
    check_keys(content, _KEYS, str(path))
    joints: list[LinkJoint] = []
    for entry in _entries(content, "joints", path):
        before = joints[-1].name if joints else WORLD_NAME
        where = f"{path}, joint {len(joints) + 1}"
        joints.append(LinkJoint.from_mapping(entry, before, where))
    where = f"{path}, markers"
    markers = [
        MarkerInfo.from_mapping(entry, where) for entry in _entries(content, "markers", path)
    ]
    where = f"{path}, sensors"
    sensors = [
        SensorInfo.from_mapping(entry, where) for entry in _entries(content, "sensors", path)
    ]
    try:
        check_names(joints, markers, sensors)
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    return {
        "name": text_value(content, "name", str(path)),
        "joints": tuple(joints),
        "markers": tuple(markers),
        "sensors": tuple(sensors),
        "source": text_value(content, "source", str(path), ""),
        "seed": integer_value(content, "seed", str(path)),
    }


def _entries(content: dict[str, Any], key: str, path: Path) -> list[Any]:
    entries = content.get(key)
    if not isinstance(entries, list) or not entries:
        raise DataError(f"{path}: {key!r} must be a list with an entry each, got {shown(entries)}")
    # YAML 1.1 reads a bare `on` as true.
    return [
        {"on" if name is True else name: value for name, value in entry.items()}
        if isinstance(entry, dict)
        else entry
        for entry in entries
    ]


def _read_joints(table: CsvTable, joints: Sequence[LinkJoint]) -> tuple[NDArray, NDArray | None]:
    readings, flanges = np.full((len(table), len(joints)), np.nan), None
    if any(joint.motion == FLANGE for joint in joints):
        flanges = np.full((len(table), len(joints), 6), np.nan)
    for i, joint in enumerate(joints):
        if joint.motion == FLANGE and flanges is not None:
            flanges[:, i] = _poses_in(table, f"flange.{joint.name}.", empty=False)
        elif joint.is_read:
            readings[:, i] = table.numbers(f"{ENCODER}.{joint.name}")
    return readings, flanges


def _refuse_unused_readings(joints: Sequence[LinkJoint], columns: Collection[str]) -> None:
    for joint in joints:
        if joint.follows and (column := f"{ENCODER}.{joint.name}") in columns:
            raise DataError(
                f"{FILES[1]}, column {column!r}: joint {joint.name!r} follows "
                f"{listed(joint.follows)}, what an encoder reads of it would not be used; leave "
                f"out the column, or `follows` in {FILES[0]}"
            )


def _poses_in(table: CsvTable, prefix: str, *, empty: bool) -> NDArray:
    """Return x, y, z and rotation vector of each row; quaternions are read, too. (N, 6)."""
    out = np.full((len(table), 6), np.nan)
    for k, name in enumerate(_POSE[:3]):
        if not empty or prefix + name in table.columns:
            out[:, k] = table.numbers(prefix + name, empty_allowed=empty)
    if prefix + "qw" in table.columns:
        q = np.stack([table.numbers(prefix + c, empty_allowed=empty) for c in _QUATERNION], axis=1)
        length = np.linalg.norm(q, axis=1)
        bad = np.isfinite(length) & (np.abs(length - 1.0) > 0.01)
        if bad.any():
            row = int(np.argmax(bad))
            raise DataError(
                f"{table.where(row)}: the quaternion {q[row].tolist()} is not of unit length"
            )
        there = np.isfinite(length)
        out[there, 3:] = rotation_vectors_of(
            rotation_from_quaternion(q[there] / length[there, None])
        )
        return out
    for k, name in enumerate(_POSE[3:], start=3):
        if not empty or prefix + name in table.columns:
            out[:, k] = table.numbers(prefix + name, empty_allowed=empty)
    return out


def _read_observations(
    table: CsvTable,
    sample: NDArray,
    markers: Sequence[MarkerInfo],
    sensors: Sequence[SensorInfo],
) -> ObservationTable:
    sensor = _indices(table, "sensor", [s.name for s in sensors])
    marker = _indices(table, "marker", [m.name for m in markers])
    other = np.full(len(table), -1)
    if "other" in table.columns:
        given = table.texts("other") != ""
        other = np.where(given, _indices(table, "other", [m.name for m in markers], given), -1)
    columns = {name: np.full(len(table), np.nan) for name in _VALUES}
    columns |= dict(zip(_POSE, _poses_in(table, "", empty=True).T, strict=True))
    for name in _VALUES:
        if name not in _POSE and name in table.columns:
            columns[name] = table.numbers(name, empty_allowed=True)
    values = np.full((len(table), WIDTH), np.nan)
    for i, info in enumerate(sensors):
        own, names = sensor == i, SENSOR_COLUMNS[info.kind]
        for name in _VALUES:
            wanted = np.isfinite(columns[name]) == (name in names)
            if not wanted[own].all():
                row = int(np.flatnonzero(own & ~wanted)[0])
                says = "empty" if name in names else "filled"
                raise DataError(
                    f"{table.where(row, name)}: the cell is {says}, but sensor {info.name!r} "
                    f"({info.kind}) measures {', '.join(names) or 'no number'}, all of them and "
                    "nothing else"
                )
        for k, name in enumerate(names):
            values[own, k] = columns[name][own]
    mirrors = table.texts("mirror") if "mirror" in table.columns else np.full(len(table), "")
    found = ObservationTable(_samples_of(table, sample), sensor, marker, other, values, mirrors)
    _refuse_copies(found, table.path, table.lines)
    return found


def _refuse_copies(found: ObservationTable, path: Path, lines: Sequence[int]) -> None:
    """Refuse a row that stands there twice: it would count as two that were measured."""
    mirror = np.unique(found.mirror, return_inverse=True)[1]
    who = [found.pose, found.sensor, found.marker, found.other, mirror]
    rows = np.column_stack([*who, np.nan_to_num(found.values)])
    first, same = numbered_rows(rows)
    original = first[same]
    copies = np.flatnonzero((original != np.arange(len(rows))) & (found.pose != ANY_POSE))
    if len(copies):
        copy = int(copies[0])
        raise DataError(
            f"{path}, line {lines[copy]}, column 'sample': the row is the same, to the last digit, "
            f"as line {lines[int(original[copy])]}: it would count twice, leave one out"
        )


def _samples_of(table: CsvTable, sample: NDArray) -> NDArray:
    given = plain_integers(table.cells("sample"))
    if given is not None:
        order = np.argsort(sample, kind="stable")
        found = order[np.minimum(np.searchsorted(sample, given, sorter=order), len(sample) - 1)]
        if (sample[found] == given).all():
            return found.astype(np.int64)
    cells = table.texts("sample").tolist()
    index = {str(number): k for k, number in enumerate(sample.tolist())} | {"": ANY_POSE}
    found = list(map(index.get, cells))
    if None in found:
        row = found.index(None)
        raise DataError(
            f"{table.where(row, 'sample')}: {shown(cells[row])} is no sample of poses.csv"
        )
    return np.array(found, dtype=np.int64)


def _indices(
    table: CsvTable, column: str, names: Sequence[str], rows: NDArray | None = None
) -> NDArray:
    index = {name: k for k, name in enumerate(names)}
    cells = table.cells(column)
    place = {cell: index.get(cell.strip(), -1) for cell in set(cells)}
    found = np.full(len(cells), next(iter(place.values())))
    if len(place) > 1:
        found = np.fromiter(map(place.__getitem__, cells), np.int64, len(cells))
    unknown = found < 0 if rows is None else (found < 0) & rows
    if unknown.any():
        row = int(np.argmax(unknown))
        name = cells[row].strip()
        raise DataError(
            f"{table.where(row, column)}: {shown(name)} is not listed in dataset.yaml; there "
            f"are {listed(names, name)}"
        )
    return found


def _head_text(data: BodyDataset) -> str:
    content = {
        "format": FORMAT,
        "name": data.name,
        "joints": [joint.to_mapping() for joint in data.joints],
        "markers": [marker.to_mapping() for marker in data.markers],
        "sensors": [sensor.to_mapping() for sensor in data.sensors],
        "source": data.source or None,
        "seed": data.seed,
    }
    return yaml_text({key: value for key, value in content.items() if value is not None})


def _poses_text(data: BodyDataset) -> str:
    columns: dict[str, list[str]] = {"sample": [str(s) for s in data.sample.tolist()]}
    flanges = np.asarray(data.flanges)
    for i, joint in enumerate(data.joints):
        if joint.motion == FLANGE:
            for name, column in zip(_POSE, flanges[:, i].T, strict=True):
                columns[f"flange.{joint.name}.{name}"] = number_cells(column.tolist())
        elif joint.is_read:
            columns[f"{ENCODER}.{joint.name}"] = number_cells(data.readings[:, i].tolist())
    approach = np.asarray(data.approach)
    if approach.any():
        for joint, side in zip(data.joints, approach.T, strict=True):
            if joint.is_read:
                columns[f"{APPROACH}.{joint.name}"] = [str(s) for s in side.tolist()]
    return table_text(columns)


def _observations_text(data: BodyDataset) -> str:
    table = data.observations
    numbers = [*(str(s) for s in data.sample.tolist()), ""]
    names = text_cells(m.name for m in data.markers)
    sensors = text_cells(s.name for s in data.sensors)
    columns = {
        "sample": [numbers[k] for k in table.pose.tolist()],
        "sensor": [sensors[k] for k in table.sensor.tolist()],
        "marker": [names[k] for k in table.marker.tolist()],
        "other": [names[k] if k >= 0 else "" for k in table.other.tolist()],
        "mirror": text_cells(table.mirror.tolist()),
    }
    by_name = {name: np.full(len(table), np.nan) for name in _VALUES}
    for i, info in enumerate(data.sensors):
        own = table.sensor == i
        for k, name in enumerate(SENSOR_COLUMNS[info.kind]):
            by_name[name][own] = table.values[own, k]
    if not (table.other >= 0).any():
        del columns["other"]
    if not data.mirrors:
        del columns["mirror"]
    columns |= {k: number_cells(v.tolist()) for k, v in by_name.items() if np.isfinite(v).any()}
    return table_text(columns)
