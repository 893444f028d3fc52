"""Rational lenses and fisheyes: OpenCV's pixels, derivatives, inverses, what they refuse."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.model.cameras import fisheye
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import LENSES, intrinsics_of, project_in_camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import load_model, save_model

SIZE = (1280, 960)
INSIDE = {"fx": 385.0, "fy": 386.0, "cx": 640.0, "cy": 470.0, "image_size": SIZE}
FISHEYE = Camera(**INSIDE, k1=0.03, k2=-0.01, k3=0.003, k4=-0.0005, lens="fisheye")
RATIONAL = Camera(
    **INSIDE, skew=0.4, k1=0.8, k2=0.12, k3=0.002, p1=1e-3, p2=-5e-4, k4=1.1, k5=0.3, k6=0.02,
    lens="rational",
)  # fmt: skip


def points(rng, count, widest):
    off, way = rng.uniform(0.0, np.radians(widest), count), rng.uniform(0.0, 2 * np.pi, count)
    lines = np.stack([np.sin(off) * np.cos(way), np.sin(off) * np.sin(way), np.cos(off)])
    return (lines * rng.uniform(0.2, 3.0, count)).T


def test_a_fisheye_shows_what_opencv_shows():
    p = points(np.random.default_rng(0), 200, 88.0)
    expected, _ = cv2.fisheye.projectPoints(
        p[:, None], np.zeros(3), np.zeros(3), FISHEYE.K, FISHEYE.k
    )
    assert FISHEYE.project(p) == pytest.approx(expected[:, 0], abs=1e-9)


def test_a_rational_lens_shows_what_opencv_shows():
    p = points(np.random.default_rng(1), 200, 60.0)
    k = RATIONAL.k
    coefficients = np.array([*k[:2], *RATIONAL.p, k[2], *k[3:]])
    ideal = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    bent, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), ideal, coefficients)
    expected = np.column_stack([bent[:, 0], np.ones(len(p))]) @ RATIONAL.K[:2].T
    assert RATIONAL.project(p) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("camera", [FISHEYE, RATIONAL], ids=lambda c: c.lens)
def test_every_derivative_is_that_of_the_pixels(camera):
    p = points(np.random.default_rng(2), 50, 110.0 if camera is FISHEYE else 60.0).T
    p[:, 0] = [0.0, 0.0, 1.0]
    values = camera.values
    _, by_point, by_values = project_in_camera(p, values, camera.lens)

    def moved(dp, dv):
        return project_in_camera(p + dp, values + dv, camera.lens)[0]

    for i in range(3):
        step = 1e-6 * np.eye(3)[i][:, None]
        slope = (moved(step, 0.0) - moved(-step, 0.0)) / 2e-6
        assert by_point[:, i] == pytest.approx(slope, abs=2e-5 * np.abs(slope).max())
    for i in range(len(values)):
        step = 1e-6 * np.eye(len(values))[i]
        slope = (moved(0.0, step) - moved(0.0, -step)) / 2e-6
        assert by_values[:, i] == pytest.approx(slope, abs=1e-5 * max(np.abs(slope).max(), 1.0))


@pytest.mark.parametrize(("camera", "widest"), [(FISHEYE, 88.0), (RATIONAL, 60.0)])
def test_pixels_have_the_rays_that_made_them(camera, widest):
    p = points(np.random.default_rng(3), 300, widest)
    pixels = camera.project(p)
    assert camera.has_rays(pixels).all()
    assert camera.undistort(pixels) == pytest.approx(p[:, :2] / p[:, 2:], rel=1e-9, abs=1e-12)
    rays = camera.rays(pixels)
    far = rays.direction * np.linalg.norm(p, axis=1)[:, None]
    assert camera.project(far) == pytest.approx(pixels, abs=1e-9)
    assert not camera.folds(pixels).any()


@pytest.mark.parametrize(
    "k",
    [(0.51, -0.075, -0.002, 0.899, -0.017, -0.017), (0.56, -0.05, -0.0013, 0.948, 0.0318, -0.0113)],
)
def test_a_rational_lens_that_ends_at_its_pole_has_rays_before_it(k):
    rng = np.random.default_rng(4)
    for off in rng.normal(0.0, 1e-4, (50, 6)):
        named = {f"k{i + 1}": float(value) for i, value in enumerate(np.array(k) + off)}
        camera = Camera(**INSIDE, **named, lens="rational")
        seen = camera.project(points(rng, 40, 45.0))
        assert camera.has_rays(seen).all()
        assert not camera.folds(seen).any()


def test_a_fisheye_sees_past_90_degrees_but_has_no_coordinates_there():
    p = points(np.random.default_rng(4), 50, 1.0) * [1.0, 1.0, 0.0] + np.array([2.0, 0.0, -0.2])
    pixels = FISHEYE.project(p)
    assert np.isfinite(pixels).all()
    assert not FISHEYE.has_rays(pixels).any()
    with pytest.raises(ModelError, match="89 deg and more off the axis"):
        FISHEYE.undistort(pixels)
    assert not FISHEYE.folds(pixels).any()


def test_a_fisheye_that_folds_says_where():
    folding = Camera(**INSIDE, k1=-0.2, lens="fisheye")
    limit = fisheye.largest_angle(folding.k)
    assert limit == pytest.approx(np.sqrt(1.0 / 0.6))
    over = np.array([[np.sin(limit + 0.01), 0.0, np.cos(limit + 0.01)]])
    assert np.isnan(folding.project(over)).all()
    assert folding.folds(np.array([1200.0, 470.0]))


@pytest.mark.parametrize("camera", [FISHEYE, RATIONAL], ids=lambda c: c.lens)
def test_a_camera_outlives_its_file(camera, tmp_path):
    other = camera.at(np.block([[np.eye(3), np.array([[0.1], [0], [0]])], [0, 0, 0, 1]]))
    model = SelfModel("wide", cameras={"left": camera, "right": other})
    save_model(model, tmp_path / "self_model.yaml")
    again = load_model(tmp_path / "self_model.yaml")
    assert again.rig.lenses == (camera.lens, camera.lens)
    assert np.array_equal(again.rig.values, model.rig.values)
    assert len(again.rig.names) == len(again.rig.values) == len(again.rig.units)


def test_what_cannot_be_is_refused():
    with pytest.raises(
        ValueError, match="no lens 'round'; there are polynomial, rational, fisheye"
    ):
        Camera(**INSIDE, lens="round")
    with pytest.raises(ValueError, match="a polynomial lens has no k4"):
        Camera(**INSIDE, k4=0.1)
    with pytest.raises(ValueError, match="a fisheye lens has no p1"):
        Camera(**INSIDE, p1=0.1, lens="fisheye")


def test_cameras_of_two_kinds_are_a_pair_whose_numbers_are_named_camera_by_camera():
    aside = np.block([[np.eye(3), np.array([[0.1], [0.0], [0.0]])], [0.0, 0.0, 0.0, 1.0]])
    pair = StereoRig(FISHEYE, replace(RATIONAL.at(aside), image_size=(640, 480)))
    assert pair.names[8:10] == ("left.k4", "right.fx")
    assert len(pair.names) == len(pair.values) == len(pair.units) == 9 + 13 + 6
    again = pair.with_values(pair.values)
    assert [camera.lens for camera in again.cameras] == ["fisheye", "rational"]
    assert [camera.image_size for camera in again.cameras] == [SIZE, (640, 480)]
    edge = np.array([[100.0, 100.0, 630.0, 470.0], [100.0, 100.0, 700.0, 470.0], [np.nan] * 4])
    assert pair.inside(edge).tolist() == [True, False, False]
    assert not pair.inside(edge, margin=20.0).any()
    p = np.array([[0.2, -0.1, 1.0], [-0.3, 0.1, 0.8]])
    assert again.project(p) == pytest.approx(pair.project(p), abs=1e-9)
    pixels, _, by_cameras = project_to_cameras(p.T, pair.values, pair.lenses)
    assert pytest.approx(pair.project(p), abs=1e-9) == pixels.T
    for k, value in enumerate(pair.values):
        step = 1e-6 * max(1.0, abs(value)) * np.eye(len(pair.values))[k]
        up, down = (pair.with_values(pair.values + s * step).project(p) for s in (1.0, -1.0))
        slope = (up - down) / (2.0 * step[k])
        assert pytest.approx(slope, rel=1e-5, abs=1e-4) == by_cameras[k].T, pair.names[k]


def test_a_polynomial_is_a_rational_lens_whose_last_coefficients_are_zero():
    plain = Camera(**INSIDE, k1=-0.2, k2=0.05, k3=-0.003, p1=1e-3)
    wide = Camera.from_values([*plain.values, 0.0, 0.0, 0.0], SIZE, lens="rational")
    p = points(np.random.default_rng(5), 100, 50.0)
    assert wide.project(p) == pytest.approx(plain.project(p), abs=1e-10)
    assert [len(intrinsics_of(lens)) for lens in LENSES] == [10, 13, 9]


@pytest.mark.parametrize("camera", [FISHEYE, RATIONAL], ids=lambda c: c.lens)
@pytest.mark.parametrize("place", [(0.0, 0.0, 1.0), (0.4, -0.2, 0.8)])
def test_pixels_have_slopes_in_drakes_scalars(camera, place):
    p = InitializeAutoDiff(np.array(place)).ravel()
    pixels = camera.pixels_of_points(p)
    expected = camera.projection(np.array([place]))
    assert ExtractValue(pixels).ravel() == pytest.approx(expected.pixels[0], abs=1e-9)
    assert ExtractGradient(pixels) == pytest.approx(expected.by_point[0], abs=1e-6)
