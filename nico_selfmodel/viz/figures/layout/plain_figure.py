"""The figures that the project draws."""

from typing import Any

from matplotlib.figure import Figure

from nico_selfmodel.viz.figures.layout.plain_axis import PlainAxes
from nico_selfmodel.viz.figures.layout.plain_canvas import PlainCanvas
from nico_selfmodel.viz.figures.layout.single_pass_layout import SinglePassLayout


class PlainFigure(Figure):
    """A figure of `PlainAxes`, laid out in one pass."""

    def __init__(self, *args: Any, **options: Any) -> None:
        """Begin a figure, with the options of matplotlib's."""
        super().__init__(*args, layout=SinglePassLayout(), **options)
        PlainCanvas(self)  # which becomes the figure's

    def add_subplot(self, *args: Any, **options: Any) -> Any:
        """Add a panel to a grid."""
        options.setdefault("axes_class", PlainAxes)
        return super().add_subplot(*args, **options)

    def add_axes(self, *args: Any, **options: Any) -> Any:
        """Add a panel anywhere."""
        options.setdefault("axes_class", PlainAxes)
        return super().add_axes(*args, **options)
