"""What a report is made of: sections, and the parts that stand in them."""

from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from nico_selfmodel.viz.reports.inline_figure import InlineFigure
from nico_selfmodel.viz.reports.tables import Table
from nico_selfmodel.viz.scene.scene import Scene


@dataclass(frozen=True)
class Text:
    """A paragraph. What stands between backticks is set as code."""

    words: str
    """One sentence or a few."""
    kind: str = ""
    """`hint` for small print, `warn` for what must not be missed."""
    more: str = ""
    """`id` of the section that tells more, where there is one."""


@dataclass(frozen=True)
class Bullets:
    """Sentences, one a line."""

    lines: tuple[str, ...]
    """May hold code between backticks."""
    kind: str = ""
    """`warn` for what must not be missed."""


@dataclass(frozen=True)
class Numbers:
    """A table of numbers."""

    table: Table
    """Rows under headings."""
    kind: str = ""
    """`errors` where the first row is the one that counts, `text` for words, `cards` where a narrow
    page shows one card a row."""
    rows: str = ""
    """What its rows are, where more than anybody reads at once are folded away."""


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure."""

    figure: Figure
    about: str
    """What it shows, for those who do not see it."""
    width: str = "wide"
    """`wide`, `half` or `matrix`."""

    @property
    def inline(self) -> InlineFigure:
        """The figure as the page holds it."""
        return InlineFigure.of(self.figure)


@dataclass(frozen=True)
class Tile:
    """A number that says much, in large letters."""

    number: str
    """With its unit."""
    what: str
    """What it is."""
    note: str
    """How to read it."""


@dataclass(frozen=True)
class Tiles:
    """Numbers in large letters, side by side."""

    tiles: tuple[Tile, ...]


@dataclass(frozen=True, eq=False)
class Stage:
    """The interactive scene with its legend."""

    scene: Scene


@dataclass(frozen=True)
class Thumbnail:
    """One photograph with its corners."""

    file: str
    """Name of the photograph."""
    color: str
    """Of the camera."""
    rms: float | None
    """Of its corners [px]."""
    note: str
    """What was tried in vain; empty where the board was found."""
    uri: str | None
    """The photograph; None where it was not kept."""
    covered: tuple[int, int]
    """Width and height of what the small photograph shows [px]."""
    crosses: str
    """The corners as an SVG path."""
    row: str
    """The first row of corners as an SVG path, so that their order shows."""
    far: tuple[tuple[float, float], ...]
    """Corners that fit far worse than the others [px]."""
    stroke: float
    """Width of its lines [px]."""


@dataclass(frozen=True)
class GalleryRow:
    """One view: its cameras side by side."""

    name: str
    """Of the view."""
    use: str
    """What it was used for, of `camera_views.USES`."""
    pictures: tuple[Thumbnail, ...]
    """One a camera."""


@dataclass(frozen=True)
class Gallery:
    """Photographs as a part of a report."""

    rows: tuple[GalleryRow, ...]
    """One a view."""


@dataclass(frozen=True, eq=False)
class Beside:
    """Parts side by side, where there is room."""

    parts: tuple[Any, ...]
    kind: str = "pair"
    """`pair` for halves of the page, `beside` for as wide as they are."""


@dataclass(frozen=True, eq=False)
class Folded:
    """Parts that open at a click."""

    summary: str
    parts: tuple[Any, ...]
    open: bool = False


@dataclass(frozen=True, eq=False)
class Section:
    """A question and what the evidence answers: figures, tables, text, sections of their own."""

    title: str
    """Heading; without one the section continues what stands above it."""
    parts: tuple[Any, ...]
    """In this order."""
    message: str = ""
    """What to know before reading on, in a sentence or two."""
    id: str = ""
    """Where links lead."""
    kind: str = ""
    """`warnings` for a box."""


def section(title: str, *parts: Any, **more: str) -> Section:
    """Return a section of the parts that there are; None stands for one that there is not.

    Args:
        more: `message`, `id` and `kind`.
    """
    return Section(title, tuple(part for part in parts if part is not None), **more)


def hint(words: str, more: str = "") -> Text:
    """Return small print."""
    return Text(words, "hint", more)


def numbers(table: Table | None, kind: str = "", rows: str = "") -> Numbers | None:
    """Return a table as a part, None where it is none or empty."""
    return Numbers(table, kind, rows) if table is not None and table.rows else None


def drawing(about: str, figure: Figure | None, width: str = "wide") -> Drawing | None:
    """Return a figure as a part, None where there is none."""
    return None if figure is None else Drawing(figure, about, width)


def halves(*drawings: tuple[str, Figure | None]) -> Beside:
    """Return figures of half the page's width side by side: what they show, and the figure."""
    found = (Drawing(figure, about, "half") for about, figure in drawings if figure is not None)
    return Beside(tuple(found))
