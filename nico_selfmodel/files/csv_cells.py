"""Cells of text in the tables we write: a spreadsheet must not take them for formulas.

A cell that begins with = + - @ or a tab is a formula to spreadsheets, whatever quotes stand around
it (CWE-1236); an apostrophe before it makes it text. Reading takes the apostrophe away again.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping
from itertools import chain
from typing import Any

_STARTS = ("=", "+", "-", "@", "\t")
_SPECIAL = re.compile('[,"\r\n]')
_NUMBER = re.compile(r"[-+]?[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?")


def safe_cell(text: str) -> str:
    """Return a cell of text that is a formula to no spreadsheet; numbers stay as they are."""
    return f"'{text}" if _is_guarded(text) and not _NUMBER.fullmatch(text) else text


def original_cell(cell: str) -> str:
    """Return the text that `safe_cell` made a cell of."""
    return cell[1:] if cell.startswith("'") and _is_guarded(cell) else cell


def quoted_cell(cell: str) -> str:
    """Return a cell as it stands in the file.

    The csv module leaves a lone carriage return unquoted, which then reads as a line end.
    """
    if _SPECIAL.search(cell):
        return '"' + cell.replace('"', '""') + '"'
    return cell


def text_cells(texts: Iterable[str]) -> list[str]:
    """Return cells of text as they stand in the file: quoted, and formulas to no spreadsheet."""
    texts = list(texts)
    written = {text: quoted_cell(safe_cell(text)) for text in set(texts)}
    return [written[text] for text in texts]


def number_cells(values: Iterable[float]) -> list[str]:
    """Return numbers as they stand in the file: to the last bit, and nan as an empty cell."""
    return ["" if value != value else repr(value) for value in values]


def table_text(columns: Mapping[str, Iterable[str]], *, heading: bool = True) -> str:
    """Return a table as text.

    Args:
        columns: Heading -> cells as they stand in the file (`text_cells`, `number_cells`).
        heading: Begin with the line of headings; not where rows go on.

    Raises:
        ValueError: If columns differ in length.
    """
    rows = map(",".join, zip(*columns.values(), strict=True))
    first = [",".join(text_cells(columns))] if heading else []
    return "\n".join([*first, *rows, ""])


def rows_text(headings: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Return rows under headings as text: numbers to the last bit, None as an empty cell."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    for row in chain([headings], rows):
        writer.writerow([safe_cell(v) if isinstance(v, str) else v for v in row])
    return buffer.getvalue()


def _is_guarded(cell: str) -> bool:
    return cell.lstrip("'").startswith(_STARTS)
