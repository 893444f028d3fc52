"""What a camera saw, what it expected, and what of it surprised."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import headline, style

_WIDTH = 11.0
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
        title: What the figure shows.

    Returns:
        For each camera: seen, expected where it was judged, surprise; all cut to what was judged.
    """
    kinds = ("seen", "expected", "surprise z²")
    parts = {side: _judged_part(np.isfinite(z)) for side, (_, _, z) in looks.items()}
    tallest = max(
        (rows[0] - rows[1]) / (columns[1] - columns[0]) for columns, rows in parts.values()
    )
    across = _WIDTH / (len(kinds) * len(looks))
    with style():
        figure = PlainFigure(figsize=(_WIDTH, float(np.clip(across * tallest, 1.6, 6.0)) + 1.1))
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
                axes.set(xticks=[], yticks=[], xlim=parts[side][0], ylim=parts[side][1])
        if drawn is not None:
            figure.colorbar(drawn, ax=list(grid), shrink=0.7)
        headline(figure, title)
    return figure


def _judged_part(judged: NDArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the columns, and the rows from the bottom, about all that is judged."""
    if not judged.any():
        height, width = judged.shape
        return (-0.5, width - 0.5), (height - 0.5, -0.5)
    rows, columns = np.nonzero(judged)
    edge = _EDGE * max(np.ptp(rows), np.ptp(columns))
    return (
        (float(columns.min() - edge), float(columns.max() + edge)),
        (float(rows.max() + edge), float(rows.min() - edge)),
    )
