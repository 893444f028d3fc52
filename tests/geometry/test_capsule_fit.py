"""Capsules around points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.solids.capsule_fit import fit_capsule, fit_capsules
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids


def on_capsule(radius, length, vector, center, rng, count=1500):
    """Return points on a capsule's surface. Shape (count, 3)."""
    way = rng.standard_normal((count, 3))
    way *= radius / np.linalg.norm(way, axis=1, keepdims=True)
    half = 0.5 * length
    share = rng.random(count) < length / (length + 2.0 * radius)
    aside = radius * way[:, :2] / np.linalg.norm(way[:, :2], axis=1, keepdims=True)
    along = rng.uniform(-half, half, count)
    side = np.column_stack([aside, along])
    ends = way + np.sign(way[:, 2:]) * [0.0, 0.0, half]
    points = np.where(share[:, None], side, ends)
    return points @ rotation_from_vector(vector).T + center


@pytest.mark.parametrize("seed", range(4))
def test_points_on_a_capsule_give_that_capsule(seed):
    rng = np.random.default_rng(seed)
    points = on_capsule(0.05, 0.12, rng.standard_normal(3), rng.standard_normal(3), rng)
    found = fit_capsule(points)
    assert found.size == pytest.approx((0.05, 0.12), rel=0.05)
    assert np.abs(found.distance(points)).max() < 4e-3


@pytest.mark.slow
@given(arrays(float, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-1.0, 1.0)))
def test_no_point_is_outside_of_its_capsule(points):
    assert fit_capsule(points).distance(points).max() < 1e-9


@pytest.mark.slow
def test_a_cross_takes_two_capsules_and_a_ball_one():
    rng = np.random.default_rng(0)
    bar = on_capsule(0.02, 0.3, np.zeros(3), np.zeros(3), rng)
    cross = np.concatenate([bar, bar @ rotation_from_vector([np.pi / 2, 0.0, 0.0]) + [0, 0, 0.15]])
    found = fit_capsules(cross, 4)
    assert len(found) >= 2
    assert distance_to_solids(found, cross)[0].max() < 1e-9
    deep = [-distance_to_solids(one, cross)[0].mean() for one in ((fit_capsule(cross),), found)]
    assert deep[1] < 0.5 * deep[0]
    ball = on_capsule(0.05, 1e-3, np.zeros(3), np.zeros(3), rng)
    assert len(fit_capsules(ball, 4)) == 1


def test_half_of_a_surface_is_held_as_well():
    rng = np.random.default_rng(1)
    points = on_capsule(0.06, 0.1, np.zeros(3), np.zeros(3), rng)
    shell = points[points[:, 0] > 0.0]
    found = fit_capsules(shell, 4)
    assert distance_to_solids(found, shell)[0].max() < 1e-9
    assert -distance_to_solids(found, shell)[0].mean() < 0.012


def test_bad_points_and_no_capsules_are_refused():
    with pytest.raises(ValueError, match="point"):
        fit_capsule(np.zeros((0, 3)))
    with pytest.raises(ValueError, match="finite"):
        fit_capsule([[0.0, np.nan, 0.0]])
    with pytest.raises(ValueError, match="most must be 1 or more, got 0"):
        fit_capsules(np.zeros((5, 3)), 0)
    assert isinstance(fit_capsule([[0.1, 0.2, 0.3]]), Solid)
