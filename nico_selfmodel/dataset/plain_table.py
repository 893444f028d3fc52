"""Tables of plain cells, column by column: a million rows take seconds.

What may be more than plain is left to the careful way of `files.csv_rows`, which says what is
wrong.
"""

import csv
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.files.csv_rows import MOST_CELLS, MOST_COLUMNS
from nico_selfmodel.files.yaml_mapping import LARGEST

_MOST_DIGITS = 18
"""Fewer than those of the largest that a column of 64 bits holds."""


def plain_columns(text: str) -> Sequence[Sequence[str]] | None:
    """Read text in which each line is a row of as many plain cells, at once.

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


def plain_numbers(cells: Sequence[str]) -> NDArray | None:
    """Return the numbers of a column at once, nan for an empty cell.

    Returns:
        Shape (N,), what `parse_number` makes of each; None where one of them needs a second look.
    """
    values = _floats(cells)
    if values is None and not all(cells):
        values = _floats([cell or "nan" for cell in cells])
    if values is None or any(
        cells[row] for row in np.flatnonzero(~(np.abs(values) <= LARGEST)).tolist()
    ):
        return None
    return None if "_" in "".join(cells) else values


def _floats(cells: Sequence[str]) -> NDArray | None:
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        return None


def plain_integers(cells: Sequence[str]) -> NDArray | None:
    """Return the whole numbers of a column at once; None where one of them needs a second look.

    Returns:
        Shape (N,).
    """
    text = "\n".join(["", *cells])
    content = np.frombuffer(text.encode(), np.uint8)
    ends = np.flatnonzero(content == ord("\n"))
    signed = np.isin(np.take(content, ends + 1, mode="clip"), (ord("+"), ord("-")))
    digits = np.diff(ends, append=len(content)) - 1 - signed
    others = (content < ord("0")) | (content > ord("9"))
    if others.sum() != len(ends) + signed.sum() or len(ends) != len(cells):
        return None
    if not len(cells) or digits.min() < 1 or digits.max() > _MOST_DIGITS:
        return None
    return np.fromstring(text, dtype=np.int64, sep="\n")
