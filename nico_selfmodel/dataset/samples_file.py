"""samples.csv: one row per pose and tracked point."""

import warnings
from collections.abc import Iterable, Iterator, Sequence
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
from nico_selfmodel.dataset.row_checks import check_rows
from nico_selfmodel.files.csv_cells import number_cells, table_text, text_cells
from nico_selfmodel.names import did_you_mean

_PIECE = 50_000
"""Rows that are written at once."""
_OPTIONAL = ("sweep", "marker", "mirror", *POINT_COLUMNS, *PIXEL_COLUMNS)


def read_samples(path: Path, joint_names: Sequence[str]) -> dict[str, Any]:
    """Read and check the table of a data set.

    Args:
        joint_names: Joints that the table must have readings of.

    Returns:
        The array fields and `extra` of a `Dataset`, by name.

    Raises:
        DataError: If a column is missing, a cell is not valid, or rows contradict each other.

    Warns:
        UserWarning: If a column that nobody reads looks like a misspelt one.
    """
    table = CsvTable.read(path)
    sides = [f"{APPROACH}.{name}" for name in joint_names]
    needed = ("sample", *(f"{ENCODER}.{name}" for name in joint_names))
    for name in needed:
        table.cells(name)
    known = (*needed, *_OPTIONAL, *sides)
    extra = {name: cells for name, cells in table.columns.items() if name not in known}
    marker = _texts(table, "marker")
    columns = {
        "sample": table.integers("sample"),
        "sweep": _texts(table, "sweep"),
        "marker": np.where(marker == "", DEFAULT_MARKER, marker),
        "mirror": _texts(table, "mirror"),
        "encoders": np.column_stack([table.numbers(f"{ENCODER}.{name}") for name in joint_names]),
        "approach": np.column_stack([table.sides(name) for name in sides]),
        "p_WH_measured": _numbers(table, POINT_COLUMNS),
        "pixels": np.hstack(
            [_numbers(table, PIXEL_COLUMNS[:2]), _numbers(table, PIXEL_COLUMNS[2:])]
        ),
    }
    _warn_of_misspelt(table, extra, (*_OPTIONAL, *sides))
    check_rows(columns, joint_names, table.where)
    return {**columns, "extra": extra}


def samples_text(dataset: Dataset) -> str:
    """Return the table of a data set as text; floats are written so that they read back exactly.

    Columns in which no row has anything are left out.

    Returns:
        Contents of `samples.csv`.
    """
    return "".join(_pieces(dataset))


def _pieces(dataset: Dataset) -> Iterator[str]:
    """Yield what `samples_text` returns piece by piece, so that no more is held at once."""
    has_mirror, has_approach = (dataset.mirror != "").any(), dataset.approach.any()
    measured = [
        (names, values)
        for names, values in (
            (POINT_COLUMNS, dataset.p_WH_measured),
            (PIXEL_COLUMNS[:2], dataset.pixels[:, :2]),
            (PIXEL_COLUMNS[2:], dataset.pixels[:, 2:]),
        )
        if np.isfinite(values).any()
    ]
    for start in range(0, max(len(dataset), 1), _PIECE):
        own = slice(start, start + _PIECE)
        columns: dict[str, Iterable[str]] = {
            "sample": map(str, dataset.sample[own].tolist()),
            "sweep": text_cells(dataset.sweep[own].tolist()),
            "marker": text_cells(dataset.marker[own].tolist()),
        }
        if has_mirror:
            columns["mirror"] = text_cells(dataset.mirror[own].tolist())
        for name, readings in zip(dataset.joint_names, dataset.encoders[own].T, strict=True):
            columns[f"{ENCODER}.{name}"] = number_cells(readings.tolist())
        if has_approach:
            for name, side in zip(dataset.joint_names, dataset.approach[own].T, strict=True):
                columns[f"{APPROACH}.{name}"] = map(str, side.tolist())
        for names, values in measured:
            columns.update(zip(names, map(number_cells, values[own].T.tolist()), strict=True))
        columns |= {name: text_cells(cells[own]) for name, cells in dataset.extra.items()}
        yield table_text(columns, heading=start == 0)


def _texts(table: CsvTable, column: str) -> npt.NDArray[np.str_]:
    if column in table.columns:
        return table.texts(column)
    return np.full(len(table), "")


def _numbers(table: CsvTable, names: Sequence[str]) -> npt.NDArray[np.float64]:
    # One of the columns asks for its fellows: half a point is a mistake.
    if not any(name in table.columns for name in names):
        return np.full((len(table), len(names)), np.nan)
    return np.column_stack([table.numbers(name, empty_allowed=True) for name in names])


def _warn_of_misspelt(table: CsvTable, extra: Iterable[str], optional: Sequence[str]) -> None:
    absent = [name for name in optional if name not in table.columns]
    for name in extra:
        hint = did_you_mean(name, absent, likeness=0.8)
        if hint:
            warnings.warn(f"{table.path}: column {name!r} is kept but not used{hint}", stacklevel=5)
