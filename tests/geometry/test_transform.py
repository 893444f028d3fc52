"""Rigid transforms, alone and stacked."""

import numpy as np
import pytest

from nico_selfmodel.geometry.rotation import rotation_about
from nico_selfmodel.geometry.transform import apply, inverse, transform


@pytest.fixture
def motions():
    rng = np.random.default_rng(4)
    axis = np.array([0.6, 0.0, 0.8])
    return transform(rotation_about(axis, rng.uniform(-3, 3, 5)), rng.normal(size=(5, 3)))


def test_the_inverse_undoes_a_transform(motions):
    assert inverse(motions) @ motions == pytest.approx(np.tile(np.eye(4), (5, 1, 1)), abs=1e-14)
    assert inverse(motions) == pytest.approx(np.linalg.inv(motions), abs=1e-14)


def test_points_move_as_homogeneous_points_do(motions):
    points = np.random.default_rng(5).normal(size=(5, 3))
    homogeneous = np.column_stack([points, np.ones(5)])
    expected = np.einsum("nij,nj->ni", motions, homogeneous)[:, :3]
    assert apply(motions, points) == pytest.approx(expected, abs=1e-14)
    assert apply(motions[0], points[0]) == pytest.approx(expected[0], abs=1e-14)


def test_one_transform_moves_many_points_and_many_move_one(motions):
    points = np.random.default_rng(6).normal(size=(7, 3))
    one_by_one = [apply(motions[1], p) for p in points]
    assert apply(motions[1], points) == pytest.approx(np.array(one_by_one))
    assert apply(motions, points[0]).shape == (5, 3)
    assert apply(motions[:, None], points).shape == (5, 7, 3)


def test_a_rotation_and_many_translations_make_many_transforms():
    stacked = transform(np.eye(3), np.arange(6.0).reshape(2, 3))
    assert stacked.shape == (2, 4, 4)
    assert stacked[1].tolist() == [[1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 1, 5], [0, 0, 0, 1]]
