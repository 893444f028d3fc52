"""How far what is written about a panel reaches, and where the labels of its axes stand.

Matplotlib's `get_tightbbox` works out the ticks of an axis a dozen times for that, which takes
longer than drawing. Here each axis does so once, and its label is fixed where Matplotlib would put
it: `labelpad` beyond ticks and tick labels (`plain_axis`).
"""

from collections.abc import Iterator
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.spines import Spine
from matplotlib.text import Text
from matplotlib.transforms import Bbox, ScaledTranslation


def measuring(figure: Figure) -> RendererBase:
    """Return what measures the text of a figure, at its present size of a dot."""
    canvas: Any = figure.canvas
    return canvas.get_renderer()


def bounds_in_points(figure: Figure) -> dict[Axes, Bbox]:
    """Return the bounds of each panel of a figure, as it stands, with all about it [pt]."""
    renderer, scale = measuring(figure), 72.0 / figure.dpi
    return {axes: Bbox(scale * bounds_of(axes, renderer).get_points()) for axes in figure.axes}


def bounds_of(axes: Axes, renderer: RendererBase, *, for_layout: bool = False) -> Bbox:
    """Return the bounds of a panel with all that is written about it [dots].

    Labels of its axes are fixed beside where the panel is now.

    Args:
        for_layout: Leave out lengths of labels and titles, which no more room would mend.
    """
    if axes.name != "rectilinear" or not axes.axison:
        found = axes.get_tightbbox(renderer, for_layout_only=for_layout)
        return axes.get_window_extent() if found is None else found
    place = axes.get_axes_locator()
    axes.apply_aspect(None if place is None else place(axes, renderer))
    inner = axes.get_window_extent()
    boxes = [inner]
    for k, axis in enumerate((axes.xaxis, axes.yaxis)):
        if axis.get_visible():
            boxes += _beside(axis, k, inner, renderer, for_layout=for_layout)
    for artist in axes.get_default_bbox_extra_artists():
        if isinstance(artist, Axes):
            boxes.append(bounds_of(artist, renderer))
        elif not isinstance(artist, Spine):  # whose ticks were counted with the axis
            boxes += _some(artist.get_tightbbox(renderer))
    for text in axes.get_children():
        if isinstance(text, Text) and text not in axes.texts and text.get_text():
            box = text.get_window_extent(renderer)
            boxes.append(_without_length(box, 0) if for_layout else box)
    return Bbox.union(boxes)


def _beside(
    axis: Any, across: int, inner: Bbox, renderer: RendererBase, *, for_layout: bool
) -> Iterator[Bbox]:
    """Yield bounds of ticks and labels of an axis, and fix its label.

    Args:
        axis: That of `PlainAxes`.
        across: 0 for x, 1 for y.
        inner: The panel without them.
        for_layout: Leave out the length of the label.
    """
    low = axis.get_label_position() in ("bottom", "left")
    out = 1 - across  # the direction in which labels stand off the panel
    figure = axis.get_figure(root=True)
    point = figure.dpi / 72.0
    ticks = axis.bounds_of_ticks(renderer)
    yield from ticks
    ends = Bbox.union(ticks).get_points()
    side = 0 if low else 1
    off = abs(ends[side, out] - inner.get_points()[side, out]) + point * axis.labelpad
    _fix_label(axis, out, side, (-off if low else off) / figure.dpi)
    label = axis.label
    if label.get_visible() and label.get_text():
        box = label.get_window_extent(renderer)
        yield _without_length(box, across) if for_layout else box


def _fix_label(axis: Axis, out: int, side: int, off: float) -> None:
    """Stand the label of an axis off its panel, wherever that moves to.

    Args:
        out: Direction in which it stands off, 0 for x, 1 for y.
        side: 0 below or left of the panel, 1 above or right of it.
        off: How far [inch].
    """
    figure = axis.get_figure(root=True)
    assert figure is not None
    assert axis.axes is not None
    away = ScaledTranslation(*((0.0, off) if out else (off, 0.0)), figure.dpi_scale_trans)
    place = list(axis.label.get_position())
    place[out] = float(side)
    axis.set_label_coords(*place, transform=axis.axes.transAxes + away)


def _without_length(box: Bbox, along: int) -> Bbox:
    points = box.get_points().copy()
    middle = points[:, along].mean()
    points[:, along] = middle - 0.5, middle + 0.5
    return Bbox(points)


def _some(box: Bbox | None) -> list[Bbox]:
    """Return a box where there is one."""
    return [box] if box is not None and box.width + box.height > 0.0 else []
