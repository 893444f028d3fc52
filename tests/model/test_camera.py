"""The camera: projection and rays with their derivatives, against differences and OpenCV."""

from dataclasses import FrozenInstanceError, replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import rotation_from_vector, rotation_vector_of
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import (
    INTRINSICS,
    LENSES,
    intrinsic_units,
    intrinsics_of,
)

from ..slow_rest import slow_rest

SIZE = (640, 480)
SEED = st.integers(0, 2**32 - 1)
a_few = settings(max_examples=25)
"""Each example draws a camera and a dozen points."""
WIDE = Camera(381.0, 381.0, 319.5, 239.5, SIZE, k1=-0.28, k2=0.09, k3=-0.012)
"""Nico's wide camera."""


def random_camera(seed):
    """Return a camera somewhere, with a lens that bends, skews and tilts."""
    rng = np.random.default_rng(seed)
    f, c = rng.uniform(300.0, 800.0, 2), rng.uniform([250.0, 180.0], [390.0, 300.0])
    k = rng.normal(0.0, [0.1, 0.05, 0.01])
    p = rng.normal(0.0, 1e-3, 2)
    pose = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    return Camera.from_values([*f, rng.normal(0.0, 2.0), *c, *k, *p], SIZE, pose)


def in_view(camera, seed, count=12):
    """Return points of the world that the camera sees near the image's middle. Shape (N, 3)."""
    rng = np.random.default_rng(seed)
    aside = rng.uniform(-0.35, 0.35, (count, 2))
    depth = rng.uniform(0.2, 2.0, (count, 1))
    return apply(camera.X_WC, np.hstack([aside * depth, depth]))


def moved(camera, step):
    """Return the camera moved to exp([w]) R, p + t, as its derivatives count it."""
    X = camera.X_WC
    return camera.at(transform(rotation_from_vector(step[:3]) @ X[:3, :3], X[:3, 3] + step[3:]))


def changed(camera, step):
    return Camera.from_values(camera.values + step, SIZE, camera.X_WC)


def without_skew(camera):
    """Return the camera as OpenCV can describe it."""
    return replace(camera, skew=0.0)


def opencv_lens(camera):
    return np.array([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3])


def slope(function, size, h):
    """Return central differences of an array by a vector, appended as the last axis."""
    steps = h * np.eye(size)
    return np.stack([(function(e) - function(-e)) / (2.0 * h) for e in steps], axis=-1)


def assert_slope(found, numeric):
    assert np.abs(found - numeric).max() <= 1e-6 * np.abs(numeric).max()


def test_a_pixel_and_its_depth_are_the_point_that_is_seen_there():
    rng = np.random.default_rng(4)
    camera = WIDE.at(transform(rotation_from_vector([0.3, -0.2, 0.1]), [0.1, 0.2, 0.3]))
    p_CQ = rng.uniform([-0.2, -0.15, 0.5], [0.2, 0.15, 1.5], (20, 3))
    p_WQ = apply(camera.X_WC, p_CQ)
    found = camera.at_depth(camera.project(p_WQ), p_CQ[:, 2])
    np.testing.assert_allclose(found, p_WQ, atol=1e-9)


@pytest.mark.parametrize(
    ("p", "skew"),
    slow_rest([((1e-3, -5e-4), 0.4), ((1e-3, -5e-4), 0.0), ((0.0, 0.0), 0.4), ((0.0, 0.0), 0.0)]),
)
def test_undistortion_undoes_projection_over_the_whole_image_of_the_wide_camera(p, skew):
    values = WIDE.values
    values[2], values[8:] = skew, p
    camera = Camera.from_values(values, SIZE, random_camera(4).X_WC)
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(float)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    assert camera.has_rays(pixels).all()
    ideal = camera.undistort(pixels)
    seen = camera.project(apply(camera.X_WC, 0.7 * np.column_stack([ideal, np.ones(len(ideal))])))
    assert np.abs(seen - pixels).max() <= 1e-9
    assert np.abs(camera.pixels_of(ideal.T).T - pixels).max() <= 1e-9


@a_few
@given(SEED)
def test_projection_moves_with_the_point_as_differences_say(seed):
    camera = random_camera(seed)
    p = in_view(camera, seed)
    numeric = slope(lambda e: camera.project(p + e), 3, 1e-6)
    found = camera.projection(p)
    assert found.pixels == pytest.approx(camera.project(p), abs=1e-10)
    assert_slope(found.by_point, numeric)


@a_few
@given(SEED)
def test_projection_moves_with_the_pose_as_differences_say(seed):
    camera = random_camera(seed)
    p = in_view(camera, seed)
    numeric = slope(lambda e: moved(camera, e).project(p), 6, 1e-6)
    assert_slope(camera.projection(p).by_pose, numeric)


@a_few
@given(SEED)
def test_projection_moves_with_the_intrinsics_as_differences_say(seed):
    camera = random_camera(seed)
    p = in_view(camera, seed)
    numeric = slope(lambda e: changed(camera, e).project(p), 10, 1e-4)
    found = camera.projection(p).by_intrinsics
    for i, name in enumerate(INTRINSICS):
        size = np.abs(numeric[:, :, i]).max()
        assert found[:, :, i] == pytest.approx(numeric[:, :, i], abs=1e-7 * size), name


@a_few
@given(SEED)
def test_rays_are_unit_vectors_from_the_centre_through_what_is_seen(seed):
    camera = random_camera(seed)
    p = in_view(camera, seed)
    rays = camera.rays(camera.project(p))
    assert np.array_equal(rays.origin, camera.X_WC[:3, 3])
    towards = p - rays.origin
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert rays.direction == pytest.approx(towards, abs=1e-12)


@pytest.mark.slow
@a_few
@given(SEED)
def test_rays_turn_as_differences_say(seed):
    camera = random_camera(seed)
    pixels = camera.project(in_view(camera, seed))
    rays = camera.rays(pixels)
    assert_slope(rays.by_pixel, slope(lambda e: camera.rays(pixels + e).direction, 2, 1e-3))
    assert_slope(rays.by_pose, slope(lambda e: moved(camera, e).rays(pixels).direction, 6, 1e-5))
    numeric = slope(lambda e: changed(camera, e).rays(pixels).direction, 10, 1e-4)
    for i, name in enumerate(INTRINSICS):
        size = np.abs(numeric[:, :, i]).max()
        assert rays.by_intrinsics[:, :, i] == pytest.approx(numeric[:, :, i], abs=1e-6 * size), name


@a_few
@given(SEED)
def test_opencv_projects_alike_and_has_the_same_derivatives(seed):
    camera = without_skew(random_camera(seed))
    p = in_view(camera, seed)
    X_CW = camera.X_CW
    theirs, jacobian = cv2.projectPoints(
        p, rotation_vector_of(X_CW[:3, :3]), X_CW[:3, 3].copy(), camera.K, opencv_lens(camera)
    )
    ours = camera.projection(p)
    assert ours.pixels == pytest.approx(theirs[:, 0], abs=1e-9)
    # OpenCV's columns: rotation, translation, fx, fy, cx, cy, k1, k2, p1, p2, k3
    by_intrinsics = jacobian.reshape(-1, 2, jacobian.shape[1])[:, :, 6:15]
    order = [INTRINSICS.index(n) for n in ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]]
    assert ours.by_intrinsics[:, :, order] == pytest.approx(by_intrinsics, abs=1e-8)


@a_few
@given(SEED)
def test_opencv_undistorts_alike(seed):
    camera = without_skew(random_camera(seed))
    pixels = camera.project(in_view(camera, seed))
    end = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-13)
    theirs = cv2.undistortPoints(pixels[:, None], camera.K, opencv_lens(camera), criteria=end)
    assert camera.undistort(pixels) == pytest.approx(theirs[:, 0], abs=1e-9)


def test_the_pixel_of_the_optical_axis_is_the_principal_point_and_v_grows_downwards():
    assert WIDE.project([0.0, 0.0, 2.0]).tolist() == [319.5, 239.5]
    right_and_down = WIDE.project([0.1, 0.1, 1.0])
    assert (right_and_down > [319.5, 239.5]).all()
    sheared = Camera(400.0, 500.0, 10.0, 20.0, SIZE, skew=3.0)
    assert sheared.project([0.1, 0.2, 1.0]) == pytest.approx([50.6, 120.0])
    assert sheared.K.tolist() == [[400.0, 3.0, 10.0], [0.0, 500.0, 20.0], [0.0, 0.0, 1.0]]


def test_what_is_not_in_front_of_the_camera_has_no_pixel():
    p = np.array([[0.0, 0.0, -1.0], [0.1, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    pixels = WIDE.project(p)
    assert np.isnan(pixels[:3]).all()
    assert np.isfinite(pixels[3]).all()
    with pytest.raises(ModelError, match="3 points are behind the camera"):
        WIDE.projection(p)
    assert np.isnan(WIDE.project([0.0, np.nan, 1.0])).all()


def test_what_the_lens_would_fold_back_into_the_image_has_no_pixel():
    # Its fold lies at an ideal radius of 1.861.
    pixels = WIDE.project([[1.86, 0.0, 1.0], [1.862, 0.0, 1.0], [8.0, 0.0, 1.0]])
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1:]).all()


def test_pixels_without_a_ray_are_refused():
    tele = Camera(381.0, 381.0, 319.5, 239.5, SIZE, k1=-0.28)
    corners = [[0.0, 0.0], [319.5, 239.5], [639.0, 479.0]]
    assert tele.has_rays(corners).tolist() == [False, True, False]
    assert bool(tele.has_rays(corners[1])) is True
    assert not tele.has_rays([np.nan, 3.0])
    for look in (tele.undistort, tele.rays):
        with pytest.raises(ModelError, match=r"2 of 3 points lie outside .* monotone"):
            look(corners)


def test_one_point_goes_in_and_out_as_a_vector():
    p = np.array([0.05, -0.02, 0.6])
    pixel = WIDE.project(p)
    assert np.array_equal(pixel, WIDE.project(p[None])[0])
    ideal = WIDE.undistort(pixel)
    assert ideal.shape == (2,)
    assert ideal == pytest.approx(p[:2] / p[2], abs=1e-14)
    assert WIDE.undistort([[np.nan, 1.0], pixel])[0] == pytest.approx([np.nan] * 2, nan_ok=True)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: WIDE.project(np.zeros((4, 2))), r"p_WQ must have shape \(N, 3\) or \(3,\), got"),
        (lambda: WIDE.project(np.zeros((2, 4, 3))), r"p_WQ must .* got \(2, 4, 3\)"),
        (lambda: WIDE.projection([1.0, 2.0]), r"p_WQ must have .* got \(2,\)"),
        (lambda: WIDE.undistort(np.zeros((4, 3))), r"pixels must have shape \(N, 2\) or \(2,\)"),
        (lambda: WIDE.has_rays(0.0), r"pixels must have .* got \(\)"),
        (lambda: WIDE.rays(np.zeros((4, 4))), r"pixels must have .* got \(4, 4\)"),
        (lambda: WIDE.at(np.eye(3)), r"X_WC must have shape \(4, 4\), got \(3, 3\)"),
        (lambda: WIDE.at(np.full((4, 4), np.nan)), "X_WC must be finite"),
        (lambda: Camera(0.0, 1.0, 0.0, 0.0, SIZE), "must be positive, got fx 0, fy 1, 640 x 480"),
        (lambda: Camera(1.0, -1.0, 0.0, 0.0, SIZE), "must be positive"),
        (lambda: Camera(1.0, 1.0, 0.0, 0.0, (640, 0)), "must be positive, got .* 640 x 0"),
        (lambda: Camera(1.0, 1.0, np.nan, 0.0, SIZE), "parameters must be finite"),
        (lambda: Camera.from_values(np.ones(9), SIZE), "shorter"),
    ],
)
def test_what_makes_no_sense_is_refused_in_words(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_camera_is_its_ten_numbers_and_a_pose():
    camera = random_camera(3)
    assert len(INTRINSICS) == 10
    for lens in LENSES:
        units = dict(zip(intrinsics_of(lens), intrinsic_units(lens), strict=True))
        assert {name for name, unit in units.items() if unit == "px"} == set(INTRINSICS[:5])
    assert list(camera.named_values) == list(INTRINSICS)
    assert np.array_equal(list(camera.named_values.values()), camera.values)
    twin = Camera.from_values(camera.values, SIZE, camera.X_WC)
    assert np.array_equal(twin.values, camera.values)
    assert np.array_equal(twin.X_WC, camera.X_WC)
    assert np.array_equal(Camera.from_values(camera.values, SIZE).X_WC, np.eye(4))
    assert pytest.approx(np.eye(4), abs=1e-14) == camera.X_CW @ camera.X_WC


def test_a_camera_does_not_change_under_ones_hands():
    pose = np.eye(4)
    camera = WIDE.at(pose)
    pose[0, 3] = 9.0
    assert camera.X_WC[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        camera.X_WC[0, 3] = 1.0
    with pytest.raises(FrozenInstanceError):
        camera.fx = 1.0


@a_few
@given(SEED)
def test_the_image_depends_only_on_where_the_camera_stands_to_the_point(seed):
    camera = random_camera(seed)
    p = in_view(camera, seed)
    rng = np.random.default_rng(seed)
    X = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    elsewhere = camera.at(X @ camera.X_WC)
    assert elsewhere.project(apply(X, p)) == pytest.approx(camera.project(p), abs=1e-8)
