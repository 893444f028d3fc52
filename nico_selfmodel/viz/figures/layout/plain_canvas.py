"""What a figure is drawn on as SVG: text measured by the advance of its letters.

Matplotlib's own measures text by setting it letter by letter, and asked for what measures it, a
figure begins a picture anew each time.
"""

import io
from typing import Any

from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.font_manager import FontProperties

from nico_selfmodel.viz.figures.layout.widths_of_text import ascent_and_descent, width_of

_DOT = 72.0
"""Dots of a picture to the inch: points."""


class _ByAdvances:
    """What measures text."""

    dot = 1.0
    """Size of a point [dots]."""

    def get_text_width_height_descent(
        self, s: str, prop: FontProperties, ismath: Any
    ) -> tuple[float, float, float]:
        """Return width and height of a line of text, and how far it reaches below its line."""
        size = prop.get_size_in_points() * self.dot
        up, down = ascent_and_descent()
        return size * width_of(s, prop.get_weight()), size * (up + down), size * down


class _Measure(_ByAdvances, RendererBase):
    """Measures text and draws nothing."""

    def __init__(self, dpi: float) -> None:
        super().__init__()
        self.dot = dpi / 72.0

    def points_to_pixels(self, points: Any) -> Any:
        """Return a length in dots."""
        return points * self.dot


class _Picture(_ByAdvances, RendererSVG):
    """Writes SVG."""


class PlainCanvas(FigureCanvasSVG):
    """Draws a figure as SVG."""

    def get_renderer(self) -> RendererBase:
        """Return what measures text, at the present size of a dot."""
        return _Measure(self.figure.dpi)

    def svg(self) -> bytes:
        """Return the figure; `savefig` would walk through everything once more before it draws."""
        file, inches, dpi = io.StringIO(), self.figure.get_size_inches(), self.figure.dpi
        self.figure.dpi = _DOT
        untold = {"Date": None, "Creator": None, "Format": None, "Type": None}
        drawn = _Picture(*(_DOT * inches), file, image_dpi=dpi, metadata=untold)
        renderer = MixedModeRenderer(self.figure, *inches, dpi, drawn)
        self.figure.draw(renderer)
        renderer.finalize()
        return file.getvalue().encode()
