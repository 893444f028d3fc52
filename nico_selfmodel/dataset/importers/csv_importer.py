"""Import any comma separated table, by a map that says which column holds what."""

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nico_selfmodel.dataset.columns import (
    APPROACH,
    DEFAULT_MARKER,
    ENCODER,
    PIXEL_COLUMNS,
    POINT_COLUMNS,
)
from nico_selfmodel.dataset.csv_table import CsvTable
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.plausibility import check_as_read
from nico_selfmodel.dataset.row_checks import check_rows
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.yaml_mapping import (
    check_keys,
    number_value,
    read_yaml_mapping,
    text_value,
)
from nico_selfmodel.names import shown

UNITS_PER_METRE = {"m": 1.0, "cm": 100.0, "mm": 1000.0}
"""How many of each unit of length make a metre."""
_WORD = r"(?<![\w./])[\w.]+(?![\w/])"
_ROW_KEYS = ("sample", "sweep", "marker", "mirror")
_KEYS = (
    "name",
    "source",
    "header",
    "not_measured",
    "joints",
    "point",
    "pixels",
    *_ROW_KEYS,
    "point_sigma_m",
    "pixel_sigma_px",
)


def import_csv(
    path: str | PathLike[str],
    column_map: Mapping[str, Any] | str | PathLike[str],
    name: str | None = None,
    source: str | None = None,
) -> Dataset:
    """Read a table of poses whose columns are described by a map.

    The map, as a mapping or a YAML file. A column is given by its name in the header, or by its
    number from 1::

        joints:                       # in order from the base to the hand
          - {name: shoulder, column: q1, encoder_unit: counts, counts_per_turn: 4096}
          - {name: elbow, column: q2, encoder_unit: deg, lower: -5, upper: 120, approach: side2}
          - {name: pitch, column: {m1: 0.5, m2: 0.5}, encoder_unit: deg}     # sums of columns, of
          - {name: roll, column: {m1: 0.5, m2: -0.5}, encoder_unit: deg}     # differential drives
        point: {x: X, y: Y, z: Z, unit: mm}                  # unit: m, cm or mm
        pixels: {left_u: lu, left_v: lv, right_u: ru, right_v: rv}   # or the left pair alone
        sample: 1                     # these four are optional; samples are numbered from 1
        sweep: circle
        marker: point_name
        mirror: mirror_name
        header: true                  # false if the first line is data
        not_measured: ["NaN"]         # texts that mean "empty"
        name: my_arm                  # also: source, point_sigma_m, pixel_sigma_px

    Args:
        path: The table.
        column_map: The map, or the YAML file that holds it.
        name: Name of the data set, instead of the map's or the file's.
        source: Where the data come from, instead of the map's.

    Returns:
        The data set; columns that the map does not name are left out.

    Raises:
        DataError: If the map or the table is not valid; names file, line and column.
    """
    path = Path(path)
    where = "column map"
    if isinstance(column_map, str | PathLike):
        where = str(column_map)
        column_map = read_yaml_mapping(Path(column_map))
    check_keys(column_map, _KEYS, where)
    header = column_map.get("header", True)
    if not isinstance(header, bool):
        raise DataError(f"{where}: 'header' must be true or false, got {shown(header)}")
    table = _emptied(CsvTable.read(path, header), column_map, where)
    joints, columns = _columns(table, column_map, where)
    metadata = {
        "name": name or text_value(column_map, "name", where, default=path.stem),
        "source": source or text_value(column_map, "source", where, f"imported from {path.name}"),
        "point_sigma_m": number_value(column_map, "point_sigma_m", where),
        "pixel_sigma_px": number_value(column_map, "pixel_sigma_px", where),
    }
    with _in_own_headings(_headings(table, column_map, where)):
        check_rows(columns, [joint.name for joint in joints], table.where)
        try:
            dataset = Dataset(joints=joints, **metadata, **columns)
        except (ValueError, DataError) as error:
            raise DataError(f"{path}: {error}") from None
        check_as_read(dataset, str(path))
    return dataset


@contextmanager
def _in_own_headings(headings: Mapping[str, str]) -> Iterator[None]:
    """Say what is wrong with a data set's columns of the table's: where its headings are others."""

    def own(said: object) -> str:
        # A part of a path that is called like a column stays as it is.
        return re.sub(_WORD, lambda word: headings.get(word[0], word[0]), str(said))

    with warnings.catch_warnings(record=True) as doubts:
        warnings.simplefilter("always")
        try:
            yield
        except DataError as error:
            raise DataError(own(error)) from None
    for doubt in doubts:
        warnings.warn(own(doubt.message), doubt.category, stacklevel=4)


def _headings(table: CsvTable, column_map: Mapping[str, Any], where: str) -> dict[str, str]:
    """Return the table's heading of each column of a data set that the map names.

    Samples that it does not number are rows.
    """
    point, pixels = (column_map.get(key) or {} for key in ("point", "pixels"))
    named = {name: point.get(axis) for name, axis in zip(POINT_COLUMNS, "xyz", strict=True)}
    named |= {name: pixels.get(name) for name in PIXEL_COLUMNS}
    named |= {key: column_map.get(key) for key in _ROW_KEYS}
    for entry in column_map["joints"]:
        named[f"{ENCODER}.{entry['name']}"] = entry["column"]
        named[f"{APPROACH}.{entry['name']}"] = entry.get(APPROACH)
    return {"sample": "row"} | {
        name: " and ".join(_column(table, one, where) for one, _ in _summed(column))
        for name, column in named.items()
        if column is not None
    }


def _summed(column: Any) -> list[tuple[Any, Any]]:
    """Return the columns that a reading is made of, each with its factor."""
    return list(column.items()) if isinstance(column, Mapping) else [(column, 1.0)]


def _columns(
    table: CsvTable, column_map: Mapping[str, Any], where: str
) -> tuple[tuple[JointInfo, ...], dict[str, Any]]:
    """Return the joints, and the array fields of the data set by name."""
    joints, encoders, approach = _joints(table, column_map, where)
    count = len(table)
    columns: dict[str, Any] = {
        "sample": np.arange(1, count + 1),
        "sweep": np.full(count, ""),
        "marker": np.full(count, DEFAULT_MARKER),
        "mirror": np.full(count, ""),
        "encoders": encoders,
        "approach": approach,
        "p_WH_measured": _points(table, column_map, where),
        "pixels": _pixels(table, column_map, where),
    }
    for key in _ROW_KEYS:
        if column_map.get(key) is not None:
            column = _column(table, column_map[key], f"{where}, {key!r}")
            columns[key] = table.integers(column) if key == "sample" else table.texts(column)
    _refuse_one_column_twice(table, column_map, where)
    return joints, columns


def _refuse_one_column_twice(table: CsvTable, column_map: Mapping[str, Any], where: str) -> None:
    """Refuse a column that is named for two quantities: one of them is another."""
    joints = (entry for entry in column_map["joints"] if not isinstance(entry["column"], Mapping))
    named = {f"joint {entry['name']}": entry["column"] for entry in joints}
    point, pixels = (column_map.get(key) or {} for key in ("point", "pixels"))
    named |= {f"point {axis}": point[axis] for axis in "xyz" if axis in point}
    named |= {f"pixel {name}": pixels[name] for name in PIXEL_COLUMNS if name in pixels}
    owners: dict[str, str] = {}
    for owner, reference in named.items():
        column = _column(table, reference, where)
        if column in owners:
            raise DataError(
                f"{where}: column {column!r} is given for {owners[column]} and for {owner}; each "
                "has its own"
            )
        owners[column] = owner


def _emptied(table: CsvTable, column_map: Mapping[str, Any], where: str) -> CsvTable:
    """Return the table with the texts that mean "not measured" replaced by empty cells."""
    texts = column_map.get("not_measured", [])
    if not isinstance(texts, list | tuple):
        raise DataError(f"{where}: 'not_measured' must be a list of texts, got {shown(texts)}")
    # YAML reads .nan and -9999 as numbers: compare what they look like.
    marks = {str(text).lower() for text in texts}
    columns = {
        name: tuple("" if cell.strip().lower() in marks else cell for cell in cells)
        for name, cells in table.columns.items()
    }
    return CsvTable(table.path, columns, table.lines)


def _column(table: CsvTable, reference: Any, where: str) -> str:
    if isinstance(reference, int) and not isinstance(reference, bool):
        if not 1 <= reference <= len(table.columns):
            raise DataError(
                f"{where}: there is no column {reference}; {table.path} has columns 1 to"
                f" {len(table.columns)}"
            )
        return list(table.columns)[reference - 1]
    if not isinstance(reference, str):
        raise DataError(f"{where}: a column is a name or a number from 1, got {shown(reference)}")
    table.cells(reference)
    return reference


def _joints(
    table: CsvTable, column_map: Mapping[str, Any], where: str
) -> tuple[tuple[JointInfo, ...], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    entries = column_map.get("joints")
    if not isinstance(entries, list | tuple) or not entries:
        raise DataError(
            f"{where}: 'joints' must be a list with 'name', 'column' and 'encoder_unit' of each"
            f" joint, got {shown(entries)}"
        )
    joints, readings, sides = [], [], []
    for number, entry in enumerate(entries, 1):
        place = f"{where}, joint {number}"
        if not isinstance(entry, Mapping) or "column" not in entry:
            raise DataError(
                f"{place}: expected 'name', 'column' and 'encoder_unit', got {shown(entry)}"
            )
        info = {k: value for k, value in entry.items() if k not in ("column", APPROACH)}
        joints.append(JointInfo.from_mapping(info, place))
        readings.append(_reading(table, entry["column"], place))
        side = np.zeros(len(table))
        if entry.get(APPROACH) is not None:
            side = table.sides(_column(table, entry[APPROACH], place))
        sides.append(side)
    return tuple(joints), np.column_stack(readings), np.column_stack(sides)


def _reading(table: CsvTable, column: Any, place: str) -> npt.NDArray[np.float64]:
    """Return what a joint reads, (N,): a column, or a sum of columns with factors."""
    summed = _summed(column)
    total = np.zeros(len(table))
    for one, factor in summed:
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not factor:
            raise DataError(
                f"{place}: a sum of columns is a factor of each, {{m1: 0.5, m2: -0.5}}, got "
                f"{shown(column)}"
            )
        total += factor * table.numbers(_column(table, one, place))
    if not summed:
        raise DataError(f"{place}: a sum of columns names some, got {shown(column)}")
    return total


def _points(table: CsvTable, column_map: Mapping[str, Any], where: str) -> npt.NDArray[np.float64]:
    point = _section(column_map, "point", ("x", "y", "z", "unit"), where)
    if point is None:
        return np.full((len(table), 3), np.nan)
    unit = text_value(point, "unit", f"{where}, 'point'")
    if unit not in UNITS_PER_METRE:
        raise DataError(
            f"{where}: the unit of the point must be one of {', '.join(UNITS_PER_METRE)},"
            f" got {shown(unit)}"
        )
    return _optional_numbers(table, point, ("x", "y", "z"), where) / UNITS_PER_METRE[unit]


def _pixels(table: CsvTable, column_map: Mapping[str, Any], where: str) -> npt.NDArray[np.float64]:
    values = np.full((len(table), 4), np.nan)
    pixels = _section(column_map, "pixels", PIXEL_COLUMNS, where)
    for side in (slice(0, 2), slice(2, 4)):
        if pixels and any(name in pixels for name in PIXEL_COLUMNS[side]):
            values[:, side] = _optional_numbers(table, pixels, PIXEL_COLUMNS[side], where)
    return values


def _section(
    column_map: Mapping[str, Any], key: str, known: Sequence[str], where: str
) -> Mapping[str, Any] | None:
    section = column_map.get(key)
    if section is None:
        return None
    if not isinstance(section, Mapping):
        raise DataError(
            f"{where}: {key!r} must be a mapping of {', '.join(known)}, got {shown(section)}"
        )
    check_keys(section, known, f"{where}, {key!r}")
    return section


def _optional_numbers(
    table: CsvTable, section: Mapping[str, Any], names: Sequence[str], where: str
) -> npt.NDArray[np.float64]:
    missing = [name for name in names if name not in section]
    if missing:
        raise DataError(f"{where}: {missing[0]!r} is missing; expected {', '.join(names)}")
    columns = [_column(table, section[name], f"{where}, {name!r}") for name in names]
    return np.column_stack([table.numbers(column, empty_allowed=True) for column in columns])
