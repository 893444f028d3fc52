"""Charts of an experiment beside the published ones: bars in groups, with standard deviations."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.files.whole import write_bytes_whole
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import (
    grid_along,
    headline,
    image_bytes,
    log_ticks,
    style,
)

FORMATS = (".png", ".svg")
_LOG_FROM = 12.0
"""Ratio of the largest to the smallest mean from which the axis is logarithmic by default."""


@dataclass(frozen=True, eq=False)
class BarSeries:
    """One bar in every group; bars of one colour belong together."""

    label: str
    """For the legend."""
    means: NDArray
    """Heights; nan where there is none. One a group."""
    sds: NDArray
    """Standard deviations; nan where there is none. One a group."""
    published: bool = False
    """Whether they are somebody else's numbers: drawn hatched on white."""
    color: int = 0
    """Number of the colour; a published series shares that of ours beside it."""

    def __post_init__(self) -> None:
        """Check that means and deviations agree, and make the arrays read-only."""
        means, sds = (np.array(x, dtype=float) for x in (self.means, self.sds))
        if means.ndim != 1 or means.shape != sds.shape:
            raise ValueError(
                f"means and sds must have one shape (n,), got {means.shape}, {sds.shape}"
            )
        if np.any(means <= 0.0) or np.any(sds < 0.0) or np.isinf([means, sds]).any():
            raise ValueError("means must be positive and sds not negative; nan where there is none")
        for name, value in (("means", means), ("sds", sds)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class Level:
    """A height that holds for all groups."""

    name: str
    """For the legend."""
    height: float
    """Where the line is drawn."""
    dashes: str = "--"
    """How the line is drawn, as matplotlib has it: more than one need different ones."""


def bar_chart(
    groups: Sequence[str],
    series: Sequence[BarSeries],
    *,
    title: str,
    ylabel: str,
    xlabel: str = "",
    log: bool | None = None,
    levels: Sequence[Level] = (),
) -> Figure:
    """Draw bars in groups, with their standard deviations and their heights in figures.

    Args:
        groups: Labels of the groups, left to right.
        series: Bars, in the order in which they stand in each group.
        ylabel: What the heights are, with their unit.
        xlabel: What the groups are.
        log: Whether the axis is logarithmic; by default where the heights differ much.
        levels: Heights to hold every group against, as dashed lines.

    Returns:
        The chart.

    Raises:
        ValueError: If there is nothing to draw, or a series has not one bar a group.
    """
    heights = np.array([s.means for s in series if len(s.means) == len(groups)])
    if not series or len(heights) != len(series) or not np.isfinite(heights).any():
        raise ValueError(f"every series must have {len(groups)} means, and one of them a number")
    if log is None:
        log = bool(np.nanmax(heights) > _LOG_FROM * np.nanmin(heights))
    with style():
        bars = len(groups) * len(series)
        figure = PlainFigure(figsize=(float(np.clip(1.6 + 0.62 * bars, 5.4, 11.0)), 4.2))
        axes = figure.add_subplot()
        if log:
            axes.set_yscale("log")
        width = 0.84 / len(series)
        places = _places(heights, width)
        for place, one in zip(places, series, strict=True):
            _bars(axes, place, one, width, log)
        for level in levels:
            label = f"{level.name}: {level.height:.3g}"
            axes.axhline(level.height, label=label, color=palette.INK, ls=level.dashes, lw=1.2)
        axes.set_xticks(np.arange(len(groups)), groups)
        axes.tick_params(axis="x", length=0)
        axes.set_xlabel(xlabel)
        axes.set_ylabel(ylabel)
        tops = heights + np.array([np.nan_to_num(s.sds) for s in series])
        if log:
            lows = heights - np.minimum(tops - heights, 0.9 * heights)
            lowest = max(0.8 * np.nanmin(lows), 0.3 * np.nanmin(heights))
            axes.set_ylim(lowest, 1.6 * np.nanmax(tops))
            log_ticks(axes.yaxis)
        else:
            axes.set_ylim(0.0, 1.12 * np.nanmax(tops))
        grid_along(axes, "y")
        figure.legend(loc="outside lower left", ncols=min(len(series), 4), handlelength=1.4)
        headline(figure, title)
    return figure


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG or SVG, whole or not at all.

    Args:
        path: The file, ending in one of `FORMATS`; its folder must exist.

    Returns:
        The file.

    Raises:
        ValueError: If the ending is another.
        OSError: If it cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"a figure is saved as {' or '.join(FORMATS)}, got {path.name!r}")
    content = image_bytes(figure, path.suffix.lower().removeprefix("."))
    write_bytes_whole(path, content)
    return path


def _places(heights: NDArray, width: float) -> NDArray:
    """Return where bars stand: side by side, those of a group about its middle.

    Args:
        heights: Of each series in each group; nan where there is no bar. Shape (series, groups).
        width: Of a bar.

    Returns:
        Shape (series, groups).
    """
    there = np.isfinite(heights)
    rank = np.cumsum(there, axis=0) - 1
    return np.arange(heights.shape[1]) + (rank - 0.5 * (there.sum(axis=0) - 1)) * width


def _bars(axes: Axes, place: NDArray, series: BarSeries, width: float, log: bool) -> None:
    color = palette.joint_color(series.color)
    look = {"color": color, "edgecolor": color}
    if series.published:
        look = {"color": "white", "edgecolor": color, "hatch": "////"}
    there = np.isfinite(series.means)
    means, sds = series.means[there], np.nan_to_num(series.sds[there])
    axes.bar(place[there], means, 0.9 * width, label=series.label, linewidth=1.0, **look)
    # On a logarithmic axis a bar may not reach down to zero.
    below = np.minimum(sds, 0.9 * means) if log else np.minimum(sds, means)
    shown = sds > 0.0
    axes.errorbar(
        place[there][shown],
        means[shown],
        np.stack([below, sds])[:, shown],
        fmt="none",
        ecolor=palette.INK,
        elinewidth=1.1,
        capsize=2.5,
    )
    for x, mean, top in zip(
        place[there].tolist(), means.tolist(), (means + sds).tolist(), strict=True
    ):
        axes.annotate(
            f"{mean:.3g}",
            (x, top),
            xytext=(0.0, 2.5),
            textcoords="offset points",
            ha="center",
            fontsize=7.5,
        )
