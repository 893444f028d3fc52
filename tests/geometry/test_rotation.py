"""Rotations: Rodrigues, logarithm, roll-pitch-yaw, the chart of the sphere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.geometry.rotation import (
    move_on_sphere,
    nearest_rotation,
    rotation_about,
    rotation_from_rpy,
    rotation_from_vector,
    rotation_vector_of,
    rotation_vector_slope,
    rpy_of,
    signed_angle,
    skew,
    tangent_basis,
)

EXACT = 1e-12
COORDINATE = st.floats(-1.0, 1.0)
ANGLE = st.floats(-np.pi, np.pi)
UNIT = (
    st.tuples(COORDINATE, COORDINATE, COORDINATE)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 1e-3)
    .map(lambda v: v / np.linalg.norm(v))
)


def exponential(matrix, terms=60):
    """Sum the power series of the matrix exponential."""
    total, term = np.eye(3), np.eye(3)
    for k in range(1, terms):
        term = term @ matrix / k
        total = total + term
    return total


@given(UNIT, ANGLE)
def test_rodrigues_is_the_exponential_of_the_cross_product(axis, angle):
    expected = exponential(angle * skew(axis))
    assert rotation_about(axis, angle) == pytest.approx(expected, abs=EXACT)
    assert rotation_from_vector(angle * axis) == pytest.approx(expected, abs=EXACT)


def test_many_axes_turn_as_each_of_them_alone():
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(4, 1, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    angles = rng.uniform(-3, 3, (4, 5))
    stacked = rotation_about(axes, angles)
    assert stacked.shape == (4, 5, 3, 3)
    assert np.array_equal(stacked[2, 3], rotation_about(axes[2, 0], angles[2, 3]))


@given(UNIT, st.floats(0.0, np.pi))
def test_the_logarithm_undoes_the_exponential(axis, angle):
    rotation = rotation_about(axis, angle)
    vector = rotation_vector_of(rotation)
    assert np.linalg.norm(vector) <= np.pi + EXACT
    assert rotation_from_vector(vector) == pytest.approx(rotation, abs=1e-9)


@pytest.mark.parametrize("gap", [0.0, 1e-15, 1e-9, 9e-7, 1.1e-6, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_the_logarithm_is_exact_near_no_turn_and_near_a_half_turn(gap, seed):
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)
    small = rotation_vector_of(rotation_about(axis, gap))
    assert small == pytest.approx(gap * axis, rel=1e-9, abs=1e-15)
    rotation = rotation_about(axis, np.pi - gap)
    assert rotation_from_vector(rotation_vector_of(rotation)) == pytest.approx(rotation, abs=1e-9)


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3)])
def test_a_half_turn_about_a_frame_axis_keeps_its_axis(axis):
    vector = rotation_vector_of(rotation_about(axis, np.pi))
    assert np.abs(vector) == pytest.approx(np.pi * np.abs(axis), abs=1e-9)


def test_batches_of_vectors_and_matrices_turn_as_each_of_them_alone():
    rng = np.random.default_rng(2)
    vectors = rng.normal(size=(2, 3, 3))
    vectors[0, 1] = 0.0
    rotations, slopes = rotation_from_vector(vectors), rotation_vector_slope(vectors)
    matrices = rng.normal(size=(2, 3, 3, 3))
    nearest = nearest_rotation(matrices)
    assert rotations.shape == slopes.shape == nearest.shape == (2, 3, 3, 3)
    for i in np.ndindex(2, 3):
        assert np.array_equal(rotations[i], rotation_from_vector(vectors[i]))
        assert np.array_equal(slopes[i], rotation_vector_slope(vectors[i]))
        assert nearest[i] == pytest.approx(nearest_rotation(matrices[i]), abs=EXACT)
        assert np.linalg.det(nearest[i]) == pytest.approx(1.0)
    assert np.array_equal(rotations[0, 1], np.eye(3))
    assert np.linalg.det(matrices).min() < 0.0  # or no reflection was in question


@given(UNIT, st.floats(0.0, 6.0), UNIT)
def test_the_slope_of_a_rotation_vector_is_that_of_central_differences(axis, angle, aside):
    vector, h = angle * axis, 1e-5
    before, after = (rotation_from_vector(vector + s * h * aside) for s in (-1.0, 1.0))
    turned = rotation_vector_of(after @ before.T) / (2.0 * h)
    assert rotation_vector_slope(vector) @ aside == pytest.approx(turned, abs=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 9.9e-4, 1.01e-3, 1e-2, 1.0, np.pi, 6.0])
def test_the_slope_of_a_rotation_vector_is_the_mean_of_the_turns_on_the_way(angle):
    """J = integral of exp(s [v]) ds, whose series is the sum of [v]^k / (k + 1)!."""
    vector = angle * np.array([0.48, -0.6, 0.64])
    total, term = np.eye(3), np.eye(3)
    for k in range(1, 60):
        term = term @ skew(vector) / (k + 1)
        total = total + term
    assert rotation_vector_slope(vector) == pytest.approx(total, abs=1e-13)


def test_the_parts_of_roll_pitch_yaw_turn_in_urdfs_order():
    x, y, z = np.eye(3)
    assert rotation_from_rpy(0.5 * np.pi, 0, 0) @ y == pytest.approx(z)
    assert rotation_from_rpy(0, 0.5 * np.pi, 0) @ z == pytest.approx(x)
    assert rotation_from_rpy(0.5 * np.pi, 0, 0.5 * np.pi) @ y == pytest.approx(z)
    assert rotation_from_rpy(0, 0.5 * np.pi, 0.5 * np.pi) @ z == pytest.approx(y)


@given(ANGLE, st.floats(-1.57, 1.57), ANGLE)
def test_roll_pitch_and_yaw_are_found_again(roll, pitch, yaw):
    found = rpy_of(rotation_from_rpy(roll, pitch, yaw))
    assert np.cos(found - [roll, pitch, yaw]) == pytest.approx(np.ones(3), abs=EXACT)


@given(ANGLE, st.sampled_from([0.0, 1e-16, 1e-12, 1e-8, 1e-4]), ANGLE)
def test_roll_pitch_and_yaw_are_the_rotation_at_gimbal_lock_too(roll, short, yaw):
    rotation = rotation_from_rpy(roll, 0.5 * np.pi - short, yaw)
    assert rotation_from_rpy(*rpy_of(rotation)) == pytest.approx(rotation, abs=4e-15)


@given(UNIT)
def test_the_tangent_basis_completes_a_right_handed_frame(direction):
    frame = np.column_stack([tangent_basis(direction), direction])
    assert frame.T @ frame == pytest.approx(np.eye(3), abs=EXACT)
    assert np.linalg.det(frame) == pytest.approx(1.0)


@given(UNIT, st.tuples(st.floats(-2, 2), st.floats(-2, 2)).map(np.array))
def test_a_move_on_the_sphere_follows_a_great_circle(direction, step):
    moved, derivative = move_on_sphere(direction, step)
    basis, h = tangent_basis(direction), 1e-6
    axis = np.cross(direction, basis @ step)
    assert moved == pytest.approx(rotation_from_vector(axis) @ direction, abs=1e-10)
    numeric = [
        (move_on_sphere(direction, step + e)[0] - move_on_sphere(direction, step - e)[0]) / (2 * h)
        for e in h * np.eye(2)
    ]
    assert derivative == pytest.approx(np.array(numeric).T, abs=2e-9)


@pytest.mark.parametrize("size", [0.0, 1e-9, 9e-5, 1.1e-4, 1e-3])
def test_the_derivative_on_the_sphere_is_smooth_at_zero(size):
    # At a step t along b1: d = d0 cos t + b1 sin t, and across it b2 sin(t) / t.
    direction = np.array([0.48, -0.6, 0.64])
    basis = tangent_basis(direction)
    derivative = move_on_sphere(direction, np.array([size, 0.0]))[1]
    along = basis[:, 0] * np.cos(size) - direction * np.sin(size)
    across = basis[:, 1] * np.sinc(size / np.pi)
    assert derivative == pytest.approx(np.column_stack([along, across]), abs=1e-11)


@given(UNIT, ANGLE, st.floats(0.1, 10.0))
def test_the_signed_angle_is_the_turn_whatever_the_lengths(axis, angle, length):
    a = tangent_basis(axis)[:, 0]
    b = length * rotation_about(axis, angle) @ a
    difference = signed_angle(a, b, axis) - angle
    assert np.exp(1j * difference) == pytest.approx(1.0, abs=EXACT)
    assert signed_angle(b, a, axis) == pytest.approx(-signed_angle(a, b, axis), abs=EXACT)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1.0, -1.0]))
def test_the_nearest_rotation_is_never_a_reflection(seed, side):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(3, 3))
    matrix[0] *= side
    rotation = nearest_rotation(matrix)
    assert rotation.T @ rotation == pytest.approx(np.eye(3), abs=EXACT)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    # nearer than any rotation a little further on
    turned = [rotation_from_vector(w) @ rotation for w in rng.normal(0.0, 0.1, (10, 3))]
    distance = np.linalg.norm(matrix - rotation)
    assert all(np.linalg.norm(matrix - other) >= distance - EXACT for other in turned)


def test_the_nearest_rotation_to_a_rotation_is_itself_even_when_flattened():
    rotation = rotation_from_rpy(0.3, -0.2, 2.0)
    assert nearest_rotation(3.0 * rotation) == pytest.approx(rotation, abs=EXACT)
    flat = rotation @ np.diag([2.0, 1.0, 0.0])
    assert nearest_rotation(flat) == pytest.approx(rotation, abs=EXACT)
