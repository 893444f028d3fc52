"""What a robot takes for its body in a picture, and what for its room."""

from collections.abc import Mapping

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import FULL_WIDTH, headline, style

_ABOVE = 0.75
"""Room for what is written above pictures [inch]."""


def body_or_room_plot(
    looks: Mapping[str, tuple[NDArray, NDArray, NDArray]],
    cell: int,
    words: tuple[str, str],
    title: str,
) -> Figure:
    """Draw pictures side by side, the cells that were told outlined.

    Args:
        looks: What was done -> picture, BGR of shape (h, w, 3), and the cells that are told to turn
            along and not to, boolean, shape (rows, columns).
        cell: Side of a cell [px].
        words: What the two kinds of cells are called.
    """
    height, width = next(iter(looks.values()))[0].shape[:2]
    across = FULL_WIDTH / len(looks)
    colors = (palette.UNCERTAINTY, palette.CROSS_VALIDATION)
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, across * height / width + _ABOVE))
        grid = figure.subplots(1, len(looks), squeeze=False)[0]
        for axes, (name, (picture, *told)) in zip(grid, looks.items(), strict=True):
            axes.imshow(picture[:, :, ::-1])
            for cells, color, word in zip(told, colors, words, strict=True):
                boxes = [
                    Rectangle((cell * column - 0.5, cell * row - 0.5), cell, cell)
                    for row, column in np.argwhere(cells)
                ]
                axes.add_collection(PatchCollection(boxes, facecolor="none", edgecolor=color))
                axes.plot([], [], "s", color=color, fillstyle="none", label=word)
            axes.set_title(name, fontsize=9)
            axes.spines[:].set_visible(False)
            axes.set(xticks=[], yticks=[])
        grid[0].legend(
            loc="lower left", fontsize=8, frameon=True, facecolor="white", framealpha=0.9
        )
        headline(figure, title)
    return figure
