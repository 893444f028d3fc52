"""Homographies between planes and the image of a square's centre."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.geometry.homography import apply_homography, homography, marker_center

SEED = st.integers(0, 2**32 - 1)
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def random_homography(rng):
    """Return a view of the square [-1, 1]^2 somewhere in an image, never edge on."""
    tilt, turn = rng.uniform(0.0, 1.1), rng.uniform(-np.pi, np.pi)
    axis = np.array([np.cos(turn), np.sin(turn), 0.0])
    k = np.cross(np.eye(3), axis)
    roll = rng.uniform(-np.pi, np.pi)
    in_plane = [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
    R = (np.eye(3) + np.sin(tilt) * k + (1 - np.cos(tilt)) * k @ k) @ in_plane
    K = np.diag([400.0, 400.0, 1.0]) + np.outer([320.0, 240.0, 0.0], [0, 0, 1.0])
    p = np.append(rng.uniform(-2, 2, 2), rng.uniform(4, 12))
    return K @ np.column_stack([R[:, :2], p])


@given(SEED, st.sampled_from([4, 5, 54]))
def test_a_homography_is_recovered_from_its_points(seed, n):
    rng = np.random.default_rng(seed)
    H = random_homography(rng)
    source = SQUARE if n == 4 else rng.uniform(-1, 1, (n, 2))
    found = homography(source, apply_homography(H, source))
    elsewhere = rng.uniform(-1, 1, (20, 2))
    assert apply_homography(found, elsewhere) == pytest.approx(
        apply_homography(H, elsewhere), abs=1e-6
    )


@given(SEED)
def test_a_homography_and_its_inverse_cancel(seed):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-1, 1, (30, 2))
    target = apply_homography(random_homography(rng), source)
    there, back = homography(source, target), homography(target, source)
    assert apply_homography(back, apply_homography(there, source)) == pytest.approx(
        source, abs=1e-9
    )
    product = there @ back
    assert product / product[2, 2] == pytest.approx(np.eye(3), abs=1e-5)


def test_many_homographies_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(1)
    H = np.stack([random_homography(rng) for _ in range(13)])
    source = np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2) / 5 - 0.8
    target = apply_homography(H, source) + rng.normal(0, 0.3, (13, 54, 2))
    together = homography(source, target)
    assert together.shape == (13, 3, 3)
    one_by_one = [homography(source, board) for board in target]
    assert together == pytest.approx(np.stack(one_by_one), abs=1e-14)


def test_the_scale_and_origin_of_the_points_do_not_matter():
    # This is what the normalisation is for, and only the centroid makes it exact.
    rng = np.random.default_rng(2)
    source = rng.uniform(-1, 1, (12, 2))
    target = apply_homography(random_homography(rng), source) + rng.normal(0, 0.5, (12, 2))
    plain = apply_homography(homography(source, target), source)
    far = homography(1e3 * source + 5e4, 1e-3 * target - 7.0)
    moved = apply_homography(far, 1e3 * source + 5e4)
    assert 1e3 * (moved + 7.0) == pytest.approx(plain, abs=1e-6)


def test_noise_in_the_points_averages_out():
    rng = np.random.default_rng(3)
    H = random_homography(rng)
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 2), axis=-1).reshape(-1, 2)
    target = apply_homography(H, grid)
    errors = [
        apply_homography(homography(grid, target + rng.normal(0, 0.5, target.shape)), grid) - target
        for _ in range(40)
    ]
    # Eight numbers from 288 equations: sqrt(8 / 288) of the noise remains.
    assert np.std(errors) == pytest.approx(0.5 * np.sqrt(8 / 288), rel=0.15)


@given(SEED)
def test_the_centre_of_a_marker_is_the_image_of_the_centre_and_not_the_mean(seed):
    rng = np.random.default_rng(seed)
    H = random_homography(rng)
    corners = apply_homography(H, SQUARE)
    assert marker_center(corners) == pytest.approx(H[:2, 2] / H[2, 2], abs=1e-9)
    # As the thesis computes it: through the homography of the four corners.
    origin = apply_homography(homography(SQUARE, corners), np.zeros((1, 2)))[0]
    assert marker_center(corners) == pytest.approx(origin, abs=1e-6)


def test_the_mean_of_the_corners_is_off_by_pixels_for_a_tilted_marker():
    H = np.array([[100.0, 0, 320], [0, 60.0, 240], [0.0, 0.3, 1.0]])
    corners = apply_homography(H, SQUARE)
    assert marker_center(corners) == pytest.approx([320.0, 240.0], abs=1e-12)
    assert np.linalg.norm(corners.mean(axis=0) - [320.0, 240.0]) > 5.0


def test_centres_of_many_markers_come_at_once_and_nan_stays_nan():
    rng = np.random.default_rng(4)
    corners = np.stack([apply_homography(random_homography(rng), SQUARE) for _ in range(5)])
    corners[2] = np.nan
    centers = marker_center(corners[None])
    assert centers.shape == (1, 5, 2)
    assert np.isnan(centers[0, 2]).all()
    assert np.isfinite(centers[0, [0, 1, 3, 4]]).all()


@pytest.mark.parametrize(
    "corners",
    [
        SQUARE[[0, 2, 1, 3]],  # crosses itself
        [[0, 0], [4, 0], [1, 1], [0, 4]],  # a dart
        [[0, 0], [1, 0], [2, 0], [0, 2]],  # three on a line
        np.ones((4, 2)),
    ],
)
def test_corners_that_no_square_has_are_refused(corners):
    with pytest.raises(ValueError, match="convex"):
        marker_center(corners)


LINE = np.column_stack([np.arange(6.0), 2 * np.arange(6.0)])
HEXAGON = np.array([[0.0, 0], [2, 0], [3, 2], [2, 4], [0, 4], [-1, 2]])


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        (LINE, HEXAGON, "do not determine"),
        (HEXAGON, LINE, "do not determine"),
        (np.ones((6, 2)), HEXAGON, "source points coincide"),
        (HEXAGON, np.ones((6, 2)), "target points coincide"),
        ([[0, 0], [1, 0], [2, 0], [0, 1]], SQUARE, "do not determine"),
        (SQUARE, [[0, 0], [1, 0], [2, 0], [0, 1]], "do not determine"),
        (SQUARE[:3], SQUARE[:3], r"n >= 4, 2\), got \(3, 2\)"),
        (SQUARE, HEXAGON, "must both have shape"),
        (SQUARE, np.where(SQUARE > 0, np.nan, SQUARE), "finite"),
    ],
)
def test_points_that_determine_no_homography_are_refused(source, target, message):
    with pytest.raises(ValueError, match=message):
        homography(source, target)


def test_a_point_on_the_horizon_has_no_image():
    H = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 1]])
    with pytest.raises(ValueError, match="infinity"):
        apply_homography(H, [[-1.0, 0.0]])
    with pytest.raises(ValueError, match=r"H must have shape \(..., 3, 3\)"):
        apply_homography(H[:2], [[0.0, 0.0]])
    with pytest.raises(ValueError, match=r"points must have shape"):
        apply_homography(H, [0.0, 0.0])
