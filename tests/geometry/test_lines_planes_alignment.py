"""Lines, planes and the alignment of matched points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.geometry.alignment import Alignment
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import nearest_rotation, tangent_basis
from nico_selfmodel.model.arm.dh_conversion import common_normal_feet

SEED = st.integers(0, 2**32 - 1)
POINTS = np.random.default_rng(0).normal(size=(5, 3))


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


@given(SEED)
def test_the_common_normal_meets_both_lines_at_right_angles(seed):
    rng = np.random.default_rng(seed)
    a, da, b, db = rng.normal(size=3), unit(rng), rng.normal(size=3), unit(rng)
    foot_a, foot_b = common_normal_feet(a, da, b, db)
    sine = np.linalg.norm(np.cross(da, db))
    tolerance = 1e-13 / sine**2
    assert np.cross(foot_a - a, da) == pytest.approx(np.zeros(3), abs=tolerance)
    assert np.cross(foot_b - b, db) == pytest.approx(np.zeros(3), abs=tolerance)
    assert (foot_b - foot_a) @ np.stack([da, db], axis=1) == pytest.approx([0, 0], abs=tolerance)


@given(SEED)
def test_a_plane_is_recovered_from_points_on_it(seed):
    rng = np.random.default_rng(seed)
    normal, offset = unit(rng), rng.normal()
    points = rng.normal(size=(6, 2)) @ tangent_basis(normal).T - offset * normal
    plane = Plane.from_points(points)
    sign = np.sign(plane.normal @ normal)
    assert plane.normal == pytest.approx(sign * normal, abs=1e-9)
    assert plane.offset == pytest.approx(sign * offset, abs=1e-9)
    assert plane.distance_to(points + 0.2 * plane.normal) == pytest.approx([0.2] * 6, abs=1e-12)


def test_a_plane_is_nearer_to_noisy_points_than_the_true_one():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, 40)
    flat = np.column_stack([x, rng.uniform(-1, 1, 40), rng.normal(0, 0.05, 40)])
    plane = Plane.from_points(flat)
    assert np.sum(plane.distance_to(flat) ** 2) < np.sum(flat[:, 2] ** 2)
    assert abs(plane.normal[2]) > np.cos(0.05)


@given(SEED)
def test_collinear_points_span_no_plane(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=3) + np.outer(rng.uniform(-1, 1, 5), unit(rng))
    with pytest.raises(ValueError, match="collinear"):
        Plane.from_points(points)


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
@pytest.mark.parametrize(
    ("fit", "name"),
    [
        (Plane.from_points, "points"),
        (lambda points: Alignment.from_points(points, POINTS), "source"),
        (lambda points: Alignment.from_points(POINTS, points), "target"),
    ],
)
def test_a_point_that_was_not_measured_is_named_by_its_row(fit, name, wrong):
    points = POINTS.copy()
    points[2, 1] = wrong
    with pytest.raises(ValueError, match=f"{name} must be finite, got .*{wrong}.* in row 2"):
        fit(points)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Plane.from_points(np.ones((5, 3))), "coincide"),
        (lambda: Plane.from_points(np.ones((2, 3))), r"\(n >= 3, 3\), got \(2, 3\)"),
        (lambda: common_normal_feet([0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, -1]), "parallel"),
        (lambda: Alignment.from_points(np.ones((3, 3)), np.ones((4, 3))), r"\(3, 3\), \(4, 3\)"),
        (lambda: Alignment.from_points(np.eye(3)[:2], np.eye(3)[:2]), r"source .*\(n >= 3, 3\)"),
        (lambda: Alignment.from_points(np.ones((4, 3)), np.ones((4, 3))), "not collinear"),
    ],
)
def test_too_few_or_degenerate_points_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@given(SEED, st.booleans())
def test_an_alignment_is_recovered_from_matched_points(seed, with_scale):
    rng = np.random.default_rng(seed)
    scale = rng.uniform(0.2, 5.0) if with_scale else 1.0
    truth = Alignment(nearest_rotation(rng.normal(size=(3, 3))), rng.normal(size=3), scale)
    source = rng.normal(size=(rng.integers(3, 8), 3))
    found = Alignment.from_points(source, truth.apply(source), with_scale=with_scale)
    assert found.rotation == pytest.approx(truth.rotation, abs=1e-8)
    assert found.translation == pytest.approx(truth.translation, abs=1e-8)
    assert found.scale == pytest.approx(truth.scale, rel=1e-8)


def test_points_in_a_plane_and_mirror_images_are_aligned_by_a_rotation():
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.normal(size=(6, 2)), np.zeros(6)])
    solid = rng.normal(size=(6, 3))
    for source in (flat, solid):
        found = Alignment.from_points(source, source * [1.0, 1.0, -1.0])
        assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    assert Alignment.from_points(flat, -flat).apply(flat) == pytest.approx(-flat, abs=1e-12)


def test_noise_does_not_bias_the_scale_as_it_does_a_mean_of_lengths():
    rng = np.random.default_rng(5)
    board = 0.025 * np.array([[x, y, 0.0] for x in range(6) for y in range(5)])
    neighbours = [
        (i, j)
        for i, p in enumerate(board)
        for j, q in enumerate(board)
        if i < j and np.linalg.norm(p - q) < 0.026
    ]
    i, j = np.array(neighbours).T
    scales, lengths = [], []
    for _ in range(200):
        seen = board + rng.normal(0.0, 0.005, board.shape)
        scales.append(Alignment.from_points(board, seen, with_scale=True).scale)
        lengths.append(np.linalg.norm(seen[i] - seen[j], axis=1).mean() / 0.025)
    assert np.mean(scales) == pytest.approx(1.0, abs=4.0 * np.std(scales) / np.sqrt(200) + 2e-3)
    assert np.mean(lengths) > 1.03


def test_a_point_that_counts_twice_is_two_points():
    points = np.random.default_rng(4).normal(size=(6, 3)) * [1.0, 1.0, 0.1]
    twice = Plane.from_points(np.vstack([points, points[:2]]))
    weighed = Plane.from_points(points, [2.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    assert abs(weighed.normal @ twice.normal) == pytest.approx(1.0)
    assert np.abs(weighed.distance_to(points)) == pytest.approx(np.abs(twice.distance_to(points)))


@pytest.mark.parametrize("weights", [[1.0, 1.0], [1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, np.nan]])
def test_weights_of_a_plane_must_be_positive_and_one_each(weights):
    with pytest.raises(ValueError, match="4 positive numbers"):
        Plane.from_points(np.random.default_rng(5).normal(size=(4, 3)), weights)
