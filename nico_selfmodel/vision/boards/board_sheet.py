"""A board to print, at exact size."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.vision.boards.board_detection import AnyBoard
from nico_selfmodel.vision.markers.marker_sheet import FOOT, HEAD, MARGIN, PAPERS, ruler
from nico_selfmodel.vision.markers.sheet_files import Blocks, Page, Text, write_pages

_MM = 1e3


@dataclass(frozen=True)
class BoardSheet:
    """One board on one page, with what it is and a ruler."""

    board: AnyBoard
    """What is printed."""
    paper: str = "a4"
    """One of `PAPERS`, upright or across as the board needs."""

    def __post_init__(self) -> None:
        """Refuse a board that does not fit."""
        refuse_unknown("paper", self.paper, PAPERS)
        if self._page_of(self.paper) is None:
            width, height = self._extent[1] - self._extent[0]
            fitting = [paper for paper in PAPERS if self._page_of(paper)]
            hint = f"take {fitting[0]}" if fitting else "take smaller squares"
            raise ValueError(
                f"board {self.board} of {width:.0f} x {height:.0f} mm does not fit on "
                f"{self.paper}: {hint}"
            )

    @property
    def words(self) -> str:
        """What the board is, as the options that commands want."""
        facts = {key.replace("_", "-"): value for key, value in self.board.facts.items()}
        words = (f"{v:g}" if isinstance(v, float) else v for v in facts.values())
        return " ".join(f"--{key} {word}" for key, word in zip(facts, words, strict=True))

    @property
    def page(self) -> Page:
        """What goes where."""
        size = self._page_of(self.paper)
        assert size is not None
        width, height = size
        low, high = self._extent
        middle = np.array([0.5 * width, 0.5 * (height + HEAD - FOOT)])
        shift = middle - 0.5 * (low + high)
        ink = self.board.ink
        blocks, discs = _MM * ink.blocks, _MM * ink.discs
        blocks[:, :2] += shift
        discs[:, :2] += shift
        drawn = Blocks(
            tuple((x, y, w, h) for x, y, w, h in blocks.tolist()),
            tuple((x, y, r) for x, y, r in discs.tolist()),
        )
        head = Text(MARGIN, MARGIN + 5.0, 4.0, self.words, bold=True)
        lines, texts = ruler(MARGIN, height - MARGIN - 8.0)
        return Page(width, height, (drawn,), tuple(lines), (head, *texts))

    def save(self, path: str | Path, dpi: int = 600) -> None:
        """Write the sheet, whole or not at all.

        Args:
            path: `.pdf`, `.svg` or `.png`.
            dpi: Resolution of a PNG, in which edges are rounded to pixels [1/inch].

        Raises:
            ValueError: If the ending is another.
            OSError: If the folder is missing or cannot be written to.
        """
        write_pages(path, [self.page], dpi)

    @property
    def _extent(self) -> np.ndarray:
        """Least and largest x and y of what is black, in the board's frame [mm]. Shape (2, 2)."""
        ink = self.board.ink
        low = [ink.blocks[:, :2], ink.discs[:, :2] - ink.discs[:, 2:]]
        high = [ink.blocks[:, :2] + ink.blocks[:, 2:], ink.discs[:, :2] + ink.discs[:, 2:]]
        return _MM * np.array([np.concatenate(low).min(axis=0), np.concatenate(high).max(axis=0)])

    def _page_of(self, paper: str) -> tuple[float, float] | None:
        """Return width and height of a page as it must lie; None where the board does not fit."""
        low, high = self._extent
        for width, height in (PAPERS[paper], PAPERS[paper][::-1]):
            room = np.array([width, height - HEAD - FOOT]) - 2.0 * MARGIN
            if (high - low <= room).all():
                return width, height
        return None
