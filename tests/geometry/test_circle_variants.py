"""Circles with known angles, circles against outliers, circles through triples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.geometry.circle import Circle
from nico_selfmodel.geometry.circle_variants import (
    circle_with_angles,
    circles_through,
    robust_circle,
)
from nico_selfmodel.geometry.rotation import tangent_basis

SEED = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("count", [3, 26])
@given(seed=SEED, arc_deg=st.floats(10.0, 300.0), side=st.sampled_from([1.0, -1.0]))
def test_known_angles_give_the_circle_itself_with_its_axis(
    make_arc, assert_same_circle, count, seed, arc_deg, side
):
    truth = make_arc(seed, count, arc_deg)
    circle = circle_with_angles(truth.points, side * truth.angles + 0.7)
    assert_same_circle(circle, truth, 1e-11)
    assert np.sign(circle.normal @ truth.normal) == side
    assert np.degrees(circle.arc) == pytest.approx(arc_deg)


@pytest.mark.slow
def test_known_angles_cut_the_error_of_short_arcs_in_their_plane_to_a_fifth(make_arc):
    errors, in_all = [], []
    for seed in range(100):
        arc = make_arc(seed, 26, 30.0, sigma=0.001)
        plane = tangent_basis(arc.normal).T
        fits = Circle.from_points(arc.points), circle_with_angles(arc.points, arc.angles)
        errors.append([np.linalg.norm(plane @ (fit.center - arc.center)) for fit in fits])
        in_all.append([np.linalg.norm(fit.center - arc.center) for fit in fits])
    free, known = np.median(errors, axis=0)
    assert known < 0.0025
    assert known < 0.2 * free
    # Across the plane they tell nothing.
    free, known = np.sqrt(np.mean(np.square(in_all), axis=0))
    assert 0.6 < known / free < 0.9


@pytest.mark.slow
def test_the_covariance_with_angles_is_the_spread_of_two_hundred_fits(make_arc, parameter_errors):
    errors, predicted, consistency = [], [], []
    for seed in range(200):
        truth = make_arc(seed, 26, 60.0, sigma=0.001)
        circle = circle_with_angles(truth.points, truth.angles)
        error = parameter_errors(circle, truth)
        errors.append(error)
        predicted.append(np.diag(circle.covariance))
        consistency.append(error @ np.linalg.solve(circle.covariance, error) / 6.0)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(predicted, axis=0))
    assert np.all((ratio > 0.8) & (ratio < 1.2)), ratio
    assert 0.85 < np.mean(consistency) < 1.15


def test_angles_that_do_not_move_are_refused(make_arc):
    points = make_arc(1, 6, 90.0, sigma=1e-4).points
    for angles in (np.full(6, np.nan), np.zeros(5)):
        with pytest.raises(ValueError, match=r"angles must be finite and of shape \(6,\)"):
            circle_with_angles(points, angles)
    with pytest.raises(ValueError, match="three different angles"):
        circle_with_angles(points, np.zeros(6))
    with pytest.raises(ValueError, match="three different angles"):
        circle_with_angles(points, [0.0, 0.3] * 3)


def test_a_quarter_of_gross_outliers_changes_nothing(make_arc):
    clean_error, robust_error = [], []
    for seed in range(30):
        arc = make_arc(seed, 26, 150.0, sigma=0.0005)
        rng = np.random.default_rng(1000 + seed)
        bad = rng.permutation(26) < 7
        away = rng.normal(0.0, 0.08, (26, 3)) * bad[:, None]
        points = arc.points + away
        circle, inliers = robust_circle(points, rng)
        clean = Circle.from_points(arc.points[~bad])
        gross = np.linalg.norm(clean.residuals_to(points), axis=1) > 0.005
        assert not np.any(inliers & gross)
        assert np.sum(inliers & ~bad) >= 17
        clean_error.append(np.linalg.norm(clean.center - arc.center))
        robust_error.append(np.linalg.norm(circle.center - arc.center))
    assert np.median(robust_error) < 1.5 * np.median(clean_error)
    assert np.max(robust_error) < 0.003


def test_without_noise_the_outliers_are_named_exactly(make_arc, assert_same_circle):
    truth = make_arc(5, 20, 100.0)
    points = truth.points.copy()
    points[[3, 8, 9]] += 0.01
    circle, inliers = robust_circle(points, np.random.default_rng(0))
    assert np.flatnonzero(~inliers).tolist() == [3, 8, 9]
    assert_same_circle(circle, truth, 1e-11)


def test_points_counted_twice_do_not_confuse_the_triples(make_arc, assert_same_circle):
    truth = make_arc(6, 5, 120.0)
    points = np.repeat(truth.points, 4, axis=0)
    circle, inliers = robust_circle(points, np.random.default_rng(0), draws=50)
    assert inliers.all()
    assert_same_circle(circle, truth, 1e-11)


def test_few_points_are_used_as_they_are(make_arc):
    points = make_arc(7, 5, 90.0, sigma=0.001).points
    circle, inliers = robust_circle(points, np.random.default_rng(0), sigma=0.001)
    assert inliers.tolist() == [True] * 5
    assert circle.center.tolist() == Circle.from_points(points).center.tolist()


def test_the_same_seed_draws_the_same_circle(make_arc):
    points = make_arc(8, 26, 60.0, sigma=0.002).points
    first, second = (robust_circle(points, np.random.default_rng(4), draws=10) for _ in range(2))
    assert first[0].center.tolist() == second[0].center.tolist()
    assert first[1].tolist() == second[1].tolist()


def test_a_small_triple_among_large_ones_is_judged_by_itself():
    sizes = np.array([1e3, 1e3, 1e-6])
    triples = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) * sizes[:, None, None]
    assert circles_through(triples)[2] == pytest.approx(sizes / np.sqrt(2.0))


@given(seed=SEED)
def test_a_circle_passes_through_its_three_points_and_none_through_three_in_line(seed):
    rng = np.random.default_rng(seed)
    triples = rng.normal(size=(4, 3, 3))
    triples[2] = rng.normal(size=3) + np.outer([0.0, 1.0, 2.5], rng.normal(size=3))
    triples[3, 1] = triples[3, 0]
    centers, normals, radii = circles_through(triples)
    assert np.isnan(radii).tolist() == [False, False, True, True]
    for triple, center, normal, radius in zip(
        triples[:2], centers[:2], normals[:2], radii[:2], strict=True
    ):
        assert np.linalg.norm(triple - center, axis=1) == pytest.approx([radius] * 3, rel=1e-6)
        assert (triple - center) @ normal == pytest.approx(np.zeros(3), abs=1e-9 * radius)
