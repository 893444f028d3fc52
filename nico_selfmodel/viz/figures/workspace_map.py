"""How surely a hand is known over its workspace."""

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nico_selfmodel.estimation.body.workspace_accuracy import WorkspaceAccuracy
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import FULL_WIDTH, headline, style


def workspace_map(accuracy: WorkspaceAccuracy) -> Figure:
    """Draw how surely the hand is known, from above, split into what cures it and what stays.

    Args:
        accuracy: Figures at poses, in the left camera's frame.

    Returns:
        Three panels with one scale: the reducible error, the irreducible one, and both.
    """
    parts = (
        ("reducible by more data", accuracy.learned),
        ("irreducible: joint noise", accuracy.mechanics),
        ("both", accuracy.total),
    )
    scale = Normalize(0.0, 1e3 * float(accuracy.total.max()))
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, 4.0))
        panels = figure.subplots(1, 3)
        for axes, (title, part) in zip(panels, parts, strict=True):
            order = np.argsort(part)
            axes.scatter(
                1e3 * accuracy.p_LH[order, 0],
                1e3 * accuracy.p_LH[order, 2],
                c=1e3 * part[order],
                cmap=palette.ERRORS,
                norm=scale,
                s=18.0,
                edgecolors="none",
            )
            axes.set_title(f"{title}: mean {1e3 * part.mean():.2f} mm", loc="left")
            axes.set_xlabel("to the right [mm]")
            axes.set_aspect("equal", adjustable="datalim")
        panels[0].set_ylabel("ahead of the left camera [mm]")
        bar = figure.colorbar(ScalarMappable(scale, palette.ERRORS), ax=panels, pad=0.01, aspect=28)
        bar.set_label("rms error of the hand [mm]")
        bar.outline.set_visible(False)
        share = 100.0 * accuracy.curable
        headline(figure, f"More data would cure {share:.0f} % of the hand's mean squared error")
    return figure
