"""What a camera saw, what it expected, and what of it surprised."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import FULL_WIDTH, headline, style

_BAR, _BETWEEN, _ABOVE = 0.6, 0.2, 0.75
"""Room for the bar of colours, between pictures, and for what is written above them [inch]."""
_LOWEST, _HIGHEST = 1.2, 6.0
"""That pictures are drawn [inch]."""
_EDGE = 0.08
"""What is shown about the part that is judged, as a share of it."""
_LARGEST = 40.0
"""z^2 that is drawn darkest; about the threshold of a surprising place."""


def surprise_plot(
    looks: Mapping[str, tuple[NDArray, NDArray, NDArray]],
    places: Mapping[str, Sequence[tuple[float, float]]],
    title: str,
) -> Figure:
    """Draw both cameras' looks side by side.

    Args:
        looks: Camera -> what it saw and what it expected, BGR of shape (h, w, 3), and z^2, nan
            where nothing was judged, shape (h, w).
        places: Camera -> surprising places (u, v) [px].

    Returns:
        For each camera: seen, expected where it was judged, surprise; all cut to what was judged.
    """
    kinds = ("seen", "expected", "surprise z²")
    parts = _parts({side: np.isfinite(z) for side, (_, _, z) in looks.items()})
    across = (FULL_WIDTH - _BAR) / (len(kinds) * len(looks)) - _BETWEEN
    tallest = max(float(np.ptp(rows) / np.ptp(columns)) for columns, rows in parts.values())
    height = float(np.clip(across * tallest, _LOWEST, _HIGHEST)) + _ABOVE
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, height))
        grid = figure.subplots(1, len(kinds) * len(looks), squeeze=False)[0]
        drawn = None
        for k, (side, (seen, expected, z)) in enumerate(looks.items()):
            row = grid[len(kinds) * k : len(kinds) * (k + 1)]
            judged = np.isfinite(z)
            row[0].imshow(seen[:, :, ::-1])
            row[1].imshow(np.where(judged[:, :, None], expected[:, :, ::-1], 255))
            drawn = row[2].imshow(
                np.ma.masked_invalid(z), cmap=palette.ERRORS, vmin=0.0, vmax=_LARGEST
            )
            for axes, what in zip(row, kinds, strict=True):
                for u, v in places[side] if what != kinds[1] else ():
                    axes.plot(u, v, "o", color=palette.OUTLIER, markersize=16, fillstyle="none")
                axes.set_title(f"{side}: {what}", fontsize=8.5)
                axes.spines[:].set_visible(False)
                axes.set(xticks=[], yticks=[], xlim=parts[side][0], ylim=parts[side][1])
        if drawn is not None:
            figure.colorbar(drawn, ax=list(grid), shrink=0.7)
        headline(figure, title)
    return figure


def _parts(
    judged: Mapping[str, NDArray],
) -> dict[str, tuple[tuple[float, float], tuple[float, float]]]:
    """Return the columns, and the rows from the bottom, about all that each camera judges.

    All are of one size, so that pictures of a row begin and end together.
    """
    middles, sizes = [], []
    for one in judged.values():
        rows, columns = np.nonzero(one if one.any() else np.ones_like(one))
        ends = np.array([[columns.min(), columns.max()], [rows.min(), rows.max()]])
        middles.append(ends.mean(axis=1))
        sizes.append(np.ptp(ends, axis=1) + 1.0 + 2.0 * _EDGE * np.ptp(ends) * one.any())
    half = 0.5 * np.max(sizes, axis=0)
    found = {}
    for (side, one), middle in zip(judged.items(), middles, strict=True):
        size = np.array(one.shape[::-1])
        within = np.clip(middle, half - 0.5, np.maximum(half, size - half) - 0.5)
        (left, top), (right, bottom) = (within - half).tolist(), (within + half).tolist()
        found[side] = ((left, right), (bottom, top))
    return found
