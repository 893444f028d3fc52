"""What was seen, expected and surprising stands side by side, and fills its figure."""

import numpy as np
import pytest

from nico_selfmodel.viz.figures.mirror_test.surprise_plot import surprise_plot
from nico_selfmodel.viz.figures.plot_style import image_bytes

from ..slow_rest import slow_rest

_IMAGE = (480, 640)


def look(left, top, width, height):
    """Return what a camera saw and expected, and z^2 where a part of it is judged."""
    z = np.full(_IMAGE, np.nan)
    z[top : top + height, left : left + width] = 3.0
    seen = np.full((*_IMAGE, 3), 120, np.uint8)
    return seen, seen // 2, z


def drawn(first, second):
    figure = surprise_plot({"left": first, "right": second}, {"left": [], "right": []}, "A look")
    image_bytes(figure, "svg")
    panels = [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]
    assert len(panels) == 6
    return figure, panels


@pytest.mark.parametrize(("width", "height"), slow_rest([(90, 220), (200, 200), (200, 170)]))
def test_pictures_fill_their_figure_and_begin_and_end_together(width, height):
    figure, panels = drawn(look(100, 50, width, height), look(120, 60, width + 14, height - 6))
    boxes = [axes.get_window_extent() for axes in panels]
    share = boxes[0].height / figure.bbox.height
    above = 0.75 * figure.dpi / figure.bbox.height
    assert share > 0.95 - above  # but for the lines above them
    for box in boxes[1:]:
        assert [box.y0, box.y1] == pytest.approx([boxes[0].y0, boxes[0].y1], abs=0.5)
        assert box.width == pytest.approx(boxes[0].width, abs=0.5)


def test_all_that_is_judged_is_shown():
    cases = {"left": (100, 50, 90, 220), "right": (300, 200, 200, 40)}
    _, panels = drawn(*(look(*case) for case in cases.values()))
    for axes, (left, top, width, height) in zip(panels[::3], cases.values(), strict=True):
        (first, last), (bottom, upper) = axes.get_xlim(), axes.get_ylim()
        assert first < left < left + width < last
        assert upper < top < top + height < bottom


def test_where_nothing_is_judged_the_whole_picture_is_shown():
    _, panels = drawn(look(0, 0, 0, 0), look(0, 0, 0, 0))
    assert panels[0].get_xlim() == (-0.5, _IMAGE[1] - 0.5)
    assert panels[0].get_ylim() == (_IMAGE[0] - 0.5, -0.5)
