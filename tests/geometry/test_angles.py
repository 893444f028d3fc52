"""Differences of angles and of rotation vectors are the same modulo a turn."""

import numpy as np
import pytest

from nico_selfmodel.geometry.angles import nearest_rotation_vector, nearest_turn
from nico_selfmodel.geometry.rotation import rotation_from_vector


def test_an_angle_comes_within_half_a_turn_of_another():
    assert nearest_turn(np.radians(359.7), 0.0) == pytest.approx(np.radians(-0.3))
    assert nearest_turn([7.0, -7.0], [0.1, -0.1]) == pytest.approx(
        [7.0 - 2.0 * np.pi, 2.0 * np.pi - 7.0]
    )
    # A joint behind a gear of 1.6 is where it was after 1.6 turns of its encoder.
    assert nearest_turn(3.2 * np.pi + 0.01, 0.0, 3.2 * np.pi) == pytest.approx(0.01)
    assert nearest_turn(2.0 * np.pi, 0.0, 4.8 * np.pi) == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize("seed", range(5))
def test_a_rotation_vector_on_another_branch_is_the_same_rotation(seed):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    before = (np.pi - 0.01) * axis
    turned = -(np.pi - 0.02) * (axis + 0.001 * rng.normal(size=3))
    near = nearest_rotation_vector(turned, before)
    assert np.linalg.norm(near - before) < 0.05
    assert rotation_from_vector(near) == pytest.approx(rotation_from_vector(turned))
    assert nearest_rotation_vector(before, before) == pytest.approx(before)


def test_no_turn_is_a_whole_turn_about_any_axis():
    near = nearest_rotation_vector(np.zeros(3), [0.0, 6.2, 0.0])
    assert near == pytest.approx([0.0, 2.0 * np.pi, 0.0])
    assert nearest_rotation_vector(np.zeros(3), np.zeros(3)) == pytest.approx(np.zeros(3))
