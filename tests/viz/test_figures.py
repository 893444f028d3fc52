import re

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.optimization.uncertainty import Uncertainty
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.error_plots import (
    error_distribution,
    error_over_workspace,
    residuals_over_angles,
)
from nico_selfmodel.viz.figures.numbers_shown import decimals, nice_below, nice_factor, short
from nico_selfmodel.viz.figures.parameter_plots import (
    convergence,
    correlations,
    parameter_sigmas,
    unobservable_parameters,
)
from nico_selfmodel.viz.figures.plot_style import image_bytes, log_ticks, style
from nico_selfmodel.viz.reports.inline_figure import InlineFigure

from ..slow_rest import slow_rest


def correlations_drawn(calibration):
    return correlations(calibration.uncertainty)


ALL = (
    error_distribution,
    error_over_workspace,
    residuals_over_angles,
    parameter_sigmas,
    correlations_drawn,
    convergence,
)


def unobservable(calibration):
    return unobservable_parameters(calibration.uncertainty)


def title(figure):
    return figure.get_suptitle()


@pytest.mark.slow
@pytest.mark.parametrize("draw", ALL, ids=lambda f: f.__name__)
def test_every_figure_states_its_point_and_is_an_svg(calibration, draw):
    figure = draw(calibration)
    assert len(title(figure)) > 20
    assert image_bytes(figure, "svg").startswith(b"<?xml")


@pytest.mark.slow
@pytest.mark.parametrize("draw", ALL, ids=lambda f: f.__name__)
def test_no_figure_stumbles_over_names_or_open_directions(renamed, failed, draw):
    for calibration in (renamed, failed):
        assert InlineFigure.of(draw(calibration)).panels


def test_a_figure_can_be_a_png_too(calibration):
    assert image_bytes(error_distribution(calibration), "png").startswith(b"\x89PNG")


def test_figures_leave_matplotlib_as_it_was(calibration):
    before = dict(matplotlib.rcParams)
    image_bytes(error_distribution(calibration), "svg")
    assert dict(matplotlib.rcParams) == before


def test_the_same_figure_gives_the_same_bytes(calibration):
    first, second = (InlineFigure.of(error_distribution(calibration)) for _ in range(2))
    assert first == second


@pytest.mark.slow
@pytest.mark.parametrize("draw", ALL, ids=lambda f: f.__name__)
def test_no_panel_of_a_figure_cuts_what_is_written_in_it(calibration, draw):
    figure = draw(calibration)
    found = InlineFigure.of(figure)
    assert found.headline == title(figure)
    assert sum(panel.svg.count("<text") for panel in found.panels) > 4
    ends = [(panel.x, panel.x + panel.width) for panel in found.panels if panel.y == 0.0]
    assert ends[0][0] == 0.0
    assert [end for _, end in ends[:-1]] == [start for start, _ in ends[1:]]
    scale = 72.0 / figure.dpi
    for axes in figure.axes:
        if axes.get_label() != "<colorbar>":
            box = axes.get_tightbbox()
            inside = [
                low - 1 <= scale * box.x0 and scale * box.x1 <= high + 1 for low, high in ends
            ]
            assert inside.count(True) == 1, (draw.__name__, ends, scale * box.x0, scale * box.x1)


def test_figures_take_the_colours_of_the_page_and_names_of_their_own(calibration):
    first, second = (
        "".join(panel.svg for panel in InlineFigure.of(draw(calibration)).panels)
        for draw in (error_distribution, error_over_workspace)
    )
    assert "var(--ink)" in first
    assert palette.INK not in first + second
    names = [set(re.findall(r'\bid="([^"]+)"', svg)) for svg in (first, second)]
    assert not {name for name in names[0] & names[1] if not name.startswith("panel-")}
    for svg, known in zip((first, second), names, strict=True):
        assert set(re.findall(r'(?:url\(#|href="#)([^)"]+)', svg)) <= known


def test_the_distribution_has_one_curve_a_set_with_mean_and_rms(calibration):
    figure = error_distribution(calibration)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [label.split(" (")[0] for label in labels] == [
        "held-out",
        "cross-validation",
        "training",
    ]
    statistics = calibration.test.statistics
    assert f"mean {1e3 * statistics.mean:.2f}, rms {1e3 * statistics.rms:.2f} mm" in labels[0]
    half = 1e3 * statistics.median
    assert title(figure).startswith(f"Half within {half:.2f} mm")
    curve = figure.axes[0].lines[0]
    assert curve.get_xdata()[-1] == pytest.approx(1e3 * statistics.max)
    assert curve.get_ydata()[-1] == pytest.approx(100.0)


def test_errors_that_differ_much_are_shown_on_a_logarithmic_axis(calibration, failed):
    assert error_distribution(calibration).axes[0].get_xscale() == "linear"
    assert error_distribution(failed).axes[0].get_xscale() == "log"


def test_every_inlier_is_in_each_projection(calibration):
    figure = error_over_workspace(calibration)
    inliers = int(np.sum(~calibration.outliers))
    for axes in figure.axes[:3]:
        counts = [len(group.get_offsets()) for group in axes.collections]
        assert counts == [inliers, len(calibration.test.distances)]


def test_a_trend_over_a_joint_angle_is_found(calibration):
    from dataclasses import replace

    train = calibration.train
    elbow = train.observations.angles[:, 3]
    bent = np.zeros_like(train.p_WH_predicted)
    bent[:, 1] = 2e-3 * np.sin(2.0 * np.pi * elbow / np.ptp(elbow))
    wrong = replace(train, p_WH_predicted=train.p_WH_predicted - bent)
    assert "no trend" in title(residuals_over_angles(calibration))
    found = title(residuals_over_angles(replace(calibration, train=wrong)))
    assert found.endswith("in y over elbow is left")


def test_unobservable_parameters_are_called_unobservable(failed):
    figure = parameter_sigmas(failed)
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    count = len(unobservable(failed))
    assert count >= len({name for way in failed.uncertainty.unobservable for name in way.names}) > 1
    assert words.count("unobservable") == count
    assert title(figure).startswith(f"{count} of {len(failed.uncertainty.names)} parameters")


def test_sigmas_are_grouped_by_unit(calibration):
    panels = parameter_sigmas(calibration).axes
    assert [axes.get_title(loc="left") for axes in panels] == ["lengths", "angles", "gears"]
    shown = sum(len(axes.get_yticklabels()) for axes in panels)
    assert shown == len(calibration.uncertainty.names)


def test_the_strongest_correlation_is_named(calibration):
    correlation = np.abs(np.tril(calibration.uncertainty.correlation, -1))
    i, j = np.unravel_index(np.argmax(correlation), correlation.shape)
    names = calibration.uncertainty.names
    assert f"{names[j]} with {names[i]}" in title(correlations_drawn(calibration))


def test_of_many_parameters_those_that_are_most_correlated_are_shown():
    count = 60
    rng = np.random.default_rng(0)
    C = np.diag(rng.uniform(1.0, 2.0, count))
    C[7, 50] = C[50, 7] = 0.9
    names = tuple(f"joint.part{i}" for i in range(count))
    known = Uncertainty(names, C, np.sqrt(np.diag(C)), 1.0, count, 1.0, ())
    figure = correlations(known)
    shown = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert {"joint.part7", "joint.part50"} <= set(shown)
    assert len(shown) == 40
    assert "40 of 60 parameters shown" in title(figure)


def test_sigmas_of_what_bends_are_not_among_those_of_the_geometry(calibration):
    from dataclasses import replace

    joints = calibration.model.joints
    bending = replace(
        Bending.none(joints, np.array([0.0, 0.0, 1.0]), np.zeros((4, 3)), np.zeros(4)),
        effects=("coupling",),
    )
    known, more = calibration.uncertainty, len(bending.names)
    told = np.append(known.sigma, np.full(more, 1e-3))
    wider = replace(known, names=(*known.names, *bending.names), sigma=told)
    bent = replace(calibration, model=replace(calibration.model, bending=bending))
    bent = replace(bent, uncertainty=wider)
    labels = [t.get_text() for axes in parameter_sigmas(bent).axes for t in axes.get_yticklabels()]
    assert sorted(labels) == sorted(calibration.uncertainty.names)


def test_points_of_a_figure_are_one_path_and_take_little_room(calibration):
    panels = InlineFigure.of(residuals_over_angles(calibration)).panels
    count = 3 * int(np.sum(~calibration.outliers)) * len(calibration.model.joints)
    assert sum(len(panel.svg) for panel in panels) < 130 * count + 40_000


def test_circle_points_alone_have_no_figures_of_what_they_do_not_know(circles_alone):
    assert parameter_sigmas(circles_alone) is None
    assert unobservable(circles_alone) == frozenset()
    assert convergence(circles_alone) is None


def test_convergence_says_how_many_starts_agree(calibration):
    search = calibration.search
    wanted = f"{search.agreeing} of {len(search.labels)} starts reached the best minimum"
    assert title(convergence(calibration)) == wanted


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [
        (12.34567, 0.021, "12.346"),
        (-354.6, 1.6, "−354.6"),
        (0.5, 123.0, "0"),
        (1.0, 0.0, "1.000"),
        (1.0, None, "1.000"),
    ],
)
def test_no_more_digits_are_shown_than_are_known(value, sigma, text):
    assert decimals(value, sigma) == text


def test_factors_and_steps_are_round():
    assert nice_factor(0.03, 0.0012) == 20.0
    assert nice_factor(0.03, 1.0) == 1.0
    assert nice_factor(0.03, 0.0) == 1.0
    assert [nice_below(x) for x in (0.37, 1.0, 9.99, 0.0499)] == [0.2, 1.0, 5.0, 0.02]
    assert [short(x) for x in (0.0876, 2.6, 114.2)] == ["0.088", "2.6", "110"]


@pytest.mark.parametrize("highest", slow_rest([1.5, 2e3, 3.0, 7.6, 90.0, 1e12], plain=2))
def test_a_logarithmic_axis_has_plain_ticks_however_little_it_spans(highest):
    with style():
        figure = Figure()
        axes = figure.add_subplot()
        axes.semilogy([0.0, 1.0, 2.0], [1.0, 1.2, highest])
        log_ticks(axes.yaxis)
        figure.draw_without_rendering()
        low, high = axes.get_ylim()
        texts = [
            tick.label1.get_text()
            for tick in (*axes.yaxis.get_major_ticks(), *axes.yaxis.get_minor_ticks())
            if low <= tick.get_loc() <= high and tick.label1.get_text()
        ]
    assert 2 <= len(texts) <= 12
    assert all(float(text) > 0.0 for text in texts)  # mathematics is no number
