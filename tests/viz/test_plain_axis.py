"""Ticks that are drawn at once stand where matplotlib would draw each."""

import io
import re

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.layout.widths_of_text import width_of
from nico_selfmodel.viz.figures.plot_style import image_bytes, log_ticks, style

from ..slow_rest import slow_rest

_TEXT = re.compile(r"<text[^>]*>([^<]*)</text>")
_PLACE = re.compile(r'(?:x="([-\d.]+)" y="([-\d.]+)")|(?:translate\(([-\d.]+) ([-\d.]+)\))')


def plain(axes, figure):
    axes.plot([-3.0, 5.0], [2.0, 1e3])
    axes.set_xlabel("something")


def logarithmic(axes, figure):
    axes.plot([1.0, 4000.0], [1.0, 3.0])
    axes.set_xscale("log")
    log_ticks(axes.xaxis)


def named(axes, figure):
    axes.set_xticks(range(3), ["one_long_name", "b", "Größe"], rotation=90, fontsize=7.5)
    axes.set_yticks([0.0, 0.5], ["none", "half of it"], fontsize=6.0)
    axes.tick_params(axis="x", length=0)


def of_several_lines(axes, figure):
    axes.set_xticks(range(2), ["kinematics\nonly", "all"])
    axes.set_yticks([0.0, 0.5], ["none\nat all", "half"])
    axes.xaxis.set_ticks_position("both")


def barred(axes, figure):
    figure.colorbar(ScalarMappable(), cax=axes)


def far_off(axes, figure):
    axes.plot([0.0, 1.0], [2.0e7, 2.0000001e7])


KINDS = [plain, logarithmic, named, barred, far_off]


def drawn(kind, draw):
    with style():
        figure = kind(figsize=(4.0, 3.0))
        figure.set_layout_engine("none")
        axes = figure.add_axes((0.3, 0.4, 0.3 if draw is barred else 0.6, 0.5))
        draw(axes, figure)
    return figure


def written(figure):
    """Return what is written in a figure, and where [pt]; matplotlib's own by its own canvas."""
    svg = (
        image_bytes(figure, "svg").decode()
        if isinstance(figure, PlainFigure)
        else plain_svg(figure)
    )
    found = []
    for text in _TEXT.finditer(svg):
        place = [float(number) for number in _PLACE.search(text[0]).groups() if number]
        found.append((text[1], place))
    return sorted(found)


def plain_svg(figure):
    file = io.StringIO()
    with style():
        FigureCanvasSVG(figure).print_svg(file)
    return file.getvalue()


@pytest.mark.parametrize("draw", slow_rest(KINDS, plain=2))
def test_labels_stand_where_matplotlib_writes_them(draw):
    ours, theirs = written(drawn(PlainFigure, draw)), written(drawn(Figure, draw))
    assert [text for text, _ in ours] == [text for text, _ in theirs]
    assert len(theirs) > 3
    for (text, place), (_, expected) in zip(ours, theirs, strict=True):
        assert place == pytest.approx(expected, abs=0.8), text


@pytest.mark.parametrize("draw", slow_rest(KINDS, plain=2))
def test_pictures_are_those_that_matplotlib_draws(draw):
    ours, theirs = (np.asarray(pixels(drawn(kind, draw)), float) for kind in (PlainFigure, Figure))
    assert np.ptp(theirs) > 200.0
    off = np.abs(ours - theirs).max(axis=2)
    ink = np.abs(theirs - 255.0).max(axis=2) > 30.0
    assert np.mean(off > 90.0) < 0.1 * ink.mean()


@pytest.mark.parametrize(("width", "written_out"), [(2.9, 7), (2.75, 4), (1.35, 2)])
def test_numbers_that_would_touch_are_written_at_every_second_tick(width, written_out):
    with style():
        figure = PlainFigure(figsize=(4.0, 3.0))
        axes = figure.add_axes((0.1, 0.4, width / 4.0, 0.5))
        axes.set_xticks(0.0025 * np.arange(7))
        axes.set_xlim(0.0, 0.015)
        axes.set_yticks([])
    numbers = [text for text, _ in written(figure)]
    assert len(numbers) == written_out
    assert numbers[0] == "0.0000"


def test_lines_of_a_label_stand_below_each_other_as_matplotlib_writes_them():
    ours, theirs = (dict(written(drawn(kind, of_several_lines))) for kind in (PlainFigure, Figure))
    assert set(ours) == set(theirs) >= {"kinematics", "only", "all", "none", "at all", "half"}
    for text, (_, height) in theirs.items():
        assert ours[text][1] == pytest.approx(height, abs=1.2), text


@pytest.mark.parametrize("weight", ["normal", "bold"])
def test_text_is_as_wide_as_matplotlib_measures_it_in_drawings(weight):
    words, font = (
        "Half within 0.20 px, 95 % of it",
        FontProperties(size=11.0, weight=weight),
    )
    theirs = RendererSVG(600.0, 300.0, io.StringIO()).get_text_width_height_descent(words, font, 0)
    for dpi in (72.0, 144.0):
        measures = PlainFigure(dpi=dpi).canvas.get_renderer()
        wide, tall, below = measures.get_text_width_height_descent(words, font, False)
        assert wide == pytest.approx(theirs[0] * dpi / 72.0, rel=0.01)
        assert 0.1 * tall < below < 0.3 * tall
        assert tall == pytest.approx(11.0 * dpi / 72.0, rel=0.1)
        assert measures.points_to_pixels(3.0) == pytest.approx(3.0 * dpi / 72.0)
    assert width_of(words, "bold") > 1.05 * width_of(words)


def test_letters_that_the_font_lacks_have_a_width():
    assert width_of("a\u4e2d") > width_of("a")


def pixels(figure):
    with style():
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    return canvas.buffer_rgba()
