import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import rc_context

from nico_selfmodel.viz.figures.camera_plots import coverage, pixel_errors, view_errors
from nico_selfmodel.viz.figures.camera_views import shown_views
from nico_selfmodel.viz.figures.lens_plots import (
    distortion_profile,
    epipolar_distribution,
    reconstruction_by_range,
)
from nico_selfmodel.viz.figures.parameter_plots import correlations
from nico_selfmodel.viz.figures.plot_style import image_bytes
from nico_selfmodel.viz.figures.residual_field import field_of, residual_field

from .seen_boards import OUTLIER


def views_drawn(assessment):
    return view_errors(shown_views(assessment))


def correlations_drawn(assessment):
    return correlations(assessment.calibration.uncertainty)


ALL = (
    pixel_errors,
    coverage,
    residual_field,
    views_drawn,
    distortion_profile,
    epipolar_distribution,
    reconstruction_by_range,
    correlations_drawn,
)


@pytest.mark.slow
@pytest.mark.parametrize("draw", ALL, ids=lambda f: f.__name__)
def test_every_figure_states_its_point_whatever_was_lost(flawed_cameras, draw):
    figure = draw(flawed_cameras)
    assert 20 < len(figure.get_suptitle()) < 90
    assert image_bytes(figure, "svg").startswith(b"<?xml")


@pytest.mark.parametrize("draw", ALL, ids=lambda f: f.__name__)
def test_one_camera_has_every_figure_but_those_of_a_pair(one_camera, draw):
    figure = draw(one_camera)
    if draw in (epipolar_distribution, reconstruction_by_range):
        assert figure is None
    else:
        assert 20 < len(figure.get_suptitle()) < 62


def test_the_distribution_shows_held_out_corners_first(cameras):
    figure = pixel_errors(cameras)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [label.split(" (")[0] for label in labels] == [
        "held-out",
        "cross-validation",
        "training",
    ]
    rms = float(np.sqrt(np.mean(cameras.test_distances**2)))
    assert f"rms {rms:.2f} px" in labels[0]


def test_corners_of_the_image_without_a_corner_are_named(cameras, flawed_cameras):
    views = cameras.calibration.views
    reached = 0
    for camera in views.cameras:
        u, v = views.of_camera(camera).reshape(-1, 2).T
        for a in (u < 39.5, u > 279.5):
            reached += sum(bool(np.any(a & b)) for b in (v < 39.5, v > 199.5))
    title = coverage(cameras).get_suptitle()
    assert title.endswith(f"and {reached} of their 8 corners")
    # Outliers cover nothing.
    inliers = ~flawed_cameras.calibration.outliers
    shown = [axes.get_title(loc="left") for axes in coverage(flawed_cameras).axes]
    counts = flawed_cameras.calibration.views.seen[inliers].sum(axis=(0, 2))
    assert shown == [f"left: {counts[0]} corners", f"right: {counts[1]} corners"]


def test_a_pattern_of_the_residuals_is_told_from_noise_and_from_one_bad_board(cameras):
    calibration, rng = cameras.calibration, np.random.default_rng(2)
    noise = rng.normal(0.0, 0.1, calibration.residuals.shape)
    out_from_the_middle = 2e-3 * (calibration.views.pixels - np.tile([159.5, 119.5], 2))
    one_bad_board = np.where(np.arange(len(noise))[:, None, None] == 3, 1.5, 0.0)
    for extra, told in ((0.0, False), (out_from_the_middle, True), (one_bad_board, False)):
        changed = replace(cameras, calibration=replace(calibration, residuals=noise + extra))
        assert ("pattern of up to" in residual_field(changed).get_suptitle()) == told
    field = field_of(
        replace(cameras, calibration=replace(calibration, residuals=out_from_the_middle)), 0
    )
    np.testing.assert_allclose(field.means, 2e-3 * (field.cells - [159.5, 119.5]), atol=0.02)


def test_residuals_are_drawn_where_the_corners_are(flawed_cameras):
    calibration = flawed_cameras.calibration
    field = field_of(flawed_cameras, 1)
    assert len(field.pixels) == calibration.views.seen[~calibration.outliers][:, 1].sum()
    assert np.isfinite(field.pixels).all()
    assert np.isfinite(field.residuals).all()


def test_the_key_of_arrows_stands_above_its_panel_however_many_there_are(cameras, monkeypatch):
    monkeypatch.setattr("nico_selfmodel.viz.figures.residual_field.MANY", 10)  # more are rasterised
    with rc_context({"svg.fonttype": "none"}):
        content = image_bytes(residual_field(cameras), "svg").decode()
    heights = [
        float(found[1])
        for found in re.finditer(r'<text[^>]* y="([-\d.]+)"[^>]*>[^<\[]* px</text>', content)
    ]
    assert len(heights) == 4
    assert heights == pytest.approx([heights[0]] * 4)
    assert 0.0 < heights[0] < 72.0


def test_the_worst_view_is_named(flawed_cameras):
    title = views_drawn(flawed_cameras).get_suptitle()
    rms = flawed_cameras.calibration.view_rms
    worst = flawed_cameras.calibration.views.names[int(np.argmax(rms))]
    assert worst == OUTLIER
    assert title.startswith(f"Worst view: {worst} with {rms.max():.2f} px rms")


def test_the_profile_is_what_the_lens_does_and_its_band_covers_the_truth(cameras):
    figure = distortion_profile(cameras)
    camera = cameras.calibration.cameras[0]
    curve = figure.axes[0].lines[1]
    there, moved = (np.asarray(x) for x in curve.get_data())
    focal = 0.5 * (camera.fx + camera.fy)
    ideal = (there - moved) / focal
    bent = ideal * (1.0 + sum(k * ideal ** (2 * i + 2) for i, k in enumerate(camera.k)))
    np.testing.assert_allclose(focal * bent, there, atol=1e-9)
    corner = np.array([camera.cx, camera.cy])
    assert there[-1] == pytest.approx(
        np.linalg.norm(np.maximum(corner, [319, 239] - corner)), rel=0.01
    )


def test_reconstruction_errors_are_drawn_over_their_range(cameras):
    axes = reconstruction_by_range(cameras).axes[0]
    found = cameras.pair.reconstruction
    distance, error = axes.lines[0].get_data()
    np.testing.assert_allclose(distance, 1e3 * found.depths.ravel())
    np.testing.assert_allclose(error, 1e3 * found.errors.ravel())
    _, rms = axes.lines[1].get_data()
    assert 0.0 < rms.min() <= 1e3 * np.sqrt(np.mean(found.errors**2)) <= rms.max()
