"""A sheet of fiducial markers to print, at exact size: what goes where."""

import itertools
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily
from nico_selfmodel.vision.markers.sheet_files import Cells, Line, Page, Text, write_pages

PAPERS = {
    "a4": (210.0, 297.0),
    "letter": (215.9, 279.4),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
}
"""Width and height by name [mm]."""

MARGIN = 12.0
"""What printers may leave white [mm]."""
HEAD, FOOT = 12.0, 20.0
"""Height of the heading and of the ruler [mm]."""
_GAP = 5.0  # between cut lines [mm]
_LABEL = 4.5  # height of the strip under a marker [mm]
_LETTERS = 2.6  # height of type [mm]
_RULER = 100.0  # [mm]
_SMALLEST = 3.0  # [mm]


@dataclass(frozen=True)
class MarkerSheet:
    """Markers of one family and one size, with quiet zones, labels, cut lines and a ruler."""

    ids: tuple[int, ...]
    """Which markers, in the order of the sheet."""
    size_mm: float
    """Side of a marker's black square [mm]."""
    family: str = DEFAULT_FAMILY
    """Name of the family."""
    paper: str = "a4"
    """One of `PAPERS`, upright."""

    def __post_init__(self) -> None:
        """Refuse what cannot be printed, and warn of markers that a mirror turns into others."""
        refuse_unknown("paper", self.paper, PAPERS)
        if not self.ids:
            raise ValueError("no ids: at least one marker is needed")
        family = FiducialFamily(self.family)
        for marker in self.ids:
            family.pattern(marker)
        if not _SMALLEST <= self.size_mm < np.inf or not self._across or not self._down:
            width, height = PAPERS[self.paper]
            most = min(width - 2 * MARGIN, height - 2 * MARGIN - HEAD - FOOT - _LABEL)
            largest = np.floor(most / (1.0 + 2.0 / family.cells))
            raise ValueError(
                f"size_mm must be from {_SMALLEST:g} to {largest:g} on {self.paper} paper,"
                f" got {self.size_mm:g}"
            )
        twins = sorted(set(self.ids) & family.mirror_twins)
        if twins:
            some = ", ".join(map(str, twins[:8])) + (" and others" if len(twins) > 8 else "")
            warnings.warn(
                f"{self.family}: {some} look in a mirror like other markers of the family; where a"
                " mirror may be in view, take other ids or apriltag_36h11",
                stacklevel=3,
            )

    @property
    def quiet_mm(self) -> float:
        """Width of the white zone between a marker and its cut line, one cell [mm]."""
        return self.size_mm / FiducialFamily(self.family).cells

    @property
    def pages(self) -> list[Page]:
        """What goes where."""
        most = self._across * self._down
        parts = [self.ids[i : i + most] for i in range(0, len(self.ids), most)]
        return [self._page(part, i, len(parts)) for i, part in enumerate(parts, start=1)]

    def save(self, path: str | Path, dpi: int = 600) -> None:
        """Write the sheet, whole or not at all.

        Args:
            path: `.pdf` (any number of pages), `.svg` or `.png` (one page).
            dpi: Resolution of a PNG, in which edges are rounded to pixels [1/inch].

        Raises:
            ValueError: If the ending is another, or the markers need more than one page of an SVG
                or PNG.
            OSError: If the folder is missing or cannot be written to.
        """
        pages = self.pages
        if len(pages) > 1 and Path(path).suffix.lower() in (".svg", ".png"):
            raise ValueError(
                f"{len(self.ids)} markers of {self.size_mm:g} mm need {len(pages)} pages"
                f" ({self._across * self._down} fit on one): write a .pdf, or several sheets"
            )
        write_pages(path, pages, dpi)

    @property
    def _frame(self) -> tuple[float, float]:
        """Width and height within the cut lines [mm]."""
        side = self.size_mm + 2.0 * self.quiet_mm
        return side, side + _LABEL

    @property
    def _across(self) -> int:
        return int((PAPERS[self.paper][0] - 2 * MARGIN + _GAP) // (self._frame[0] + _GAP))

    @property
    def _down(self) -> int:
        room = PAPERS[self.paper][1] - 2 * MARGIN - HEAD - FOOT
        return int((room + _GAP) // (self._frame[1] + _GAP))

    def _page(self, ids: Sequence[int], number: int, pages: int) -> Page:
        width, height = PAPERS[self.paper]
        of = f"   page {number} of {pages}" if pages > 1 else ""
        head = f"{self.family}   black squares of {self.size_mm:g} mm{of}"
        cells, lines, texts = [], [], [Text(MARGIN, MARGIN + 5.0, 4.0, head, bold=True)]
        for i, marker in enumerate(ids):
            row, column = divmod(i, self._across)
            left = MARGIN + column * (self._frame[0] + _GAP)
            top = MARGIN + HEAD + row * (self._frame[1] + _GAP)
            pattern = FiducialFamily(self.family).pattern(marker)
            quiet = self.quiet_mm
            cells.append(Cells(left + quiet, top + quiet, self.size_mm, _black(pattern)))
            lines += _cut_lines(left, top, *self._frame)
            label = Text(left + quiet, top + self._frame[1] - 1.6, _LETTERS, self._label(marker))
            texts.append(label)
        scale, words = ruler(MARGIN, height - MARGIN - 8.0)
        return Page(width, height, tuple(cells), tuple(lines + scale), tuple(texts + words))

    def _label(self, marker: int) -> str:
        """Return as much of family, id and size as the width holds."""
        texts = [
            f"{self.family}  id {marker}  {self.size_mm:g} mm",
            f"id {marker}  {self.size_mm:g} mm",
        ]
        fitting = [text for text in texts if 0.55 * _LETTERS * len(text) <= self._frame[0]]
        return fitting[0] if fitting else str(marker)


def parse_ids(text: str) -> tuple[int, ...]:
    """Return the numbers that a text like `0-3,7` names.

    Args:
        text: Numbers and ranges, with commas between them.

    Returns:
        The numbers, in the order of the text.

    Raises:
        ValueError: If the text is something else, or names a number twice.
    """
    ids: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,5})(?:\s*-\s*(\d{1,5}))?\s*", part)
        if match is None or (match[2] and int(match[2]) < int(match[1])):
            raise ValueError(f"ids are written as 0-11 or 0,3,7, got {text!r}")
        ids += range(int(match[1]), int(match[2] or match[1]) + 1)
    if len(set(ids)) < len(ids):
        raise ValueError(f"ids must not name a marker twice, got {text!r}")
    return tuple(ids)


def _black(pattern: NDArray) -> tuple[tuple[int, int, int], ...]:
    """Return runs of black cells: row, first column, number of cells."""
    runs = []
    for row, cells in enumerate(~pattern):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(int), [0]])))
        runs += [(row, int(a), int(b - a)) for a, b in edges.reshape(-1, 2)]
    return tuple((row, first, count) for row, first, count in runs)


def _cut_lines(left: float, top: float, width: float, height: float) -> list[Line]:
    right, bottom = left + width, top + height
    corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)]
    return [Line(*a, *b, dashed=True) for a, b in itertools.pairwise(corners)]


def ruler(left: float, base: float) -> tuple[list[Line], list[Text]]:
    """Return a ruler of 100 mm and what it is for: its left end, its height on the page [mm]."""
    lines = [Line(left, base, left + _RULER, base)]
    texts = []
    for mm in range(int(_RULER) + 1):
        tick = 4.0 if mm % 10 == 0 else 3.0 if mm % 5 == 0 else 1.8
        lines.append(Line(left + mm, base, left + mm, base - tick))
        if mm % 10 == 0:
            texts.append(Text(left + mm, base + 3.6, _LETTERS, str(mm), middle=True))
    texts.append(Text(left + _RULER + 6.0, base - 1.2, _LETTERS, "Print at 100 % (actual size):"))
    texts.append(Text(left + _RULER + 6.0, base + 2.4, _LETTERS, "this ruler must be 100 mm long."))
    return lines, texts
