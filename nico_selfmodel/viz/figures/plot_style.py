"""One look for all figures, and figures as text that a page can hold."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_canvas import PlainCanvas

FULL_WIDTH, HALF_WIDTH = 11.0, 4.9
"""Widths of figures on the page, where a point of type is then about a point [inch]."""
MANY = 250
"""More points than this are drawn as pixels even in an SVG."""

FONT = "DejaVu Sans"
"""Comes with matplotlib."""

_STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": palette.MUTED,
    "axes.grid": True,
    "axes.labelcolor": palette.INK,
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": palette.INK,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # else it is looked for above all ticks, of which there are none up there
    "axes.unicode_minus": True,
    "figure.facecolor": "white",
    "font.family": FONT,
    "font.size": 9.0,
    "grid.color": palette.FAINT,
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "path.simplify": False,  # which takes points that stand apart for ends of one line
    "svg.fonttype": "none",
    "svg.hashsalt": "nico-selfmodel",
    "text.color": palette.INK,
    "text.parse_math": False,
    "xtick.color": palette.MUTED,
    "xtick.labelcolor": palette.INK,
    "xtick.labelsize": 8.5,
    "ytick.color": palette.MUTED,
    "ytick.labelcolor": palette.INK,
    "ytick.labelsize": 8.5,
}


@contextmanager
def style() -> Iterator[None]:
    """Draw and save figures in the project's look; matplotlib's own settings come back after."""
    with rc_context({**_STYLE}):
        yield


def image_bytes(figure: Figure, file_format: str) -> bytes:
    """Return a figure as a file.

    Args:
        file_format: `svg` or `png`.
    """
    with style():
        if file_format == "svg":
            return PlainCanvas(figure).svg()
        buffer = io.BytesIO()
        figure.savefig(buffer, format=file_format, dpi=160, metadata={"Software": None})
    return buffer.getvalue()


def headline(figure: Figure, text: str) -> None:
    """Write what a figure shows above it."""
    figure.suptitle(text, x=0.008, ha="left", fontsize=11.0, fontweight="bold", color=palette.INK)


def _plain_tick(value: float, _position: int) -> str:
    """Write a tick: names of joints may hold a $, so that no text is read as mathematics."""
    return f"{value:g}"


def log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis plainly, however little it spans; after everything is drawn."""
    low, high = sorted(axis.get_view_interval())
    if high < 4.0 * low:
        axis.set_major_locator(MaxNLocator(4))
    elif high < 1000.0 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(_plain_tick)
    axis.set_minor_formatter(NullFormatter())  # by default mathematics, which is not read


def dots(axes: Axes, x: NDArray, y: NDArray, *, color: str, size: float) -> None:
    """Draw many points as one path of round ends, which takes a tenth of markers' room.

    Args:
        axes: Where.
        x: Of the points, and y of them likewise.
        y: Where they stand.
        size: Their diameter [pt].
    """
    if len(x) > MANY:
        look = {"markersize": size, "markeredgewidth": 0.0, "alpha": 0.65}
        axes.plot(x, y, "o", color=color, rasterized=True, **look)
        return
    gaps = np.full(len(x), np.nan)
    short = 1e-4 * (np.ptp(x) or 1.0)  # what has no length is not drawn everywhere
    line = [np.stack([a, b, gaps], axis=1).ravel() for a, b in ((x - short, x + short), (y, y))]
    axes.plot(*line, color=color, linewidth=size, alpha=0.65, solid_capstyle="round", snap=False)


def grid_along(axes: Axes, axis: str) -> None:
    """Keep the grid lines of one axis only, `x` or `y`."""
    axes.grid(False, axis="y" if axis == "x" else "x")
