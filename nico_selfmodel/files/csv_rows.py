"""Comma separated files as rows of cells, with the line of each, and the numbers in them."""

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import DataError
from nico_selfmodel.files.csv_cells import original_cell
from nico_selfmodel.files.reading import LARGEST_TABLE, read_text
from nico_selfmodel.files.yaml_mapping import LARGEST

MOST_CELLS = 12_000_000
"""Cells that a table may have."""
MOST_COLUMNS = 10_000
"""Columns that a table may have."""

# Of fewer digits than the largest that a column of 64 bits holds.
_INTEGERS = re.compile(r"[+-]?[0-9]{1,18}(?:\n[+-]?[0-9]{1,18})*")
_OF_CELLS = "; an empty cell means not measured"


def read_csv_rows(path: Path) -> tuple[list[list[str]], list[int]]:
    """Read the cells of a comma separated file, without its blank lines.

    Args:
        path: The file.

    Returns:
        Rows of cells, and the line (from 1) that each row starts on.

    Raises:
        DataError: If the file cannot be read, its quotes do not match, or it is larger than
            `MOST_CELLS` and `MOST_COLUMNS` allow.
    """
    return rows_of_text(read_text(path, LARGEST_TABLE), str(path))


def rows_of_text(text: str, where: str) -> tuple[list[list[str]], list[int]]:
    """Read the cells of comma separated text, without its blank lines.

    Args:
        text: The text.
        where: Place for messages.

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


def plain_columns(text: str) -> Sequence[Sequence[str]] | None:
    """Read text in which each line is a row of as many plain cells, at once.

    Args:
        text: The text.

    Returns:
        Cells of each column; None where a line may be something else, or the table too large.
    """
    if not text.endswith("\n") or any(mark in text for mark in "\"'\r\0"):
        return None
    content = np.frombuffer(text.encode(), np.uint8)
    ends = np.flatnonzero(content == ord("\n"))
    widths = np.diff(np.searchsorted(np.flatnonzero(content == ord(",")), ends), prepend=0) + 1
    width = int(widths[0])
    if (widths != width).any() or not 1 < width <= MOST_COLUMNS or widths.sum() > MOST_CELLS:
        return None
    if np.diff(ends, prepend=-1).max() > csv.field_size_limit():
        return None
    cells = text[:-1].replace("\n", ",").split(",")
    return [cells[column::width] for column in range(width)]


def number_of_word(word: str, where: str) -> float:
    """Return the finite number that a word of the command line is.

    Args:
        word: The word.
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


def plain_numbers(cells: Sequence[str]) -> NDArray | None:
    """Return the numbers of a column at once, nan for an empty cell.

    Args:
        cells: Their texts.

    Returns:
        Shape (N,), what `parse_number` makes of each; None where one of them needs a second look.
    """
    try:
        values = np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        return None
    if any(cells[row] for row in np.flatnonzero(~(np.abs(values) <= LARGEST)).tolist()):
        return None
    return None if "_" in "".join(cells) else values


def plain_integers(cells: Sequence[str]) -> NDArray | None:
    """Return the whole numbers of a column at once; None where one of them needs a second look.

    Args:
        cells: Their texts.

    Returns:
        Shape (N,).
    """
    text = "\n".join(cells)
    if not _INTEGERS.fullmatch(text):
        return None
    values = np.array(text.split("\n"), dtype=np.int64)
    return values if len(values) == len(cells) else None


def parse_number(cell: str) -> float:
    """Return the finite number in a cell, nan for an empty one.

    Args:
        cell: Its text.

    Returns:
        The number.

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
