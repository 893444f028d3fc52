"""The lens: its derivatives, where it folds the image, and its inverse up to there."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras import lens

NO_TANGENT = np.zeros(2)
NICO = np.array([-0.28, 0.09, -0.012])


def coefficients(*largest):
    """Return a strategy of lens coefficients, in steps of a thousandth of the largest ones."""
    whole = [st.integers(-1000, 1000)] * len(largest)
    return st.tuples(*whole).map(lambda parts: np.array(parts) * largest / 1000.0)


RADIAL = coefficients(0.5, 0.3, 0.1)
TANGENTIAL = coefficients(5e-3, 5e-3)
SEED = st.integers(0, 2**32 - 1)


def disc(radius, seed=0, count=40):
    """Return points of a disc, its rim included. Shape (2, count)."""
    rng = np.random.default_rng(seed)
    r, angle = radius * np.sqrt(rng.random(count)), rng.uniform(0.0, 2.0 * np.pi, count)
    r[0] = radius
    return r * np.stack([np.cos(angle), np.sin(angle)])


def within(k, share):
    """Return a radius inside the part of the lens that does not fold, at most 2."""
    return share * min(lens.largest_radius(k), 2.0)


def test_distortion_is_browns_formula_in_opencvs_signs():
    x, y, k, p = 0.3, -0.4, np.array([0.1, -0.2, 0.4]), np.array([0.01, -0.02])
    s = 1.0 + 0.1 * 0.25 - 0.2 * 0.25**2 + 0.4 * 0.25**3
    expected = [
        x * s + 2.0 * 0.01 * x * y - 0.02 * (0.25 + 2.0 * x * x),
        y * s + 0.01 * (0.25 + 2.0 * y * y) - 2.0 * 0.02 * x * y,
    ]
    assert lens.distort(np.array([x, y]), k, p) == pytest.approx(expected, abs=1e-15)


@given(k=RADIAL, p=TANGENTIAL, seed=SEED)
def test_the_slopes_are_those_of_central_differences(k, p, seed):
    at, h = disc(1.0, seed), 1e-5
    numeric = [
        (lens.distort(at + e[:, None], k, p) - lens.distort(at - e[:, None], k, p)) / (2.0 * h)
        for e in h * np.eye(2)
    ]
    slopes = lens.distortion_slopes(at, k, p)
    assert slopes == pytest.approx(np.stack(numeric, axis=1), abs=1e-8)
    assert np.array_equal(slopes[0, 1], slopes[1, 0])


@given(k=RADIAL, p=TANGENTIAL, seed=SEED)
def test_distortion_is_linear_in_its_coefficients(k, p, seed):
    at = disc(1.2, seed)
    bent = at + np.einsum("acn,c->an", lens.bend(at, k, p)[2], np.concatenate([k, p]))
    assert lens.distort(at, k, p) == pytest.approx(bent, abs=1e-13)


def test_points_may_have_any_leading_shape():
    at, p = disc(0.5, count=6), np.array([1e-3, 2e-3])
    block = at.reshape(2, 3, 2)
    assert np.array_equal(lens.distort(block, NICO, p), lens.distort(at, NICO, p).reshape(2, 3, 2))
    assert lens.distortion_slopes(block, NICO, p).shape == (2, 2, 3, 2)
    assert lens.bend(block, NICO, p)[2].shape == (2, 5, 3, 2)


@given(k=RADIAL)
def test_up_to_the_largest_radius_the_image_grows_and_there_it_turns_back(k):
    limit = lens.largest_radius(k)
    r = np.linspace(0.0, min(limit, 5.0), 200)[:-1]
    slope = 1.0 + 3.0 * k[0] * r**2 + 5.0 * k[1] * r**4 + 7.0 * k[2] * r**6
    assert (slope > 0.0).all()
    if np.isfinite(limit):
        across = limit * (1.0 + np.array([-1e-4, 1e-4]))
        terms = [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2]]
        before, after = np.polynomial.Polynomial(terms)(across**2)
        assert before > after - 1e-9


@pytest.mark.parametrize(
    ("k", "limit"),
    [
        ((-0.28, 0.0, 0.0), 1.0 / np.sqrt(0.84)),
        ((0.0, -0.2, 0.0), 1.0),
        ((0.0, 0.0, -1.0 / 7.0), 1.0),
        ((0.1, 0.0, 0.0), np.inf),
        ((0.0, 0.0, 0.0), np.inf),
        ((0.3, 0.2, 0.1), np.inf),
    ],
)
def test_the_largest_radius_of_simple_lenses_is_known(k, limit):
    assert lens.largest_radius(np.array(k)) == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize("k", [(-0.28, 1e-15, 0.0), (-0.28, 1e-18, 0.0), (-0.28, 0.0, 1e-100)])
def test_a_coefficient_that_is_next_to_nothing_does_not_move_the_fold(k):
    assert lens.largest_radius(np.array(k)) == pytest.approx(1.0 / np.sqrt(0.84), rel=1e-6)


@given(k=RADIAL, p=TANGENTIAL, seed=SEED)
def test_undistortion_undoes_distortion(k, p, seed):
    radius = within(k, 0.9)
    # Where radial distortion comes near to folding, a little tangential one does fold the image.
    r2 = np.linspace(0.0, radius, 100) ** 2
    slope = 1.0 + r2 * (3.0 * k[0] + r2 * (5.0 * k[1] + r2 * 7.0 * k[2]))
    assume(slope.min() > 0.15)
    ideal = disc(radius, seed)
    # Where the radial slope all but vanishes, tangential distortion folds the image as well.
    radius = np.linspace(0.0, within(k, 0.9), 50) ** 2
    assume((1.0 + radius * (3.0 * k[0] + radius * (5.0 * k[1] + radius * 7.0 * k[2])) > 0.1).all())
    bent = lens.distort(ideal, k, p)
    kept = lens.within_fold(bent, k)
    found = lens.undistort(bent[:, kept], k, p)
    assert lens.distort(found, k, p) == pytest.approx(bent[:, kept], abs=1e-13)
    assert found == pytest.approx(ideal[:, kept], abs=1e-9)


@given(k=RADIAL, share=st.floats(0.0, 0.9999), seed=SEED)
def test_without_tangential_distortion_all_the_disc_comes_back(k, share, seed):
    ideal = disc(within(k, share), seed)
    bent = lens.distort(ideal, k, NO_TANGENT)
    assert lens.within_fold(bent, k).all()
    assert lens.undistort(bent, k, NO_TANGENT) == pytest.approx(ideal, abs=1e-9)


def test_tangential_distortion_alone_is_undone():
    ideal, p = disc(1.0), np.array([3e-3, -2e-3])
    bent = lens.distort(ideal, np.zeros(3), p)
    assert np.abs(bent - ideal).max() > 1e-3
    assert lens.undistort(bent, np.zeros(3), p) == pytest.approx(ideal, abs=1e-14)


def test_a_pinhole_needs_no_undistortion_and_gives_a_copy():
    at = disc(30.0)
    found = lens.undistort(at, np.zeros(3), NO_TANGENT)
    assert np.array_equal(found, at)
    assert not np.shares_memory(found, at)


def test_what_was_not_seen_stays_so_and_the_rest_does_not_mind():
    ideal = disc(1.0, count=5)
    bent = lens.distort(ideal, NICO, NO_TANGENT)
    bent[:, 2] = np.nan
    found = lens.undistort(bent, NICO, NO_TANGENT)
    assert np.isnan(found[:, 2]).all()
    kept = [0, 1, 3, 4]
    assert found[:, kept] == pytest.approx(ideal[:, kept], abs=1e-14)
    assert lens.within_fold(bent, NICO).tolist() == [True, True, False, True, True]
    assert np.isnan(lens.undistort(np.full((2, 3), np.nan), NICO, NO_TANGENT)).all()
    assert lens.undistort(np.zeros((2, 0)), NICO, NO_TANGENT).shape == (2, 0)


def test_points_beyond_the_fold_are_refused_and_counted():
    k = np.array([-0.28, 0.0, 0.0])
    limit = lens.largest_radius(k)
    rim = limit * (1.0 + k[0] * limit**2)
    at = np.array([[0.0, rim * 1.001, -2.0 * rim], [0.0, 0.0, 0.0]])
    assert lens.within_fold(at, k).tolist() == [True, False, False]
    with pytest.raises(ModelError, match="2 of 3 points lie outside the radius where the lens"):
        lens.undistort(at, k, NO_TANGENT)


def test_a_lens_that_cannot_be_inverted_says_so():
    outlying = np.array([[0.5, -0.3, 0.2], [0.4, 0.6, -0.5]])
    with pytest.raises(ModelError, match="could not be inverted: its coefficients are not plausi"):
        lens.undistort(outlying, np.zeros(3), np.array([3.0, -2.0]))
