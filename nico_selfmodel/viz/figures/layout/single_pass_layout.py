"""Where the panels of a figure stand, as close as their labels allow.

Matplotlib's constrained layout measures every panel with all its ticks many times over, which takes
longer than drawing. The figures here are grids of equal panels, at most with a bar of colours on
their right, a headline above and a legend below them.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.layout_engine import LayoutEngine
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from nico_selfmodel.viz.figures.layout.room_of_axes import bounds_of, measuring

_PAD, _HEADLINE = 0.06, 0.32
"""Room around each panel with its labels, and for a line of headline [inch]."""
_BAR = 0.13
"""Width of a bar of colours [inch]."""


class SinglePassLayout(LayoutEngine):
    """Stands equal panels as close as their labels allow."""

    # As constrained layout does, in whose place it steps.
    _adjust_compatible = False
    _colorbar_gridspec = False

    def __init__(self) -> None:
        """Begin with a figure that is not laid out yet."""
        super().__init__()
        self.bounds: dict[Axes, Bbox] = {}
        """Of each panel and bar, with all that is written about it, once they are moved [pt]."""

    def execute(self, fig: Figure) -> None:
        """Move the panels of a figure."""
        renderer = measuring(fig)
        rooms = {axes: _labels(axes, renderer) for axes in fig.axes}
        self._move(fig, rooms)
        self.bounds = {axes: _reach(axes, room, renderer) for axes, room in rooms.items()}

    def _move(self, fig: Figure, rooms: Mapping[Axes, NDArray]) -> None:
        panels = [axes for axes in fig.axes if axes.get_subplotspec() is not None]
        bars = [axes for axes in fig.axes if axes.get_subplotspec() is None]
        if not panels:
            return
        spec = panels[0].get_subplotspec()
        assert spec is not None
        rows, columns = spec.get_gridspec().get_geometry()
        around = np.zeros((2, max(rows, columns), 2))  # of columns and of rows, low and high
        spans = [_span(axes) for axes in panels]
        for axes, (first, last) in zip(panels, spans, strict=True):
            room = rooms[axes]
            for axis in (0, 1):
                low, high = around[axis, first[axis], 0], around[axis, last[axis], 1]
                around[axis, first[axis], 0] = max(low, room[axis, 0] + _PAD)
                around[axis, last[axis], 1] = max(high, room[axis, 1] + _PAD)
        below = sum(one.get_window_extent().height / fig.dpi + _PAD for one in fig.legends)
        beside = sum(_BAR + 2.0 * _PAD + rooms[bar][0, 1] for bar in bars)
        width, height = fig.get_size_inches()
        written = [text for text in fig.texts if text.get_in_layout() and text.get_visible()]
        shown = fig.get_suptitle() if written else ""
        above = _HEADLINE * (1 + shown.count("\n")) if shown else _PAD
        x = _edges(around[0, :columns], 0.0, width - beside)
        y = _edges(around[1, :rows][:, ::-1], above, height - below)
        for axes, (first, last) in zip(panels, spans, strict=True):
            left, right = x[first[0], 0], x[last[0], 1]
            top, bottom = height - y[first[1], 0], height - y[last[1], 1]
            axes.set_position(_share(fig, left, bottom, right, top), which="both")
        for bar in bars:
            left = width - beside + _PAD
            top, bottom = height - y[0, 0], height - y[-1, 1]
            bar.set_position(_share(fig, left, bottom, left + _BAR, top), which="both")


def _span(axes: Axes) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return first and last column and row that a panel covers."""
    spec = axes.get_subplotspec()
    assert spec is not None
    rows, columns = spec.rowspan, spec.colspan
    return (columns.start, rows.start), (columns.stop - 1, rows.stop - 1)


def _labels(axes: Axes, renderer: RendererBase) -> NDArray:
    """Return the room that labels take left and right, above and below a panel [inch]. (2, 2)."""
    whole, inner = bounds_of(axes, renderer, for_layout=True), axes.get_window_extent()
    beside = (inner.x0 - whole.x0, whole.x1 - inner.x1)
    return np.maximum([beside, (inner.y0 - whole.y0, whole.y1 - inner.y1)], 0.0) / _dpi(axes)


def _reach(axes: Axes, room: NDArray, renderer: RendererBase) -> Bbox:
    """Return the bounds of a panel where it stands now, with all that is written about it [pt]."""
    inner, inch = axes.get_window_extent().get_points(), _dpi(axes)
    boxes = [Bbox(inner + inch * room.T * [[-1.0], [1.0]])]
    written = (axes.title, axes.xaxis.label, axes.yaxis.label)
    boxes += [text.get_window_extent(renderer) for text in written if text.get_text()]
    return Bbox(72.0 / inch * Bbox.union(boxes).get_points())


def _dpi(axes: Axes) -> float:
    figure = axes.get_figure(root=True)
    assert figure is not None
    return figure.dpi


def _edges(around: NDArray, first: float, last: float) -> NDArray:
    """Share what labels leave of a stretch among its panels; return where each begins and ends."""
    side = max((last - first - around.sum()) / len(around), 0.05)
    steps = np.cumsum(around.sum(axis=1) + side) - (around.sum(axis=1) + side)
    low = first + steps + around[:, 0]
    return np.stack([low, low + side], axis=1)


def _share(fig: Figure, left: float, bottom: float, right: float, top: float) -> tuple:
    """Return left, bottom, width and height as shares of the figure."""
    width, height = fig.get_size_inches()
    return left / width, bottom / height, (right - left) / width, (top - bottom) / height
