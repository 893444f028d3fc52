"""Marker trajectories that Vicon Nexus exported as CSV (ASCII).

Such a file is a series of blocks (Devices, Joints, Model Outputs, Trajectories) with blank lines
between them. The block of trajectories::

    Trajectories
    100                                       frames per second
    ,,Nico:wrist,,,Nico:elbow,,               names, one for three columns
    Frame,Sub Frame,X,Y,Z,X,Y,Z
    ,,mm,mm,mm,mm,mm,mm                       units
    1,0,101.2,20.3,733.1,,,                   an empty cell is a gap
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_rows import parse_number, read_csv_rows
from nico_selfmodel.names import did_you_mean, listed, shown

_TITLE = "Trajectories"
_OTHER_SEPARATOR = "the cells are not separated by commas; export with commas"
_UNITS_PER_METRE = {"mm": 1000.0, "m": 1.0}
_UNLABELLED = re.compile(r"\*\d+")


@dataclass(frozen=True, eq=False)
class Trajectories:
    """Marker trajectories of one trial."""

    path: Path
    """The file, for messages."""
    frames: npt.NDArray[np.int64]
    """Numbers of the frames, ascending. Shape (F,)."""
    points: dict[str, npt.NDArray[np.float64]]
    """Marker to its points [m], nan in gaps; shape (F, 3) each."""

    def mean_points(
        self, marker: str, start: npt.NDArray[np.int64], end: npt.NDArray[np.int64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Average a marker over intervals of frames, gaps left out.

        Args:
            marker: Name of the marker.
            start: First frame of each interval. Shape (K,).
            end: Last frame of each interval, included. Shape (K,).

        Returns:
            Mean points [m], nan where every frame is a gap, shape (K, 3); and how many frames
            went into each, shape (K,).
        """
        points = self.points[marker]
        seen = ~np.isnan(points[:, 0])
        mean = np.full((len(start), 3), np.nan)
        used = np.zeros(len(start), dtype=np.int64)
        firsts = np.searchsorted(self.frames, start, side="left")
        lasts = np.searchsorted(self.frames, end, side="right")
        for k, (first, last) in enumerate(zip(firsts, lasts, strict=True)):
            inside = points[first:last][seen[first:last]]
            used[k] = len(inside)
            if len(inside):
                mean[k] = inside.mean(axis=0)
        return mean, used


def read_trajectories(
    path: str | PathLike[str], markers: Sequence[str] | None = None
) -> Trajectories:
    """Read the marker trajectories of a Vicon Nexus export; other blocks are skipped.

    Args:
        path: The file.
        markers: Which markers to take, with or without `<subject>:`. By default all that have
            a name.

    Returns:
        The trajectories, markers named without their subject where that stays unique.

    Raises:
        DataError: If the file is not such an export, a unit is neither mm nor m, a marker is not
            in it or a cell is not a number.
    """
    path = Path(path)
    rows, lines = read_csv_rows(path)
    rows = [[cell.strip() for cell in row] for row in rows]
    top = _title_row(rows, path)
    if len(rows) < top + 6:
        raise DataError(f"{path}, line {lines[top]}: the block {_TITLE!r} has no frames")
    _cell_number(rows[top + 1][0], f"{path}, line {lines[top + 1]}, frame rate")
    axes, units = rows[top + 3], rows[top + 4]
    _check_axes(axes, path, lines[top + 3])
    columns = _marker_columns(rows[top + 2], markers, f"{path}, line {lines[top + 2]}")
    last = _block_end(rows, lines, top + 5)
    rows, lines = rows[top + 5 : last], lines[top + 5 : last]
    frames = _frames(rows, lines, len(axes), path)
    points = {}
    for marker, column in columns.items():
        scale = _unit_scale(axes, units, column, f"{path}, marker {marker!r}")
        where = [f"{path}, line {line}, marker {marker!r}" for line in lines]
        measured = [_point(row, column, place) for row, place in zip(rows, where, strict=True)]
        points[marker] = np.array(measured) / scale
    return Trajectories(path, frames, points)


def _title_row(rows: list[list[str]], path: Path) -> int:
    titles = []
    for number, row in enumerate(rows):
        if row[0] == _TITLE and not any(row[1:]):
            return number
        if re.match(rf"{_TITLE}[;\t]", row[0]):
            raise DataError(f"{path}: {_OTHER_SEPARATOR}")
        if row[0] and not any(row[1:]) and not _is_number(row[0]):
            titles.append(row[0][:40])
    found = listed(titles) or "none"
    raise DataError(
        f"{path}: no block {_TITLE!r} (blocks found: {found}); export the trajectories from Vicon"
        " Nexus as ASCII with commas"
    )


def _is_number(cell: str) -> bool:
    return re.fullmatch(r"[-+.0-9]+", cell) is not None


def _cell_number(cell: str, where: str) -> float:
    try:
        return parse_number(cell)
    except ValueError as error:
        raise DataError(f"{where}: {error}") from None


def _check_axes(axes: list[str], path: Path, line: int) -> None:
    if len(axes) == 1 and re.search("[;\t]", axes[0]):
        raise DataError(f"{path}, line {line}: {_OTHER_SEPARATOR}")
    if [cell.lower() for cell in axes[:2]] != ["frame", "sub frame"]:
        raise DataError(
            f"{path}, line {line}: expected the row 'Frame,Sub Frame,X,Y,Z,...' as the fourth of"
            f" the block {_TITLE!r}, got {','.join(axes)[:60]!r}"
        )


def _marker_columns(names: list[str], markers: Sequence[str] | None, where: str) -> dict[str, int]:
    """Return the marker names to use and the column of each one's X."""
    column_of = {name: column for column, name in enumerate(names) if name and column >= 2}
    short = {name: name.rpartition(":")[2] for name in column_of}
    short_names = list(short.values())
    labels = {n: s if s and short_names.count(s) == 1 else n for n, s in short.items()}
    chosen = [name for name in column_of if not _UNLABELLED.fullmatch(short[name])]
    if markers is not None:
        chosen = []
        for marker in markers:
            matches = [name for name in column_of if marker in (name, labels[name])]
            if not matches:
                valid = list(labels.values())
                raise DataError(
                    f"{where}: there is no marker {shown(marker)}{did_you_mean(marker, valid)};"
                    f" markers are {listed(valid, marker)}"
                )
            chosen += matches
    if not chosen:
        raise DataError(f"{where}: no marker has a name; label the trajectories before exporting")
    return {labels[name]: column_of[name] for name in chosen}


def _unit_scale(axes: list[str], units: list[str], column: int, where: str) -> float:
    """Return how many units make a metre, after a look at the axes above the unit."""
    if [cell.upper() for cell in axes[column : column + 3]] != ["X", "Y", "Z"]:
        raise DataError(
            f"{where}: expected the axes X,Y,Z in columns {column + 1} to {column + 3}, got"
            f" {','.join(axes[column : column + 3])!r}"
        )
    found = units[column : column + 3]
    if len(found) != 3 or len(set(found)) != 1 or found[0] not in _UNITS_PER_METRE:
        raise DataError(f"{where}: the unit of X, Y and Z must be mm or m, got {','.join(found)!r}")
    return _UNITS_PER_METRE[found[0]]


def _block_end(rows: list[list[str]], lines: list[int], first: int) -> int:
    """Return the row after the block: a blank line, a row of empty cells or the next title."""
    for number in range(first, len(rows)):
        blank_above = number > first and lines[number] > lines[number - 1] + 1
        if blank_above or not any(rows[number]):
            return number
    return len(rows)


def _frames(
    rows: list[list[str]], lines: list[int], width: int, path: Path
) -> npt.NDArray[np.int64]:
    frames = np.empty(len(rows), dtype=np.int64)
    for number, (row, line) in enumerate(zip(rows, lines, strict=True)):
        if not re.fullmatch("[0-9]{1,18}", row[0]):
            raise DataError(f"{path}, line {line}: {row[0][:40]!r} is not the number of a frame")
        if any(row[width:]):
            raise DataError(
                f"{path}, line {line}: more cells than the {width} columns of the block; are"
                " there decimal commas?"
            )
        frames[number] = int(row[0])
        if number and frames[number] <= frames[number - 1]:
            raise DataError(
                f"{path}, line {line}: frame {row[0]} follows frame {frames[number - 1]};"
                " expected ascending frames, each once"
            )
    return frames


def _point(row: list[str], column: int, where: str) -> list[float]:
    cells = [*row[column : column + 3], "", "", ""][:3]
    point = [_cell_number(cell, where) for cell in cells]
    if any(cells) and not all(cells):
        raise DataError(f"{where}: one of X, Y, Z is empty; expected all of them, or none in a gap")
    return point
