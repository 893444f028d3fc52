import numpy as np
import pytest

from nico_selfmodel.viz.figures.experiment_charts import BarSeries, bar_chart, save_figure

NAN = np.nan
GROUPS = ("0", "50", "500")


def chart(**changes):
    series = [
        BarSeries("9, thesis", [47.38, NAN, 14.86], [34.24, NAN, 8.87], published=True, color=0),
        BarSeries("9, ours", [5.4, 3.2, 2.7], [3.0, 1.0, NAN], color=0),
        BarSeries("104, ours", [2.4, 2.2, 1.9], [1.0, 1.0, 0.9], color=1),
    ]
    given = {"title": "Random samples help", "ylabel": "error [mm]"} | changes
    return bar_chart(GROUPS, series, **given)


def test_every_number_that_exists_has_a_bar_with_its_height_above():
    axes = chart().axes[0]
    heights = sorted(bar.get_height() for bar in axes.patches)
    assert heights == [1.9, 2.2, 2.4, 2.7, 3.2, 5.4, 14.86, 47.38]
    assert {text.get_text() for text in axes.texts} >= {"47.4", "14.9", "1.9"}


def test_published_bars_stand_beside_ours_in_the_same_colour():
    published, ours, other = chart().axes[0].containers[0:5:2]
    assert all(bar.get_hatch() for bar in published)
    assert not any(bar.get_hatch() for bar in ours)
    assert published[0].get_edgecolor() == ours[0].get_facecolor() != other[0].get_facecolor()
    assert published[0].get_x() < ours[0].get_x() < other[0].get_x()


def test_heights_that_differ_much_get_a_logarithmic_axis():
    assert chart().axes[0].get_yscale() == "log"
    assert chart(log=False).axes[0].get_yscale() == "linear"


def test_whiskers_are_one_standard_deviation():
    axes = chart(log=False).axes[0]
    (whiskers,) = axes.containers[1].lines[2]
    low, high = whiskers.get_segments()[0][:, 1]
    assert (low, high) == (pytest.approx(47.38 - 34.24), pytest.approx(47.38 + 34.24))


@pytest.mark.parametrize(
    ("means", "sds", "message"),
    [
        ([1.0, 2.0], [1.0], "one shape"),
        ([1.0, 0.0], [1.0, 1.0], "positive"),
        ([1.0, 2.0], [1.0, -1.0], "not negative"),
        ([1.0, np.inf], [1.0, 1.0], "positive"),
    ],
)
def test_numbers_that_are_no_bars_are_refused(means, sds, message):
    with pytest.raises(ValueError, match=message):
        BarSeries("x", means, sds)


def test_a_series_must_have_one_bar_a_group():
    short = BarSeries("x", [1.0], [0.1])
    empty = BarSeries("x", [NAN, NAN, NAN], [NAN, NAN, NAN])
    for series in ([short], [], [empty]):
        with pytest.raises(ValueError, match="every series must have 3 means"):
            bar_chart(GROUPS, series, title="t", ylabel="y")


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.SVG", b"<?xml")])
def test_a_chart_is_saved_by_its_ending(tmp_path, name, start):
    path = save_figure(chart(), tmp_path / name)
    assert path.read_bytes().startswith(start)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"\.png or \.svg"):
        save_figure(chart(), tmp_path / "a.pdf")
    assert list(tmp_path.iterdir()) == []


def test_a_logarithmic_axis_of_about_a_decade_has_numbers_to_read():
    series = [BarSeries("ours", np.array([2.0, 30.0]), np.array([0.5, 2.0]))]
    axes = bar_chart(["a", "b"], series, title="t", ylabel="mm").axes[0]
    low, high = axes.get_ylim()
    shown = [t.get_text() for t in axes.get_yticklabels() if low <= t.get_position()[1] <= high]
    assert shown == ["2", "5", "10", "20", "50"]
    assert not any(t.get_text() for t in axes.get_yticklabels(minor=True))
