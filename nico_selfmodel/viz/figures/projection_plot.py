"""Figure of how uncertain it is where a camera projects, over its image."""

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
from nico_selfmodel.estimation.cameras.projection_uncertainty import ProjectionUncertainty
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.camera_plots import image_panels
from nico_selfmodel.viz.figures.numbers_shown import short
from nico_selfmodel.viz.figures.plot_style import headline, style

_SHADES = 40
_LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Of the lines of equal uncertainty [px]."""


def projection_map(assessment: CameraAssessment) -> Figure | None:
    """Draw the standard deviation of the pixel of a far point; None where nothing tells it."""
    maps = assessment.projection
    if not all(np.isfinite(found.middle) and found.middle > 0.0 for found in maps):
        return None
    with style():
        figure, panels = image_panels(assessment)
        low, high = (float(f([f(found.sigma) for found in maps])) for f in (np.nanmin, np.nanmax))
        # Beyond what is there, so that lines and words are readable on the darkest colour.
        scale = LogNorm(max(low, 1e-3 * high), 30.0 * high)
        for axes, found in zip(panels, maps, strict=True):
            sigma = np.ma.masked_invalid(found.sigma)
            shade = axes.contourf(
                found.u, found.v, sigma, np.geomspace(scale.vmin, 1.001 * high, _SHADES),
                norm=scale, cmap=palette.ERRORS, extend="min",
            )  # fmt: skip
            shade.set_gid(f"shade_{found.camera}")
            levels = [level for level in _LEVELS if np.nanmin(sigma) < level < np.nanmax(sigma)]
            if levels:
                look = {"colors": palette.INK, "linewidths": 0.7}
                lines = axes.contour(found.u, found.v, sigma, levels, **look)
                axes.clabel(lines, fmt=lambda level: f"{level:g} px", fontsize=7.5)
            axes.set_title(f"{found.camera}: one standard deviation", fontsize=9.0)
        told = maps if len(maps) <= 2 else [max(maps, key=lambda found: found.middle)]
        worst = "" if told == maps else "at worst "
        headline(figure, f"A far point is projected {worst}to ± {'; '.join(map(_words, told))}")
    return figure


def _words(found: ProjectionUncertainty) -> str:
    """Say how uncertain it is in the middle and far out."""
    far = f"{short(found.corner)} px in the worst corner"
    if not np.isfinite(found.corner):
        far = f"up to {short(float(np.nanmax(found.sigma)))} px at the rim of what it sees"
    return f"{short(found.middle)} px in the middle, {far} ({found.camera})"
