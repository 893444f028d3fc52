"""How sharp corners are, told by all of them."""

import numpy as np
import pytest

from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.corner_noise import by_place, covariates

from .wide_boards import wide_camera, wide_views


@pytest.fixture(scope="module")
def views():
    rng = np.random.default_rng(51)
    return wide_views((wide_camera("fisheye", rng),), rng)


def test_how_corners_scatter_is_found_from_their_squares(views):
    z = covariates(views)
    z = z[np.isfinite(z).all(axis=1)]
    true = np.exp(-4.0 + 1.5 * z[:, 1] - 0.4 * z[:, 2])
    squares = true * np.random.default_rng(52).normal(size=len(z)) ** 2
    assert np.abs(np.log(by_place(squares, z) / true)).mean() < 0.1


@pytest.mark.slow
def test_corners_that_scatter_alike_are_said_to_in_99_cases_of_100(views):
    z, rng = covariates(views), np.random.default_rng(53)
    other = [np.ptp(by_place(rng.normal(size=len(z)) ** 2, z)) > 0.0 for _ in range(200)]
    assert sum(other) <= 7  # binomial, 2: one time of a thousand


@pytest.mark.slow
def test_tails_are_no_difference_of_places(views):
    z, rng = covariates(views), np.random.default_rng(54)
    wide = [
        rng.normal(size=len(z)) * np.where(rng.random(len(z)) < 0.05, 4.0, 1.0) for _ in z[:200]
    ]
    assert sum(np.ptp(by_place(one**2, z)) > 0.0 for one in wide) <= 7


@pytest.mark.parametrize(("share", "told"), [(0.95, False), (1.05, True)])
def test_a_difference_of_places_counts_where_chance_makes_it_once_in_a_hundred(views, share, told):
    z = covariates(views)
    # Chi-square of two numbers, 9.21: half the squared slope, summed over what it acts on.
    slope = share * np.sqrt(2.0 * 9.21 / (len(z) * z[:, 1].var()))
    squares = np.exp(slope * (z[:, 1] - z[:, 1].mean()))
    assert bool(np.ptp(by_place(squares, z)) > 0.0) is told


def test_each_camera_has_its_own_noise():
    rng = np.random.default_rng(55)
    pair = (wide_camera("polynomial", rng), wide_camera("polynomial", rng))
    z = covariates(wide_views(pair, rng))
    true = np.where(z[:, 0] > 0.0, 1.0, 4.0)
    found = by_place(true * rng.normal(size=len(z)) ** 2, z)
    assert np.median(found[z[:, 0] > 0.0]) == pytest.approx(1.0, rel=0.15)
    assert np.median(found[z[:, 1] > 0.0]) == pytest.approx(4.0, rel=0.15)


def test_cameras_of_exact_corners_have_sigmas_of_next_to_nothing():
    rng = np.random.default_rng(56)
    camera = wide_camera("polynomial", rng)
    exact = wide_views((camera,), rng, sigma=0.0)
    found = calibrate_cameras(exact)
    assert found.converged
    assert np.isfinite(found.uncertainty.sigma).all()
    assert found.uncertainty.sigma.max() < 1e-3
