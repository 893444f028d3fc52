"""Figures as part of a page: text that can be selected, colours of the page, panels that wrap."""

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from nico_selfmodel.viz.figures import palette, plot_style
from nico_selfmodel.viz.figures.layout.room_of_axes import bounds_in_points
from nico_selfmodel.viz.figures.layout.single_pass_layout import SinglePassLayout

_COLOURS = {
    palette.INK: "ink",
    palette.MUTED: "muted",
    palette.FAINT: "grid",
    palette.HELD_OUT: "held-out",
    palette.TRAINING: "training",
    palette.OUTLIER: "outlier",
    "#ffffff": "paper",
}
"""Colours of figures that are the page's own, which are others when it is dark."""
_PAGE_COLOUR = re.compile("|".join(_COLOURS))
_FONT = "'DejaVu Sans'"
_FONTS = "'DejaVu Sans', Verdana, sans-serif"
_PANEL = "panel-"
_FINE = re.compile(r"(?<=\.\d\d)\d+")
"""What numbers of a path say finer than a hundredth of a point."""
_REFERENCE = re.compile(r"url\(#([^)]+)\)")


@dataclass(frozen=True)
class Panel:
    """A part of a figure that stays whole, however narrow the page is."""

    svg: str
    """Of the `<svg>`: what is in it."""
    x: float
    y: float
    width: float
    height: float
    """Of its part of the figure [pt]."""
    below: bool = False
    """Whether it begins a line of its own."""


@dataclass(frozen=True)
class InlineFigure:
    """A figure as its headline and its panels from left to right."""

    headline: str
    panels: tuple[Panel, ...]

    @classmethod
    def of(cls, figure: Figure) -> "InlineFigure":
        """Take a figure apart; the same figure gives the same text.

        Args:
            figure: The figure. Its headline is no longer drawn in it.
        """
        headline = figure.get_suptitle()
        for text in figure.texts:
            if headline and text.get_text() == headline:
                text.set_visible(False)
                text.set_in_layout(False)
        for index, axes in enumerate(figure.axes):
            axes.set_gid(f"{_PANEL}{index}")
        content = plot_style.image_bytes(figure, "svg")
        root = _as_html(ElementTree.fromstring(content), hashlib.sha256(content).hexdigest()[:8])
        return cls(headline, tuple(_panels(figure, root)))


def _as_html(root: ElementTree.Element, mark: str) -> ElementTree.Element:
    """Write an SVG as HTML reads it, with names of its own and the colours of the page."""
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        for key, value in list(element.attrib.items()):
            del element.attrib[key]
            name = key.rpartition("}")[2]
            if name == "id" and not value.startswith(_PANEL):
                value = f"{mark}-{value}"
            elif name == "href" and value.startswith("#"):
                value = f"#{mark}-{value[1:]}"
            value = _REFERENCE.sub(rf"url(#{mark}-\1)", value)
            if name == "d":
                value = _FINE.sub("", value)
            if name == "style":
                value = _PAGE_COLOUR.sub(lambda found: f"var(--{_COLOURS[found[0]]})", value)
                value = value.replace(_FONT, _FONTS)
            element.set(name, value)
    return root


def _panels(figure: Figure, root: ElementTree.Element) -> Iterator[Panel]:
    """Yield the columns of axes of a figure, and its legends as panels below them."""
    drawn = next((group for group in root if group.tag == "g"), None)
    if drawn is None:
        return
    width, height = (72.0 * float(inches) for inches in figure.get_size_inches())
    of_axes = {child.get("id", ""): child for child in drawn if _is_panel(child)}
    others = [child for child in drawn if not _is_panel(child) and len(child)][1:]
    shared = _text(child for child in root if child.tag == "defs" and child.find("style") is None)
    columns = _columns(figure)
    floor, low, high, top = height, 0.0, width, 0.0
    if len(columns) > 1 and figure.legends:
        legends = Bbox.union([legend.get_window_extent() for legend in figure.legends])
        low, top, high = (72.0 / figure.dpi * end for end in (legends.x0, legends.y1, legends.x1))
        floor = height - top
    left = 0.0
    for number, column in enumerate(columns):
        last = number == len(columns) - 1
        right = width if last else 0.5 * (column.high + columns[number + 1].low)
        svg = _text(of_axes.pop(f"{_PANEL}{index}") for index in column.axes)
        if len(columns) == 1:
            svg += _text(others)
        yield Panel(svg + (shared if last else ""), left, 0.0, right - left, floor)
        left = right
    if floor < height:
        yield Panel(_text(others), low, floor, high - low, top, below=True)


def _is_panel(element: ElementTree.Element) -> bool:
    return element.get("id", "").startswith(_PANEL)


def _text(elements: Iterator[ElementTree.Element] | list[ElementTree.Element]) -> str:
    return "".join(ElementTree.tostring(element, encoding="unicode") for element in elements)


@dataclass
class _Column:
    """Axes one above the other, with their colour bar."""

    axes: list[int]
    low: float
    high: float
    """Where they begin and end with all that is written about them [pt]."""


def _columns(figure: Figure) -> list[_Column]:
    layout = figure.get_layout_engine()
    laid_out = isinstance(layout, SinglePassLayout)
    bounds = layout.bounds if laid_out else bounds_in_points(figure)
    drawn = [(one.get_position().x0, index, one) for index, one in enumerate(figure.axes)]
    columns: list[_Column] = []
    inner = 0.0
    for begins, index, axes in sorted(drawn, key=lambda one: one[0]):
        low, high = bounds[axes].intervalx
        if columns and (axes.get_label() == "<colorbar>" or begins < inner):
            columns[-1].axes.append(index)
            columns[-1].low = min(columns[-1].low, low)
            columns[-1].high = max(columns[-1].high, high)
        else:
            columns.append(_Column([index], low, high))
        inner = max(inner, axes.get_position().x1)
    return columns
