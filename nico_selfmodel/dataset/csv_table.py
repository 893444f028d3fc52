"""A comma separated file as named columns of text, each cell traceable to its line."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from nico_selfmodel.dataset.columns import PIXEL_COLUMNS, POINT_COLUMNS, SIDES_OF_APPROACH
from nico_selfmodel.dataset.plain_table import plain_columns, plain_integers, plain_numbers
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_rows import parse_number, rows_of_text
from nico_selfmodel.files.reading import LARGEST_TABLE, read_text
from nico_selfmodel.names import found_instead, listed

_INTEGER = re.compile(r"[+-]?[0-9]{1,19}")
STANDARD_COLUMNS = {"sample", "sweep", "marker", "mirror", *POINT_COLUMNS, *PIXEL_COLUMNS}
_INT64 = np.iinfo(np.int64)


@dataclass(frozen=True, eq=False)
class CsvTable:
    """A table of text cells, with the line of the file that each row starts on."""

    path: Path
    """The file, for messages."""
    columns: Mapping[str, Sequence[str]]
    """Cells of each column, in the order of the file."""
    lines: Sequence[int]
    """Line of each row, counted from 1 as an editor shows it."""

    @classmethod
    def read(cls, path: Path, header: bool = True) -> "CsvTable":
        """Read a file; blank lines are skipped.

        Args:
            path: The file; its first line names the columns.
            header: False if the first line is data already; the columns are then `column 1`, ...

        Raises:
            DataError: If the file cannot be read, has another separator, no rows, a row of
                another length or two columns of one name.
        """
        return cls.of_text(read_text(path, LARGEST_TABLE), path, header)

    @classmethod
    def of_text(cls, text: str, path: Path, header: bool = True) -> "CsvTable":
        """Read the text of a file, as `read` does.

        Args:
            path: What messages call it.
            header: False if the first line is data already.

        Raises:
            DataError: As `read`.
        """
        rows: list[list[str]] = []
        lines: Sequence[int]
        columns = plain_columns(text)
        if columns is None:
            rows, lines = rows_of_text(text, str(path))
        else:
            lines = range(1, len(columns[0]) + 1)
        heading = rows[0] if columns is None else [column[0] for column in columns]
        names = [name.strip() for name in heading]
        _check_separator(path, names)
        first = 1 if header else 0
        if not header:
            names = [""] * len(names)
        names = [name or f"column {number}" for number, name in enumerate(names, 1)]
        if len(lines) == first:
            raise DataError(f"{path}: no rows below the header; expected at least one")
        _check_names(path, names)
        repeated = [name for name, count in Counter(names).items() if count > 1]
        if repeated:
            raise DataError(f"{path}: column {min(repeated)!r} appears more than once")
        if columns is None:
            columns = _columns_of(rows, lines, len(names), path)
        below = (column[first:] for column in columns)
        return cls(path, dict(zip(names, below, strict=True)), lines[first:])

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.lines)

    def where(self, row: int, column: str | None = None) -> str:
        """Return the place of a cell or row for a message.

        Args:
            row: Index of the row.
            column: Name of the column, if one cell is meant.

        Returns:
            File, line and column.
        """
        place = f"{self.path}, line {self.lines[row]}"
        return place if column is None else f"{place}, column {column!r}"

    def cells(self, column: str) -> Sequence[str]:
        """Return the cells of a column as they stand in the file.

        Returns:
            One text per row.

        Raises:
            DataError: If there is no such column; names the closest one.
        """
        if column not in self.columns:
            raise DataError(
                f"{self.path}: column {column!r} is missing"
                f"{self._hint(column)}; columns are {listed(self.columns, column)}"
            )
        return self.columns[column]

    def _hint(self, column: str) -> str:
        """Name a column that may be a misspelling of a missing one; never one that has a use."""
        prefix = "encoder." if column.startswith("encoder.") else ""
        # Compared without what all encoders share, or any encoder would look like any other.
        others = [
            name.removeprefix(prefix)
            for name in self.columns
            if name not in STANDARD_COLUMNS and name.startswith(prefix)
        ]
        hint = found_instead(column.removeprefix(prefix), others)
        return hint.replace("but '", f"but '{prefix}") if hint else ""

    def texts(self, column: str) -> npt.NDArray[np.str_]:
        """Return a column of text, stripped. Shape (N,).

        Raises:
            DataError: If there is no such column.
        """
        cells = self.cells(column)
        if len(set(cells)) == 1:  # as where one sensor sees one marker
            return np.full(len(cells), cells[0].strip())
        return np.array(list(map(str.strip, cells)), dtype=np.str_)

    def integers(self, column: str) -> npt.NDArray[np.int64]:
        """Return a column of whole numbers. Shape (N,).

        Raises:
            DataError: If there is no such column or a cell is not a whole number.
        """
        plain = plain_integers(self.cells(column))
        if plain is not None:
            return plain
        cells = [cell.strip() for cell in self.cells(column)]
        for row, cell in enumerate(cells):
            if not _INTEGER.fullmatch(cell) or not _INT64.min <= int(cell) <= _INT64.max:
                raise DataError(f"{self.where(row, column)}: {cell[:40]!r} is not a whole number")
        return np.array([int(cell) for cell in cells], dtype=np.int64)

    def numbers(self, column: str, empty_allowed: bool = False) -> npt.NDArray[np.float64]:
        """Return a column of finite numbers. Shape (N,).

        Args:
            empty_allowed: Whether an empty cell is "not measured" (nan) or an error.

        Raises:
            DataError: If there is no such column or a cell is not a finite number.
        """
        cells = self.cells(column)
        values = plain_numbers(cells)
        if values is None:
            values = np.empty(len(self))
            for row, cell in enumerate(cells):
                try:
                    values[row] = parse_number(cell)
                except ValueError as error:
                    raise DataError(f"{self.where(row, column)}: {error}") from None
        if not empty_allowed and np.isnan(values).any():
            row = int(np.flatnonzero(np.isnan(values))[0])
            raise DataError(f"{self.where(row, column)}: the cell is empty; expected a number")
        return values

    def sides(self, column: str) -> npt.NDArray[np.float64]:
        """Return how a reading last changed: -1, 0 or 1; 0 where nobody says. Shape (N,).

        Args:
            column: Its name; where there is no such column nobody says anything.

        Raises:
            DataError: If a cell is another number.
        """
        if column not in self.columns:
            return np.zeros(len(self))
        values = np.nan_to_num(self.numbers(column, empty_allowed=True))
        strange = np.flatnonzero(~np.isin(values, SIDES_OF_APPROACH))
        if strange.size:
            row = int(strange[0])
            raise DataError(
                f"{self.where(row, column)}: {values[row]:g} is no side; expected 1 where the"
                " reading rose last, -1 where it fell, 0 or nothing where nobody knows"
            )
        return values


def _columns_of(
    rows: list[list[str]], lines: Sequence[int], width: int, path: Path
) -> list[tuple[str, ...]]:
    for row, line in zip(rows, lines, strict=True):
        if len(row) != width:
            raise DataError(
                f"{path}, line {line}: {len(row)} cells, but the table has {width} columns"
            )
    return list(zip(*rows, strict=True))


def _check_names(path: Path, names: list[str]) -> None:
    """Refuse a first line that holds numbers: it is data, and the names of columns are missing."""
    numbers = [name for name in names if name.lstrip("+-")[:1].isdigit()]
    if 2 * len(numbers) > len(names):
        raise DataError(
            f"{path}, line 1: expected the names of the columns, got numbers ({numbers[0]}, ...)"
        )


def _check_separator(path: Path, names: list[str]) -> None:
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and separator in names[0]:
            raise DataError(
                f"{path}: the cells are separated by {word}; export the table with commas as"
                " separators and points as decimal marks"
            )
