"""Axes whose ticks are drawn all at once.

Matplotlib makes five objects for each tick, of which a report has hundreds: making and drawing them
took longer than all that is measured. Here grid lines are one path, ticks another, and labels are
written where Matplotlib would write them; nothing else of an axis is changed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, NullFormatter, NullLocator, ScalarFormatter
from matplotlib.transforms import Bbox, IdentityTransform
from numpy.typing import NDArray

from nico_selfmodel.viz.figures.layout.widths_of_text import ascent_and_descent, width_of

_LOOKS = {"fontsize": "labelsize", "rotation": "labelrotation", "color": "labelcolor"}
"""How `set_ticklabels` calls what `set_tick_params` has other words for."""

_DRAWN = ("tick", "label")
_GAP = 0.5
"""Least room between the numbers of an axis, in sizes of their font."""
_LINE = 1.2
"""From line to line of a label, in heights of a line: Matplotlib's."""


@dataclass(frozen=True, eq=False)
class _Places:
    """Where ticks are."""

    values: NDArray
    """All that there are, shown or not. Shape (n,)."""
    shown: NDArray
    """Whether each is within what is shown. Shape (n,)."""
    at: NDArray
    """Along the axis [dots]. Shape (n,)."""


@dataclass(frozen=True, eq=False)
class _Label:
    """What is written at a tick."""

    text: str
    left: float
    low: float
    """Where its baseline begins, and the lower end of that if it is written upwards [dots]."""
    anchor: tuple[float, float]
    """The middle of a label below or above an axis, the near end of one beside it [dots]."""
    box: Bbox
    """All of it [dots]."""


class _TicksAtOnce:
    """What `XAxis` and `YAxis` have in common."""

    majorTicks = minorTicks = ()
    across = 0
    """0 for x, 1 for y."""

    def get_major_ticks(self: Any, numticks: int | None = None) -> list:
        """Return none: there are no single ticks."""
        return []

    get_minor_ticks = get_major_ticks

    def get_majorticklabels(self: Any) -> list[Text]:
        """Return what is written at the ticks, each with the place of its tick [data]."""
        values = self.get_majorticklocs()
        places = np.zeros((len(values), 2))
        places[:, self.across] = values
        words = self.major.formatter.format_ticks(values)
        return [Text(*place, text) for place, text in zip(places.tolist(), words, strict=True)]

    def _update_ticks(self: Any) -> list:
        return []

    def _get_ticklabel_bboxes(
        self: Any, ticks: Any, renderer: RendererBase
    ) -> tuple[list[Bbox], list[Bbox]]:
        """Return the bounds of labels at the low and at the high side."""
        places = self._places("major")
        low, high = ([one.box for one in self._labels(side, renderer, places)] for side in (1, 2))
        return low, high

    def set_ticklabels(
        self: Any, labels: Sequence[str], *, minor: bool = False, **look: Any
    ) -> None:
        """Name the ticks that `set_ticks` has set."""
        self.set_major_formatter(FixedFormatter(list(labels)) if len(labels) else NullFormatter())
        if look:
            self.set_tick_params(**{_LOOKS[key]: value for key, value in look.items()})

    def draw(self: Any, renderer: RendererBase) -> None:
        """Draw grid, ticks, their labels, and the name of the axis."""
        if not self.get_visible():
            return
        renderer.open_group("matplotlib.axis", gid=self.get_gid())
        places = self._places("major")
        if not isinstance(self.get_minor_locator(), NullLocator):
            self._draw_lines(renderer, "minor", self._places("minor"))
        self._draw_lines(renderer, "major", places)
        self._draw_labels(renderer, places)
        self._update_label_position(renderer)
        self.label.draw(renderer)
        offset = self.major.formatter.get_offset()
        if offset:
            self._update_offset_text_position(*self._get_ticklabel_bboxes((), renderer))
            self.offsetText.set_text(offset)
            self.offsetText.draw(renderer)
        renderer.close_group("matplotlib.axis")
        self.stale = False

    def bounds_of_ticks(self: Any, renderer: RendererBase) -> list[Bbox]:
        """Return the bounds of the ticks at both sides, and of their labels [dots]."""
        low, high = self._get_ticklabel_bboxes((), renderer)
        ends = self.axes.bbox.get_points().copy()
        for side in (1, 2):
            ticks, labels = (self._asked("major", f"{what}{side}On", side == 1) for what in _DRAWN)
            reach = self._reach("major", "size") * bool(ticks or labels)
            reach += self._reach("major", "pad") * bool(labels)
            ends[side - 1, 1 - self.across] += reach * (2 * side - 3)
        return [Bbox(ends), *low, *high]

    def _asked(self: Any, which: str, key: str, otherwise: Any) -> Any:
        """Return what `set_tick_params` was told."""
        kept = self._major_tick_kw if which == "major" else self._minor_tick_kw
        return kept.get(key, otherwise)

    def _set(self: Any, which: str, key: str) -> Any:
        """Return what was asked of ticks, or matplotlib's setting of it."""
        name = f"{'xy'[self.across]}tick.{which}.{key}"
        name = name if name in rcParams else f"{'xy'[self.across]}tick.{key}"
        found = self._asked(which, key, None)
        if found is None:
            found = rcParams[name]
            if key == "labelcolor" and found == "inherit":
                return rcParams[f"{'xy'[self.across]}tick.color"]
        return found

    def _reach(self: Any, which: str, key: str) -> float:
        """Return a length that is set in points [dots]."""
        return float(self._set(which, key)) * self.figure.dpi / 72.0

    def _places(self: Any, which: str) -> _Places:
        """Return where ticks are."""
        found = self.get_majorticklocs() if which == "major" else self.get_minorticklocs()
        values = np.asarray(found, dtype=float)
        low, high = sorted(self.get_transform().transform(np.array(self.get_view_interval())))
        at = self.get_transform().transform(values)
        slack = 1e-10 * (high - low)
        shown = (at >= low - slack) & (at <= high + slack)
        points = np.zeros((len(values), 2))
        points[:, self.across] = values
        transform = (self.axes.get_xaxis_transform, self.axes.get_yaxis_transform)[self.across]
        return _Places(values, shown, transform("tick1").transform(points)[:, self.across])

    @property
    def _upright(self: Any) -> bool:
        """Whether labels are written upwards."""
        return bool(self._asked("major", "labelrotation", 0.0))

    def _edges(self: Any) -> NDArray:
        """Return where the two sides are at which ticks stand [dots]."""
        return self.axes.bbox.get_points()[:, 1 - self.across]

    def _draw_lines(self: Any, renderer: RendererBase, which: str, places: _Places) -> None:
        at, edges = places.at[places.shown], self._edges()
        if self._asked(which, "gridOn", False):
            look = (f"grid_{part}" for part in ("color", "linewidth"))
            look = (self._asked(which, name, rcParams[name.replace("_", ".")]) for name in look)
            self._draw_path(renderer, at, *edges, *look)
        size, colour, width = (self._set(which, key) for key in ("size", "color", "width"))
        size = float(size) * self.figure.dpi / 72.0
        for side in (1, 2):
            if size and self._asked(which, f"tick{side}On", side == 1):
                edge = edges[side - 1]
                self._draw_path(renderer, at, edge, edge + size * (2 * side - 3), colour, width)

    def _draw_path(
        self: Any, renderer: RendererBase, at: NDArray, low: float, high: float, colour: Any,
        width: float,
    ) -> None:  # fmt: skip
        """Draw lines across the axis, all in one."""
        if not len(at):
            return
        ends = np.empty((len(at), 2, 2))
        ends[..., self.across] = at[:, None]
        ends[..., 1 - self.across] = low, high
        pen = renderer.new_gc()
        pen.set_foreground(colour)
        pen.set_linewidth(width)
        codes = np.tile([Path.MOVETO, Path.LINETO], len(at))
        renderer.draw_path(pen, Path(ends.reshape(-1, 2), codes), IdentityTransform())
        pen.restore()

    def _labels(self: Any, side: int, renderer: RendererBase, places: _Places) -> Iterator[_Label]:
        """Yield the labels that are written at a side, 1 low and 2 high."""
        if not self._asked("major", f"label{side}On", side == 1):
            return
        words = np.array(self.major.formatter.format_ticks(places.values), dtype=object)
        dot = self.figure.dpi / 72.0
        font = FontProperties(size=self._set("major", "labelsize"))
        size = font.get_size_in_points() * dot
        upright, (up, down) = self._upright, (size * part for part in ascent_and_descent())
        off = self._reach("major", "size") + self._reach("major", "pad")
        edge = self._edges()[side - 1] + off * (2 * side - 3)
        at, words = self._apart(places.at[places.shown], words[places.shown], size)
        for place, text, higher in self._lines(at, words, side, up + down):
            along = size * width_of(text)
            if isinstance(renderer, RendererAgg):  # whose dots widen letters
                along = renderer.get_text_width_height_descent(text, font, False)[0]
            wide, tall = (up + down, along) if upright else (along, up + down)
            if self.across == 0:
                left, low = place - 0.5 * wide, edge - (tall if side == 1 else 0.0) + higher
                anchor = (place, edge + higher)
            else:
                # the middle of letters without tails is where the tick is
                low = place - 0.5 * up - down + higher
                left, anchor = edge - (wide if side == 1 else 0.0), (edge, place + higher)
            base = (left + up, low) if upright else (left, low + down)
            yield _Label(text, *base, anchor, Bbox.from_bounds(left, low, wide, tall))

    def _apart(self: Any, at: NDArray, words: NDArray, size: float) -> tuple[NDArray, NDArray]:
        """Return every second number below an axis, and of these again, until none touch."""
        numbers = isinstance(self.major.formatter, ScalarFormatter)
        while len(at) > 2 and numbers and self.across == 0 and not self._upright:
            half = size * 0.5 * np.array([width_of(text) for text in words.tolist()])
            if (np.abs(np.diff(at)) >= half[1:] + half[:-1] + _GAP * size).all():
                break
            at, words = at[::2], words[::2]
        return at, words

    def _lines(
        self: Any, places: NDArray, words: NDArray, side: int, tall: float
    ) -> Iterator[tuple[float, str, float]]:
        """Yield each line of labels: its tick's place, and how much higher it is [dots].

        Below an axis the first line is nearest to it, above it the last, and beside it the middle.
        """
        for place, text in zip(places.tolist(), words.tolist(), strict=True):
            lines = text.split("\n")
            first = 0.5 * self.across if self.across else float(side == 2)
            for k, line in enumerate(lines):
                if line:
                    yield place, line, _LINE * tall * (first * (len(lines) - 1) - k)

    def _draw_labels(self: Any, renderer: RendererBase, places: _Places) -> None:
        font = FontProperties(size=self._set("major", "labelsize"))
        top = renderer.get_canvas_width_height()[1]
        pen = renderer.new_gc()
        pen.set_foreground(self._set("major", "labelcolor"))
        for side in (1, 2):
            where = "center" if self.across == 0 else ("right", "left")[side - 1]
            anchor = Text(horizontalalignment=where)
            for label in self._labels(side, renderer, places):
                anchor.set_position(label.anchor)
                y = top - label.low if renderer.flipy() else label.low
                angle = 90.0 if self._upright else 0.0
                renderer.draw_text(pen, label.left, y, label.text, font, angle, mtext=anchor)
        pen.restore()


class _PlainX(_TicksAtOnce, XAxis):  # pyright: ignore[reportIncompatibleMethodOverride]
    """Ticks of x at once."""


class _PlainY(_TicksAtOnce, YAxis):  # pyright: ignore[reportIncompatibleMethodOverride]
    """Ticks of y at once."""

    across = 1


class PlainAxes(Axes):
    """A panel whose ticks are drawn at once."""

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _PlainX(self, clear=False), _PlainY(self, clear=False)
        for axis, sides in ((self.xaxis, "bottom top"), (self.yaxis, "left right")):
            for side in sides.split():
                self.spines[side].register_axis(axis)
