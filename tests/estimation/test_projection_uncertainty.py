"""Error bars of pixels: what repeated calibrations scatter by, and what does not matter to them."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.cameras.projection_uncertainty import ProjectionUncertainty

from .wide_boards import wide_camera, wide_views


def repeated(kind, count):
    """Return what is said of one calibration, and pixels that many others project to less turns."""
    rng = np.random.default_rng(31)
    camera = wide_camera(kind, rng)
    clean = wide_views((camera,), rng, sigma=0.0)
    options = CameraOptions(lens=kind)
    said, moved = None, []
    for _ in range(count):
        noisy = replace(clean, pixels=clean.pixels + 0.1 * rng.normal(size=clean.pixels.shape))
        found = calibrate_cameras(noisy, options)
        if said is None:
            said = ProjectionUncertainty.of(found, "left")
            grid = np.stack(np.meshgrid(said.u, said.v), axis=-1).reshape(-1, 2)
            rays = camera.directions(grid)
            seen = np.isfinite(rays).all(axis=1) & np.isfinite(said.alone.ravel())
            sigma = said.alone.ravel()[seen]
        off = found.cameras[0].project(rays[seen]) - grid[seen]
        moved.append(without_turn(off, camera, grid[seen], sigma))
    everywhere = np.full((count, len(grid), 2), np.nan)
    everywhere[:, seen] = moved
    return said, everywhere.reshape(count, *said.sigma.shape, 2)


def without_turn(moved, camera, pixels, sigma):
    """Take off what the best small turn of the camera does, its derivatives by differences."""
    weights = np.repeat(1.0 / sigma, 2)
    rays, step = camera.directions(pixels), 1e-6
    columns = []
    for axis in np.eye(3):
        turned = [camera.project(rays + sign * step * np.cross(axis, rays)) for sign in (1, -1)]
        columns.append(((turned[0] - turned[1]) / (2.0 * step)).ravel())
    R = np.stack(columns, axis=1)
    turn = np.linalg.lstsq(weights[:, None] * R, weights * moved.ravel(), rcond=None)[0]
    return moved - (R @ turn).reshape(moved.shape)


def worst_scatter(moved):
    return float(np.sqrt(np.linalg.eigvalsh(moved.T @ moved / len(moved))[-1]))


def assert_said_is_true(kind, count, low, high):
    said, moved = repeated(kind, count)
    for row, column in ((len(said.v) // 2, len(said.u) // 2), (0, 0), (-1, -1), (0, -1), (-1, 0)):
        if np.isfinite(said.sigma[row, column]):
            ratio = said.sigma[row, column] / worst_scatter(moved[:, row, column])
            print(f"{kind} at {said.u[column]:.0f}, {said.v[row]:.0f}: {ratio:.3f}")
            assert low < ratio < high


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["polynomial", "fisheye"])
def test_a_few_repetitions_scatter_as_is_said(kind):
    assert_said_is_true(kind, 25, 0.6, 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["polynomial", "fisheye"])
def test_200_repetitions_scatter_as_is_said_in_the_middle_and_in_the_corners(kind):
    assert_said_is_true(kind, 200, 0.9, 1.1)


@pytest.mark.parametrize("kind", ["polynomial", "fisheye"])
def test_what_a_turn_undoes_is_no_uncertainty(kind):
    """A moved principal point is nearly a turn: boards tell it badly, and pixels do not mind."""
    rng = np.random.default_rng(3)
    views = wide_views((wide_camera(kind, rng),), rng, count=6)
    said = ProjectionUncertainty.of(calibrate_cameras(views, CameraOptions(lens=kind)), "left")
    assert said.middle < 0.7 * said.alone[len(said.v) // 2, len(said.u) // 2]


def test_a_held_aspect_makes_both_focal_lengths_one():
    rng = np.random.default_rng(4)
    views = wide_views((replace(wide_camera("polynomial", rng), fy=850.0, fx=850.0),), rng)
    free = ProjectionUncertainty.of(calibrate_cameras(views), "left")
    tied = calibrate_cameras(views, CameraOptions(aspect=1.0))
    held = ProjectionUncertainty.of(tied, "left", 1.0)
    assert held.corner <= 1.01 * free.corner
    wrong = ProjectionUncertainty.of(tied, "left")
    assert np.nanmax(np.abs(wrong.alone - held.alone)) > 1e-3


def test_more_boards_are_more_certain_and_where_no_ray_is_nothing_is_said():
    rng = np.random.default_rng(7)
    views = wide_views((wide_camera("fisheye", rng),), rng, count=24)
    options = CameraOptions(lens="fisheye")
    learned = [calibrate_cameras(views.select(np.arange(n)), options) for n in (8, 24)]
    few, many = (ProjectionUncertainty.of(found, "left") for found in learned)
    assert many.middle < few.middle
    assert np.nanmedian(many.sigma) < np.nanmedian(few.sigma)
    grid = np.stack(np.meshgrid(few.u, few.v), axis=-1).reshape(-1, 2)
    rays = learned[0].cameras[0].directions(grid)
    assert np.array_equal(np.isnan(few.sigma.ravel()), np.isnan(rays).any(axis=1))
