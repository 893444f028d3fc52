"""Covariance, correlation, rank, and the directions that the data do not see."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from nico_selfmodel.optimization.uncertainty import (
    UNKNOWN_SIGMA,
    Uncertainty,
    covariance_told_by,
    root_of,
)

NAMES = ("a", "b", "c", "d")


def analyse(jacobian, natural=None, squared=None, names=NAMES):
    m, k = jacobian.shape
    natural = np.full(k, 1e3) if natural is None else np.asarray(natural, float)
    return Uncertainty.from_jacobian(
        names, jacobian, natural, m - k if squared is None else squared, m
    )


def regression(seed, m=30):
    return np.random.default_rng(seed).normal(size=(m, 4)) * [1.0, 10.0, 0.1, 1.0]


@given(seed=st.integers(0, 2**32 - 1), factor=st.floats(0.1, 10.0))
def test_it_is_the_closed_form_of_linear_regression(seed, factor):
    a = regression(seed)
    found = analyse(a, natural=[1e3, 1e2, 1e4, 1e3], squared=26 * factor**2)
    expected = factor**2 * np.linalg.inv(a.T @ a)
    assert found.variance_factor == pytest.approx(factor**2)
    assert found.rank == 4
    assert found.unobservable == ()
    assert found.covariance == pytest.approx(expected, rel=1e-8)
    assert found.sigma == pytest.approx(np.sqrt(np.diag(expected)), rel=1e-8)
    assert np.diag(found.correlation) == pytest.approx(np.ones(4))
    assert found.correlation == pytest.approx(
        expected / np.sqrt(np.outer(np.diag(expected), np.diag(expected))), abs=1e-9
    )


def test_the_covariance_is_the_spread_of_two_thousand_regressions():
    rng, a = np.random.default_rng(1), regression(2)
    noise = rng.normal(0.0, 2.0, (30, 2000))
    estimates = np.linalg.lstsq(a, noise, rcond=None)[0]
    rest = noise - a @ estimates
    found = [analyse(a, squared=float(r @ r)) for r in rest.T[:200]]
    sigma = np.sqrt(np.mean([f.sigma**2 for f in found], axis=0))
    assert estimates.std(axis=1) / sigma == pytest.approx(np.ones(4), abs=0.06)


def scattered(a, squares, expected=None):
    """Analyse a regression by the squares of its residuals, each over one less its leverage."""
    q = np.linalg.qr(a)[0]
    scatter = squares / (1.0 - np.sum(q * q, axis=1))
    m, k = a.shape
    expected = np.full(m, squares.sum() / (m - k)) if expected is None else expected
    told = (scatter, expected)
    return Uncertainty.from_jacobian(NAMES, a, np.full(k, 1e3), squares.sum(), m, told)


@given(seed=st.integers(0, 2**32 - 1), variance=st.floats(0.01, 100.0))
def test_residuals_that_scatter_alike_are_those_without_a_scatter_of_their_own(seed, variance):
    a = regression(seed)
    told = [np.full(30, variance)] * 2
    found = Uncertainty.from_jacobian(NAMES, a, np.full(4, 1e3), 1.0, 30, told)
    assert_allclose(found.covariance, variance * np.linalg.inv(a.T @ a), rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("alike", [True, False])
def test_the_covariance_is_the_spread_of_regressions_whose_rows_scatter_as_they_like(alike):
    rng, a = np.random.default_rng(4), regression(5, 400)
    size = np.abs(a[:, 1]) / 10.0  # the farther out, the less sharp, as at a picture's edge
    noise = rng.normal(size=(400, 2000)) * (np.ones(400) if alike else size)[:, None]
    estimates = np.linalg.lstsq(a, noise, rcond=None)[0]
    rest = noise - a @ estimates
    found = [scattered(a, r * r, None if alike else size**2) for r in rest.T[:100]]
    spread = estimates.std(axis=1)
    assert spread / np.mean([f.sigma for f in found], axis=0) == pytest.approx(1.0, abs=0.1)
    nees = [x @ np.linalg.solve(f.covariance, x) for x, f in zip(estimates.T, found, strict=False)]
    assert np.mean(nees) == pytest.approx(4.0, abs=0.9)
    plain = [analyse(a, squared=float(r @ r)).sigma[1] for r in rest.T[:100]]
    assert (spread[1] / np.mean(plain) > 1.4) != alike
    # What nobody expects they say by themselves, in part.
    own = np.mean([scattered(a, r * r).sigma[1] for r in rest.T[:100]])
    assert (own > 1.05 * np.mean(plain)) != alike


def test_what_residuals_say_counts_where_it_differs_from_what_is_expected_by_more_than_chance():
    """Of rows that scatter alike nothing is left of their own, of others something always."""
    rng, a = np.random.default_rng(9), regression(10, 400)
    rest = rng.normal(size=(200, 400))
    own = [scattered(a, r * r, np.ones(400)).covariance for r in rest]
    alike = np.linalg.inv(a.T @ a)
    assert np.mean([np.allclose(one, alike, rtol=1e-9, atol=0.0) for one in own]) > 0.97
    farther = np.abs(a[:, 1])
    off = [scattered(a, (r * farther) ** 2, np.ones(400)).covariance for r in rest]
    assert not any(np.allclose(one, alike, rtol=1e-9, atol=0.0) for one in off)


def test_residuals_of_nothing_leave_no_doubt():
    a = regression(8)
    found = Uncertainty.from_jacobian(NAMES, a, np.full(4, 1e3), 0.0, 30, [np.zeros(30)] * 2)
    assert (found.rank, found.unobservable) == (4, ())
    assert np.abs(found.covariance).max() == 0.0


def test_what_nothing_determines_stays_so_whatever_rows_scatter_by():
    a = regression(6)
    a[:, 3] = a[:, 0]
    scatter = [np.random.default_rng(7).uniform(0.5, 2.0, 30)] * 2
    found = Uncertainty.from_jacobian(NAMES, a, np.full(4, 1e3), 1.0, 30, scatter)
    assert found.rank == 3
    assert found.unobservable[0].names == ("a", "d")


def test_natural_units_do_not_change_what_is_known():
    a = regression(3)
    one = analyse(a, natural=[1e3] * 4)
    other = analyse(a, natural=[1e2, 1e3, 1e4, 5e2])
    assert other.covariance == pytest.approx(one.covariance, rel=1e-9)


def test_a_direction_that_nothing_determines_is_named():
    a = regression(4)
    a[:, 3] = 2.0 * a[:, 0]  # only d + a / 2 counts
    found = analyse(a, squared=27.0)
    (unobservable,) = found.unobservable
    assert unobservable.names == ("a", "d")
    assert np.abs(unobservable.shares) == pytest.approx(
        np.array([2.0, 1.0]) / np.sqrt(5.0), abs=1e-6
    )
    assert unobservable.shares[0] * unobservable.shares[1] < 0.0
    assert unobservable.sigma == np.inf
    assert found.rank == 3
    assert found.condition > 1e10
    assert np.isinf(found.sigma).tolist() == [True, False, False, True]


def test_what_is_seen_beside_a_unobservable_direction_keeps_its_covariance():
    a = regression(5)
    a[:, 3] = a[:, 0]
    found = analyse(a, squared=26.0)
    expected = np.linalg.inv(a[:, :3].T @ a[:, :3])
    assert found.sigma[1:3] == pytest.approx(np.sqrt(np.diag(expected))[1:3], rel=1e-6)
    assert found.covariance[1:3, 1:3] == pytest.approx(expected[1:3, 1:3], rel=1e-6)
    # along the gauge nothing is invented: the sum a + d is known as a alone would be
    assert np.sum(found.covariance[np.ix_([0, 3], [0, 3])]) == pytest.approx(
        expected[0, 0], rel=1e-6
    )


def test_a_direction_is_unobservable_where_its_sigma_reaches_the_natural_scale():
    a = np.diag([100.0, 100.0, 100.0, 2.0])
    a = np.vstack([a, np.zeros((4, 4))])
    found = analyse(a, natural=[1.0] * 4, squared=4.0)
    (unobservable,) = found.unobservable
    assert unobservable.names == ("d",)
    assert unobservable.sigma == pytest.approx(0.5)
    assert np.isinf(found.sigma).tolist() == [False, False, False, True]
    assert found.covariance[3, 3] == pytest.approx(0.25)  # what is known is known, no better
    assert found.condition == pytest.approx(50.0)
    assert analyse(a, natural=[2.0] * 4, squared=4.0).rank == 4
    assert analyse(a * 10.0, natural=[1.0] * 4, squared=4.0).rank == 4


@pytest.mark.parametrize(("sigma", "open_ways"), [(0.29, 0), (0.31, 1)])
def test_many_that_shift_together_are_unobservable_where_one_of_them_is_off_by_that(
    sigma, open_ways
):
    count, names = 100, tuple(f"p{i}" for i in range(100))
    together = np.full((1, count), 1.0 / count / sigma)  # their mean is known to `sigma`
    apart = 1e4 * (np.eye(count) - 1.0 / count)
    found = analyse(np.vstack([together, apart]), [1.0] * count, squared=1.0, names=names)
    assert len(found.unobservable) == open_ways
    assert found.covariance[0, 0] == pytest.approx(sigma**2, rel=1e-3)


def test_the_worst_direction_comes_first():
    a = np.vstack([np.diag([100.0, 2.0, 0.0, 1.0]), np.zeros((4, 4))])
    found = analyse(a, natural=[1.0] * 4, squared=4.0)
    assert [direction.names for direction in found.unobservable] == [("c",), ("d",), ("b",)]
    assert [d.sigma for d in found.unobservable] == pytest.approx([np.inf, 1.0, 0.5])
    assert found.condition == np.inf


def test_fewer_residuals_than_parameters_leave_directions_unobservable():
    a = regression(6, m=2)
    found = analyse(a, squared=0.0)
    assert np.isnan(found.variance_factor)
    assert found.rank == 2
    assert len(found.unobservable) == 2
    assert {d.sigma for d in found.unobservable} == {np.inf}


def test_without_redundancy_the_sigma_assumed_beforehand_counts():
    a = regression(7, m=4)
    found = Uncertainty.from_jacobian(NAMES, a, np.full(4, 1e6), 0.0, 4)
    assert np.isnan(found.variance_factor)
    assert found.covariance == pytest.approx(np.linalg.inv(a.T @ a), rel=1e-6)


def test_a_unobservable_direction_of_many_equal_shares_still_has_names():
    count = 60
    names = tuple(f"p{i}" for i in range(count))
    a = np.eye(count) - 1.0 / count  # unobservable to a common change of all
    found = analyse(np.vstack([a, a]) * 1e3, natural=[1.0] * count, names=names)
    (unobservable,) = found.unobservable
    assert set(unobservable.names) == set(names)
    assert np.isinf(found.sigma).all()


def test_a_small_share_of_what_nothing_determines_is_still_unknown():
    null = np.array([0.99, 0.1, 0.0, 0.0])
    null /= np.linalg.norm(null)
    a = regression(8) @ (np.eye(4) - np.outer(null, null))
    found = analyse(a, squared=26.0)
    assert found.unobservable[0].sigma == np.inf
    assert np.isinf(found.sigma).tolist() == [True, True, False, False]


def test_what_nothing_determines_is_unknown_to_whoever_uses_the_covariance():
    a = regression(4)
    a[:, 3] = 2.0 * a[:, 0]
    found = analyse(a, natural=[1.0, 2.0, 3.0, 0.5], squared=26.0)
    way = np.array([2.0, 0.0, 0.0, -1.0])
    # In natural units (1 and 0.5) it is as much a's as d's.
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(UNKNOWN_SIGMA, rel=1e-3)
    assert np.sqrt(found.covariance[3, 3]) == pytest.approx(UNKNOWN_SIGMA * 0.5, rel=1e-3)
    # Inverted, it tells what the data tell, and of the open way that it is no larger than that.
    information = np.linalg.inv(found.covariance)
    seen = np.array([[1.0, 0.0, 0.0, 2.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    assert seen @ information @ seen.T == pytest.approx(seen @ a.T @ a @ seen.T, rel=1e-3)
    assert way @ information @ way == pytest.approx((2.0 / UNKNOWN_SIGMA) ** 2, rel=1e-3)
    # What an observation adds afterwards is all that is known of it then.
    along = np.outer(way, way) / (way @ way) / 0.01**2
    after = np.linalg.inv(information + along)
    assert np.sqrt(way @ after @ way / (way @ way)) == pytest.approx(0.01, rel=1e-2)


def test_a_small_share_in_what_is_hardly_known_is_in_the_sigma():
    turn = 0.05  # of `a` in a direction that is known to 2 natural units
    basis = np.eye(4)
    basis[0, [0, 3]] = np.cos(turn), -np.sin(turn)
    basis[3, [0, 3]] = np.sin(turn), np.cos(turn)
    a = np.vstack([np.diag([1e3, 1e3, 1e3, 0.5]) @ basis, np.zeros((4, 4))])
    found = analyse(a, natural=[1.0] * 4, squared=4.0)
    assert found.unobservable[0].names == ("d",)
    assert found.sigma[0] == pytest.approx(2.0 * np.sin(turn), rel=1e-3)
    assert found.sigma[0] == pytest.approx(np.sqrt(found.covariance[0, 0]))


def test_a_share_in_what_is_as_good_as_undetermined_is_unknown():
    share = 1e-3
    basis = np.eye(4)
    basis[0, [0, 3]] = np.sqrt(1.0 - share**2), -share
    basis[3, [0, 3]] = share, np.sqrt(1.0 - share**2)
    a = np.vstack([np.diag([1e3, 1e3, 1e3, 1e-4]) @ basis, np.zeros((4, 4))])
    found = analyse(a, natural=[1.0] * 4, squared=4.0)
    assert np.isinf(found.sigma).tolist() == [True, False, False, True]


def test_what_follows_from_the_parameters_is_unknown_where_an_open_way_moves_it():
    a = regression(4)
    a[:, 3] = 2.0 * a[:, 0]
    found = analyse(a, squared=26.0)
    assert found.sigma_of(np.array([1.0, 0.0, 0.0, 0.0])) == np.inf
    told = np.array([1.0, 0.0, 0.0, 2.0])  # what the data tell of the two
    assert found.sigma_of(told) == pytest.approx(np.sqrt(told @ found.covariance @ told))
    assert found.sigma_of(told) < 1.0


def test_parameters_may_be_declared_unobservable_from_outside():
    seen, natural = analyse(regression(9)), np.array([1.0, 2.0, 3.0, 4.0])
    found = seen.with_unobservable(("b", "d"), natural)
    assert np.isinf(found.sigma).tolist() == [False, True, False, True]
    assert found.sigma[[0, 2]].tolist() == seen.sigma[[0, 2]].tolist()
    assert found.rank == seen.rank - 1
    assert found.unobservable[-1].names == ("b", "d")
    assert np.linalg.norm(found.unobservable[-1].shares) == pytest.approx(1.0)
    assert seen.unobservable == ()
    assert np.diag(found.covariance - seen.covariance) == pytest.approx([0.0, 4.0, 0.0, 16.0])
    assert np.isinf([found.sigma_of(row) for row in np.eye(4)]).tolist() == [0, 1, 0, 1]
    again = found.with_unobservable(("d",), natural)  # another direction names it already
    assert len(again.unobservable) == 1
    assert again.rank == found.rank


def test_what_an_information_does_not_tell_is_no_part_of_what_is_known():
    size = np.array([1.0, 1e3, 1e-3, 1.0])
    told = np.random.default_rng(10).normal(size=(30, 3)) * size[:3]
    rows = np.column_stack([told, np.zeros(30)])  # of the last parameter nothing
    found = covariance_told_by(rows.T @ rows)
    assert_allclose(found[:3, :3], np.linalg.inv(told.T @ told), rtol=1e-6)
    assert found[3, 3] > 1e8
    same = np.column_stack([told, told[:, 0]])  # of a sum, not of its parts
    found = covariance_told_by(same.T @ same)
    way = np.array([1.0, 0.0, 0.0, -1.0])
    assert way @ found @ way > 1e6 * np.linalg.inv(told.T @ told)[0, 0]
    added = np.array([1.0, 0.0, 0.0, 1.0])
    assert added @ found @ added > 0.0


def test_a_covariance_has_its_root_whatever_units_it_is_in():
    rng = np.random.default_rng(3)
    spread = rng.normal(size=(6, 6))
    size = np.array([1e-5, 1e-4, 1e-3, 1.0, 1e2, 7e3])
    covariance = (spread @ spread.T) * np.outer(size, size)
    again = root_of(covariance) @ root_of(covariance).T
    assert_allclose(again / np.outer(size, size), spread @ spread.T, rtol=1e-9)


def test_what_is_known_for_sure_has_no_part_in_a_root():
    covariance = np.diag([4.0, 0.0, 1e-12])
    assert_allclose(root_of(covariance) @ root_of(covariance).T, covariance, rtol=1e-9)
    assert root_of(covariance).shape == (3, 2)
    assert root_of(np.zeros((0, 0))).shape == (0, 0)
