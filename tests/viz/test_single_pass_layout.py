"""Panels stand apart from each other, with all that is written about them within the figure."""

import pytest
from matplotlib.cm import ScalarMappable

from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import headline, image_bytes, style

from ..slow_rest import slow_rest


def drawn(rows, columns, *, bar=False, legend=False):
    with style():
        figure = PlainFigure(figsize=(9.0, 4.5))
        panels = figure.subplots(rows, columns, squeeze=False)
        for i, axes in enumerate(panels.ravel()):
            axes.plot([0.0, 1.0], [0.0, 10.0 ** (i + 1)], label=f"course {i}")
            axes.set_ylabel("two lines\nof words")
            axes.set_xlabel("something [mm]")
            axes.set_title(f"panel {i}")
        if bar:
            figure.colorbar(ScalarMappable(), ax=list(panels.ravel()))
        if legend:
            figure.legend(loc="outside lower left")
        headline(figure, "What this says")
    image_bytes(figure, "svg")
    return figure


@pytest.mark.parametrize(("rows", "columns"), slow_rest([(1, 3), (1, 1), (2, 2)]))
@pytest.mark.parametrize("beside", [{}, {"bar": True}, {"legend": True}])
def test_nothing_is_cut_off_and_nothing_overlaps(rows, columns, beside):
    figure = drawn(rows, columns, **beside)
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    boxes += [legend.get_window_extent() for legend in figure.legends]
    boxes.append(figure.texts[0].get_window_extent())
    for i, box in enumerate(boxes):
        assert box.x0 >= -1.0
        assert box.y0 >= -1.0
        assert box.x1 <= figure.bbox.x1 + 1.0
        assert box.y1 <= figure.bbox.y1 + 1.0
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])


def test_panels_of_a_grid_are_equal():
    sizes = {tuple(axes.get_position().size.round(9)) for axes in drawn(2, 2).axes}
    assert len(sizes) == 1
