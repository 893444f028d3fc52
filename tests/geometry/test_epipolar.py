"""Two views of the same points: eight-point algorithm, the four poses, lines and distances."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from nico_selfmodel.geometry.epipolar import (
    RelativePose,
    eight_point,
    epipolar_distances,
    epipolar_lines,
    essential,
    homogeneous,
    poses_of_essential,
    two_view_depths,
)
from nico_selfmodel.geometry.rotation import rotation_from_vector, skew

SEED = st.integers(0, 2**32 - 1)


def two_views(seed, count=30, flat=False):
    """Return R, t and the same points seen from both views, with their depths in each."""
    rng = np.random.default_rng(seed)
    turn = rng.normal(0.0, 0.2, 3)
    # Turned and moved by more, the second view has points behind it.
    rotation = rotation_from_vector(turn * min(1.0, 0.5 / np.linalg.norm(turn)))
    translation = rng.normal(size=3) * [0.1, 0.1, 0.03]
    depth = rng.uniform(0.5, 1.5, count)
    aside = rng.uniform(-0.6, 0.6, (count, 2)) * depth[:, None]
    if flat:
        depth = 1.0 + aside @ [0.3, -0.2]
    p = np.column_stack([aside, depth])
    q = p @ rotation.T + translation
    return rotation, translation, p[:, :2] / p[:, 2:], q[:, :2] / q[:, 2:], p[:, 2], q[:, 2]


def misfit(matrix, first, second):
    return np.einsum("ni,ij,nj->n", homogeneous(second), matrix, homogeneous(first))


def like(a, b):
    """Return the difference of two matrices that count up to scale and sign."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    return min(np.abs(a - b).max(), np.abs(a + b).max())


@given(SEED, st.integers(8, 40))
def test_eight_exact_pairs_and_more_give_the_true_matrix(seed, count):
    rotation, translation, first, second, *_ = two_views(seed, count)
    found = eight_point(first, second)
    assert np.linalg.norm(found) == pytest.approx(1.0)
    assert abs(np.linalg.det(found)) < 1e-15
    assert np.abs(misfit(found, first, second)).max() < 1e-9
    if count >= 16:  # eight alone may lie so that they tell it badly
        assert like(found, essential(rotation, translation)) < 1e-8


@given(SEED, st.floats(-6.0, 6.0), st.floats(-1e3, 1e3))
def test_the_units_of_the_points_do_not_matter(seed, power, offset):
    """Pixels or ideal coordinates: the normalisation makes one problem of both."""
    rng = np.random.default_rng(seed)
    _, _, first, second, *_ = two_views(seed)
    first, second = (points + rng.normal(0.0, 1e-4, (30, 2)) for points in (first, second))
    plain = eight_point(first, second)
    scale = 10.0**power
    A = np.diag([scale, scale, 1.0])
    A[:2, 2] = scale * offset
    moved = eight_point(scale * (first + offset), scale * (second + offset))
    assert like(A.T @ moved @ A, plain) < 1e-6


def test_noise_in_pixels_hardly_moves_the_normalised_solution():
    rotation, translation, first, second, *_ = two_views(7, 200)
    rng = np.random.default_rng(0)
    noisy = [
        400.0 * points + [320.0, 240.0] + rng.normal(0.0, 0.2, (200, 2))
        for points in (first, second)
    ]
    K = np.array([[400.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]])
    found = eight_point(*noisy)
    assert like(K.T @ found @ K, essential(rotation, translation)) < 0.02
    assert epipolar_distances(found, *noisy).mean() < 0.3


@pytest.mark.parametrize("count", [8, 9, 54])
def test_points_of_one_plane_are_refused(count):
    _, _, first, second, *_ = two_views(3, count, flat=True)
    with pytest.raises(ValueError, match="do they lie in one plane"):
        eight_point(first, second)
    with pytest.raises(ValueError, match="do they lie in one plane"):
        RelativePose.from_points(first, second)


def test_cameras_at_one_place_are_refused():
    rotation, _, first, *_ = two_views(3)
    turned = homogeneous(first) @ rotation.T
    with pytest.raises(ValueError, match="leave the epipolar geometry open"):
        eight_point(first, turned[:, :2] / turned[:, 2:])


@pytest.mark.parametrize(
    ("first", "second"),
    [((7, 2), (7, 2)), ((9, 2), (8, 2)), ((9, 3), (9, 3)), ((18,), (18,))],
)
def test_too_few_or_unequal_points_are_refused(first, second):
    with pytest.raises(ValueError, match=r"equal shapes \(N, 2\) with N >= 8 are needed, got"):
        eight_point(np.zeros(first), np.zeros(second))


def test_points_that_coincide_are_refused():
    with pytest.raises(ValueError, match="the first points coincide"):
        eight_point(np.ones((9, 2)), np.random.default_rng(0).normal(size=(9, 2)))


@given(SEED)
def test_the_essential_matrix_allows_four_poses_and_one_is_true(seed):
    rotation, translation, *_ = two_views(seed)
    E = essential(rotation, translation)
    assert pytest.approx(E) == skew(translation) @ rotation
    poses = poses_of_essential(3.0 * E)
    assert len(poses) == 4
    unit = translation / np.linalg.norm(translation)
    true = 0
    for R, t in poses:
        assert pytest.approx(np.eye(3), abs=1e-12) == R.T @ R
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert np.linalg.norm(t) == pytest.approx(1.0)
        assert like(essential(R, t), E) < 1e-12
        true += np.allclose(R, rotation, atol=1e-9) and np.allclose(t, unit, atol=1e-9)
    assert true == 1
    apart = [np.abs(a[0] - b[0]).max() + np.abs(a[1] - b[1]).max() for a in poses for b in poses]
    assert np.sum(np.array(apart) < 1e-3) == 4  # each is like itself alone


@given(SEED)
@example(331216)
def test_cheirality_picks_the_true_pose(seed):
    rotation, translation, first, second, *_ = two_views(seed)
    found = RelativePose.from_points(first, second)
    assert found.rotation == pytest.approx(rotation, abs=1e-7)
    assert found.translation == pytest.approx(translation / np.linalg.norm(translation), abs=1e-7)
    assert found.share_in_front == 1.0
    E = essential(rotation, translation)
    shares = [
        (two_view_depths(R, t, first, second) > 0.0).all(axis=1).mean()
        for R, t in poses_of_essential(E)
    ]
    assert sorted(shares)[-2] < 0.5


@given(SEED)
def test_depths_are_those_of_the_points_in_each_view(seed):
    rotation, translation, first, second, *depths = two_views(seed)
    found = two_view_depths(rotation, translation, first, second)
    assert found == pytest.approx(np.column_stack(depths), rel=1e-6)
    assert two_view_depths(rotation, -translation, first, second).max() < 0.0


def test_noise_leaves_the_pose_near_the_true_one():
    rotation, translation, first, second, *_ = two_views(11, 200)
    rng = np.random.default_rng(1)
    found = RelativePose.from_points(
        first + rng.normal(0.0, 5e-4, first.shape), second + rng.normal(0.0, 5e-4, second.shape)
    )
    assert found.share_in_front == 1.0
    assert found.rotation == pytest.approx(rotation, abs=0.01)
    assert found.translation @ translation / np.linalg.norm(translation) > 0.995


@given(SEED)
def test_distances_are_those_from_the_lines(seed):
    rotation, translation, first, second, *_ = two_views(seed)
    E = essential(rotation, translation)
    lines = epipolar_lines(E, first)
    assert np.linalg.norm(lines[:, :2], axis=1) == pytest.approx(np.ones(len(first)))
    assert np.sum(lines * homogeneous(second), axis=1) == pytest.approx(0.0, abs=1e-9)
    # A point pushed off its line by 0.01 is found 0.01 away from it.
    pushed = second + 0.01 * lines[:, :2]
    distances = epipolar_distances(E, first, pushed)
    assert distances[:, 1] == pytest.approx(np.full(len(first), 0.01), abs=1e-9)
    swapped = epipolar_distances(E.T, pushed, first)
    assert distances == pytest.approx(swapped[:, ::-1], abs=1e-12)
