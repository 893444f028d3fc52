"""What a camera saw, what it expected, and what of it surprised."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.plot_style import headline, style

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
        A row a camera: seen, expected where it was judged, surprise.
    """
    with style():
        figure = Figure(figsize=(11.0, 2.9 * len(looks)))
        grid = figure.subplots(len(looks), 3, squeeze=False)
        drawn = None
        for row, (side, (seen, expected, z)) in zip(grid, looks.items(), strict=True):
            judged = np.isfinite(z)
            row[0].imshow(seen[:, :, ::-1])
            row[1].imshow(np.where(judged[:, :, None], expected[:, :, ::-1], 255))
            drawn = row[2].imshow(
                np.ma.masked_invalid(z), cmap=palette.ERRORS, vmin=0.0, vmax=_LARGEST
            )
            for u, v in places[side]:
                row[2].plot(u, v, "o", color=palette.OUTLIER, markersize=14, fillstyle="none")
            for axes, what in zip(
                row, ("seen", "expected, where judged", "surprise z²"), strict=True
            ):
                axes.set_title(f"{side}: {what}", fontsize=8.5)
                axes.set_xticks([])
                axes.set_yticks([])
        if drawn is not None:
            figure.colorbar(drawn, ax=list(grid[:, 2]), shrink=0.7)
        headline(figure, title)
    return figure
