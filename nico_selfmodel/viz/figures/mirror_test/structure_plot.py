"""A learned surface beside the true one: errors, sigmas, a cut."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import FULL_WIDTH, headline, style

_LARGEST = 5.0
"""What is drawn darkest [mm]."""
_SLICE = 4e-3
"""Half of the thickness of a cut [m]."""


@dataclass(frozen=True, eq=False)
class ShownLink:
    """One link's learned surface and what it is off by."""

    mesh: TriangleMesh
    """In the frame of a camera that looks along z, x to the right and y down."""
    p_LT: NDArray
    """Where the true surface is next to each vertex [m]. Shape (V, 3)."""
    sigma: NDArray
    """Of each vertex [m]. Shape (V,)."""


def structure_plot(links: Sequence[ShownLink], title: str, *, mirrored: bool = True) -> Figure:
    """Draw learned surfaces from the front, and cut from top to bottom through their middle.

    Args:
        mirrored: Whether the front is what a mirror before the camera shows, or what the camera
            sees itself.

    Returns:
        Panels of errors and sigmas, and one of the cut with the true surface.
    """
    errors = [np.linalg.norm(one.mesh.vertices - one.p_LT, axis=1) for one in links]
    with style():
        figure = PlainFigure(figsize=(FULL_WIDTH, _height(links)))
        first, second, cut = figure.subplots(1, 3, sharey=True)
        drawn = None
        for axes, values, name in (
            (first, errors, "error"),
            (second, [one.sigma for one in links], "sigma"),
        ):
            for one, value in zip(links, values, strict=True):
                drawn = _front(axes, one.mesh, 1e3 * value, 1.0 if mirrored else -1.0)
            axes.set_title(name)
            axes.set_xlabel("x [mm]")
            axes.set_aspect("equal")
            axes.autoscale_view()
        first.set_ylabel("up [mm]")
        if drawn is not None:
            bar = figure.colorbar(drawn, ax=[first, second, cut], shrink=0.7)
            bar.set_label(f"mm, {_LARGEST:g} and more are darkest")
        _cut(cut, links)
        cut.set_xlabel("z, to the mirror [mm]" if mirrored else "z, away from the cameras [mm]")
        headline(figure, title)
    return figure


def _height(links: Sequence[ShownLink]) -> float:
    """Return how high a figure is, so that three panels without much room about them fit in."""
    span = np.ptp(np.concatenate([one.mesh.vertices for one in links]), axis=0)
    return float(np.clip(1.6 + FULL_WIDTH / 3.6 * span[1] / max(span[0], 1e-3), 3.6, 5.6))


def _front(axes: Axes, mesh: TriangleMesh, values: NDArray, front: float) -> PolyCollection:
    """Draw the triangles that are turned to z (1) or against it (-1), the nearest last."""
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned = front * normals[:, 2] > 0.0
    order = np.flatnonzero(turned)[np.argsort(front * corners[turned].mean(axis=1)[:, 2])]
    flat = 1e3 * corners[order][:, :, :2] * [1.0, -1.0]
    level = values[mesh.triangles[order]].mean(axis=1)
    drawn = PolyCollection(
        list(flat), array=level, cmap=palette.ERRORS, edgecolors="face", linewidths=0.2
    )
    drawn.set_clim(0.0, _LARGEST)
    drawn.set_rasterized(True)
    axes.add_collection(drawn)
    return drawn


def _cut(axes: Axes, links: Sequence[ShownLink]) -> None:
    """Draw learned and true surfaces where a plane from top to bottom cuts them."""
    for k, one in enumerate(links):
        p = one.mesh.vertices
        near = np.abs(p[:, 0] - np.median(p[:, 0])) < _SLICE
        for points, color, size, name in (
            (one.p_LT, palette.MUTED, 9.0, "true"),
            (p, palette.HELD_OUT, 3.0, "learned"),
        ):
            axes.scatter(
                1e3 * points[near, 2], -1e3 * points[near, 1], s=size, color=color,
                linewidths=0.0, label=name if k == 0 else None,
            )  # fmt: skip
    axes.set_title("cut through the middle")
    axes.set_aspect("equal")
    axes.legend(loc="lower right")
