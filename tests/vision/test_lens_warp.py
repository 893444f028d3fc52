"""A pinhole picture, bent by a lens, shows everything where `Camera.project` puts it."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.vision.images.lens_warp import LensWarp

from ..slow_rest import slow_rest

CAMERA = Camera(190.0, 188.0, 161.3, 117.8, (320, 240), k1=-0.28, k2=0.09, k3=-0.012, p1=1e-3)


def pinhole_picture(warp, ideal, sigma=5.0):
    """Render soft spots at X/Z, Y/Z with the matrix that a renderer gets."""
    width, height = warp.render_size
    places = ideal @ warp.render_K[:2, :2].T + warp.render_K[:2, 2]
    # A renderer counts from the edge of the first pixel: its centre is at one half.
    u, v = np.arange(width) + 0.5, np.arange(height) + 0.5
    picture = np.zeros((height, width))
    for x, y in places:
        spot = np.exp(-0.5 * ((v - y) / sigma) ** 2)[:, None] * np.exp(
            -0.5 * ((u - x) / sigma) ** 2
        )
        picture += 250.0 * spot
    return np.rint(np.clip(picture, 0.0, 255.0)).astype(np.uint8)


def centroid_near(picture, pixel, reach=11):
    u0, v0 = np.rint(pixel).astype(int)
    part = picture[v0 - reach : v0 + reach + 1, u0 - reach : u0 + reach + 1].astype(float)
    u, v = np.arange(u0 - reach, u0 + reach + 1), np.arange(v0 - reach, v0 + reach + 1)
    return np.array([(part * u).sum(), (part * v[:, None]).sum()]) / part.sum()


@pytest.mark.parametrize("supersample", slow_rest([1, 2, 3]))
def test_spots_land_where_the_camera_projects_them(supersample):
    warp = LensWarp.from_camera(CAMERA, supersample)
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 5), np.linspace(-0.45, 0.45, 4))
    ideal = np.column_stack([x.ravel(), y.ravel()])
    picture = warp.apply(pinhole_picture(warp, ideal, sigma=2.5 * supersample))
    pixels = CAMERA.project(np.column_stack([ideal, np.ones(len(ideal))]))
    found = np.array([centroid_near(picture, pixel) for pixel in pixels])
    # A spot is bent too, so that its middle moves a little.
    assert np.abs(found - pixels).max() < 0.12
    assert np.abs((found - pixels).mean(axis=0)).max() < 0.03


def test_a_camera_without_a_lens_is_left_as_it_is():
    plain = Camera(190.0, 190.0, 159.5, 119.5, (320, 240))
    warp = LensWarp.from_camera(plain, 1)
    rng = np.random.default_rng(0)
    width, height = warp.render_size
    rendered = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    cut = warp.render_K[:2, 2] - 0.5 - [plain.cx, plain.cy]
    u, v = np.rint(cut).astype(int)
    assert np.array_equal(warp.apply(rendered), rendered[v : v + 240, u : u + 320])


def test_pixels_beyond_the_fold_are_dark_and_the_others_are_not():
    folding = replace(CAMERA, k1=-0.5, k2=0.0, k3=0.0, p1=0.0)
    warp = LensWarp.from_camera(folding, 2)
    white = np.full((*warp.render_size[::-1], 3), 255, dtype=np.uint8)
    picture = warp.apply(white)
    assert 0 < warp.dark.sum() < 0.7 * warp.dark.size
    assert (picture[warp.dark] == 0).all()
    assert (picture[120, 160] == 255).all()


def test_a_picture_of_another_size_is_refused():
    warp = LensWarp.from_camera(CAMERA, 1)
    with pytest.raises(ValueError, match="wide and high"):
        warp.apply(np.zeros((240, 320, 3), np.uint8))


def test_no_sampling_and_too_much_of_it_are_refused():
    with pytest.raises(ValueError, match="at least 1"):
        LensWarp.from_camera(CAMERA, 0)
    for camera, samples in ((CAMERA, 30), (Camera(40.0, 40.0, 320.0, 4.0, (640, 8)), 13)):
        with pytest.raises(ModelError, match="lower the supersampling"):
            LensWarp.from_camera(camera, samples)


@pytest.mark.slow
@pytest.mark.parametrize(
    "window",
    [(300, 200, 500, 420), (0, 0, 64, 64), (700, 500, 702, 501)],
)
@pytest.mark.parametrize("k1", [-0.28, -0.6])
def test_a_part_of_a_picture_is_bent_as_the_whole_is(window, k1):
    warp = LensWarp.from_camera(Camera(400.0, 400.0, 199.5, 149.5, (400, 300), k1=k1))
    color = np.array([90, 100, 110, 255], dtype=np.uint8)
    whole = np.full((*warp.render_size[::-1], 4), color)
    left, top, right, bottom = window
    part = np.random.default_rng(0).integers(
        0, 256, (bottom - top, right - left, 4), dtype=np.uint8
    )
    whole[top:bottom, left:right] = part
    np.testing.assert_array_equal(warp.apply_to_part(part, window, color), warp.apply(whole))


def test_what_has_no_ray_tells_a_turned_camera_nothing_of_where_to_look():
    # Such samples are far outside: a view of them all would be as large as the memory.
    folding = replace(CAMERA, k1=-0.5, k2=0.0, k3=0.0, p1=0.0)
    warp = LensWarp.from_camera(folding, 2)
    rays = warp.rays.reshape(-1, 2).astype(float)
    rays = rays[(rays < 100.0).all(axis=1)]
    x, y = rays[np.argmax(rays.sum(axis=1))]  # at the edge of what the lens sees
    way = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])
    region, shown = warp.region_in(way, 1.0)  # a hand close to it
    samples = warp.rays[region.samples][shown.repeat(2, axis=0).repeat(2, axis=1)]
    lit = (samples < 100.0).all(axis=1)
    assert 0 < lit.sum() < len(lit)
    told = warp.rays_of(region, shown)
    assert np.array_equal(told.min(axis=0), samples[lit].min(axis=0))
    assert np.array_equal(told.max(axis=0), samples[lit].max(axis=0))


def test_of_pixels_without_rays_there_is_nothing_to_turn_to():
    warp = LensWarp.from_camera(replace(CAMERA, k1=-0.5, k2=0.0, k3=0.0, p1=0.0), 2)
    region, shown = warp.region_in(np.array([0.0, 0.0, 1.0]), 3.0)
    assert len(warp.rays_of(region, shown & warp.dark[region.pixels])) == 0
