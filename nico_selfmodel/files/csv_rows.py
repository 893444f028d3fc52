"""Comma separated files as rows of cells, with the line of each, and the numbers in them."""

import csv
import io
import math
import re
from pathlib import Path

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_cells import original_cell
from nico_selfmodel.files.reading import LARGEST_TABLE, read_text
from nico_selfmodel.files.yaml_mapping import LARGEST

MOST_CELLS = 12_000_000
"""Cells that a table may have."""
MOST_COLUMNS = 10_000
"""Columns that a table may have."""

_OF_CELLS = "; an empty cell means not measured"


def read_csv_rows(path: Path) -> tuple[list[list[str]], list[int]]:
    """Read the cells of a comma separated file, without its blank lines.

    Returns:
        Rows of cells, and the line (from 1) that each row starts on.

    Raises:
        DataError: If the file cannot be read, its quotes do not match, or it is larger than
            `MOST_CELLS` and `MOST_COLUMNS` allow.
    """
    return rows_of_text(read_text(path, LARGEST_TABLE), str(path))


def rows_of_text(text: str, where: str) -> tuple[list[list[str]], list[int]]:
    """Read the cells of comma separated text, without its blank lines.

    Returns:
        Rows of cells, and the line (from 1) that each row starts on.

    Raises:
        DataError: As `read_csv_rows`.
    """
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    rows: list[list[str]] = []
    lines: list[int] = []
    start, cells = 1, 0
    try:
        for row in reader:
            cells += len(row)
            if len(row) > MOST_COLUMNS or cells > MOST_CELLS:
                raise DataError(
                    f"{where}, line {start}: a table has at most {MOST_COLUMNS} columns and"
                    f" {MOST_CELLS} cells"
                )
            if len(row) > 1 or (row and row[0].strip()):
                rows.append([original_cell(cell) for cell in row])
                lines.append(start)
            start = reader.line_num + 1
    except csv.Error as error:
        raise DataError(f"{where}, line {start}: not a valid CSV row: {error}") from None
    return rows, lines


def number_of_word(word: str, where: str) -> float:
    """Return the finite number that a word of the command line is.

    Args:
        where: The option that it belongs to, for the message.

    Raises:
        ValueError: If it is none, or larger than anything measured.
    """
    if not word.strip():
        raise ValueError(f"{where}: '' is not a number")
    try:
        return parse_number(word)
    except ValueError as error:
        raise ValueError(f"{where}: {str(error).removesuffix(_OF_CELLS)}") from None


def parse_number(cell: str) -> float:
    """Return the finite number in a cell, nan for an empty one.

    Raises:
        ValueError: If the text is not a finite number.
    """
    text = cell.strip()
    if not text:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        hint = "; use a decimal point" if re.fullmatch(r"[-+0-9]+,[0-9]+", text) else ""
        raise ValueError(f"{text[:40]!r} is not a number{hint}") from None
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number{_OF_CELLS}")
    if "_" in text:
        raise ValueError(f"{text[:40]!r} is not a number; write it without underscores")
    if abs(value) > LARGEST:
        raise ValueError(f"{text[:40]!r} is larger than anything measured ({LARGEST:g})")
    return value
