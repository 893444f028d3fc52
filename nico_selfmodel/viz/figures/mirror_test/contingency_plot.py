"""Log odds of self over time, encounter by encounter."""

from collections.abc import Mapping, Sequence
from textwrap import wrap

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import headline, style


def contingency_plot(
    traces: Mapping[str, Sequence[NDArray]], own: str, period: float, threshold: float, title: str
) -> Figure:
    """Draw how soon self was told from each of the others.

    Args:
        traces: Encounter -> log odds of self after each picture, of each trial. Shape (T,) each.
        own: The encounter that is oneself.
        period: Time between two pictures [s].
        threshold: Log odds at which the test stops, on both sides.

    Returns:
        One panel an encounter, on common axes.
    """
    with style():
        figure = PlainFigure(figsize=(11.0, 3.2))
        panels = figure.subplots(1, len(traces), sharex=True, sharey=True)
        for axes, (name, trials) in zip(np.ravel(panels), traces.items(), strict=True):
            color = palette.HELD_OUT if name == own else palette.CROSS_VALIDATION
            for odds in trials:
                past = np.flatnonzero(np.abs(odds) >= threshold)
                shown = odds[: past[0] + 1] if len(past) else odds
                shown = np.clip(shown, -1.15 * threshold, 1.15 * threshold)
                times = period * np.arange(1, len(shown) + 1)
                axes.plot(times, shown, color=color, linewidth=0.9, alpha=0.8)
                axes.plot(times[-1:], shown[-1:], "o", color=color, markersize=3.0)
            for level in (-threshold, threshold):
                axes.axhline(level, color=palette.INK, linewidth=0.8, linestyle="--")
            axes.axhline(0.0, color=palette.FAINT, linewidth=0.8)
            axes.set_title("\n".join(wrap(name, 14)), fontsize=8.5)
            axes.set_xlabel("time [s]")
        first = np.ravel(panels)[0]
        first.set_ylabel("log odds of self")
        headline(figure, title)
    return figure
