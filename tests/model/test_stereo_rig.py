"""Two cameras: triangulation with its covariance, epipolar geometry, another world."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.epipolar import epipolar_lines
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES, SIDES, rig_names
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

SIZE = (640, 480)
SEED = st.integers(0, 2**32 - 1)
a_few = settings(max_examples=25)
"""Each example draws a rig and twenty points."""
SIGMA = 0.3


def random_pose(rng):
    return transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))


def random_rig(seed):
    """Return a rig somewhere: two lenses, a baseline of about 7 cm, a little vergence."""
    rng = np.random.default_rng(seed)

    def camera(pose):
        f, c = rng.uniform(350.0, 450.0, 2), rng.uniform([300.0, 220.0], [340.0, 260.0])
        values = [*f, rng.normal(0.0, 0.5), *c, *rng.normal([-0.28, 0.09, -0.012], 0.005)]
        return Camera.from_values([*values, *rng.normal(0.0, 5e-4, 2)], SIZE, pose)

    X_WL = random_pose(rng)
    X_LR = transform(
        rotation_from_vector(rng.normal(0.0, 0.05, 3)), [0.07, *rng.normal(0, 5e-3, 2)]
    )
    return StereoRig(camera(X_WL), camera(X_WL @ X_LR))


def parallel_rig(baseline=0.07):
    camera = Camera(400.0, 400.0, 320.0, 240.0, SIZE)
    return StereoRig(camera, camera.at(transform(np.eye(3), [baseline, 0.0, 0.0])))


def before(rig, seed, count=20):
    """Return points of the world in front of the left camera, a hand's reach away. Shape (N, 3)."""
    rng = np.random.default_rng((seed, 1))
    depth = rng.uniform(0.2, 0.5, count)
    aside = rng.uniform([-0.5, -0.4], [0.5, 0.4], (count, 2)) * depth[:, None]
    return apply(rig.left.X_WC, np.column_stack([aside, depth]))


@a_few
@given(SEED)
def test_triangulation_undoes_projection(seed):
    rig = random_rig(seed)
    p = before(rig, seed)
    found = rig.triangulate(rig.project(p))
    assert found.p_WQ == pytest.approx(p, abs=1e-11)
    assert np.abs(found.residuals).max() < 1e-9
    assert found.in_front.all()


def test_opencv_triangulates_alike_where_the_pixels_are_exact():
    rig = random_rig(5)
    p = before(rig, 5)
    pixels = rig.project(p)
    ideal = [
        camera.undistort(pixels[:, c]).T
        for camera, c in zip(rig.cameras, (slice(0, 2), slice(2, 4)), strict=True)
    ]
    X_CW = [camera.X_CW[:3] for camera in rig.cameras]
    theirs = cv2.triangulatePoints(*X_CW, *ideal)
    assert rig.triangulate(pixels).p_WQ == pytest.approx((theirs[:3] / theirs[3]).T, abs=1e-9)


@a_few
@given(SEED)
def test_the_reprojection_error_is_smallest_where_the_point_is_put(seed):
    rig = random_rig(seed)
    rng = np.random.default_rng(seed)
    pixels = rig.project(before(rig, seed)) + rng.normal(0.0, SIGMA, (20, 4))
    root = rng.normal(size=(4, 4)) + 3.0 * np.eye(4)
    covariance = root @ root.T
    found = rig.triangulate(pixels, covariance)
    assert rig.project(found.p_WQ) + found.residuals == pytest.approx(pixels, abs=1e-9)

    def misfit(p):
        miss = pixels - rig.project(p)
        return np.einsum("ni,ij,nj->n", miss, np.linalg.inv(covariance), miss)

    for _ in range(5):
        aside = rng.normal(0.0, 1e-4, (20, 3))
        assert (misfit(found.p_WQ + aside) > misfit(found.p_WQ)).all()


def test_the_covariance_of_a_point_is_that_of_its_errors():
    rig = random_rig(1)
    p = np.repeat(before(rig, 1, 10), 100, axis=0)
    noise = np.random.default_rng(2).normal(0.0, SIGMA, (len(p), 4))
    found = rig.triangulate(rig.project(p) + noise, SIGMA)
    error = found.p_WQ - p
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    # Three degrees of freedom each: the mean over 1000 is known to 0.08.
    assert nees.mean() == pytest.approx(3.0, abs=0.25)
    squares = np.sum(found.residuals**2, axis=1) / SIGMA**2
    assert squares.mean() == pytest.approx(1.0, abs=0.15)  # four pixels, three coordinates


def test_the_covariance_follows_that_of_the_pixels():
    rig = random_rig(2)
    pixels = rig.project(before(rig, 2, 4))
    once = rig.triangulate(pixels).covariance
    assert rig.triangulate(pixels, 0.3).covariance == pytest.approx(0.09 * once, rel=1e-9)
    many = np.array([s**2 * np.eye(4) for s in (1.0, 2.0, 3.0, 4.0)])
    each = rig.triangulate(pixels, many).covariance
    assert each == pytest.approx(once * np.array([1.0, 4.0, 9.0, 16.0])[:, None, None], rel=1e-9)
    # A left camera that is next to unobservable leaves the distance open along the right one's ray.
    blurred = rig.triangulate(pixels, np.diag([1e6, 1e6, 1.0, 1.0])).covariance
    widest = np.linalg.eigh(blurred)[1][:, :, -1]
    ray = rig.right.rays(pixels[:, 2:]).direction
    assert np.abs(np.sum(widest * ray, axis=1)) == pytest.approx(np.ones(4), abs=1e-3)


def test_points_behind_the_cameras_are_told_apart():
    """A disparity of the wrong sign: the rays meet behind both cameras."""
    found = parallel_rig().triangulate([[340.0, 240.0, 300.0, 240.0], [300.0, 240.0, 340.0, 240.0]])
    assert found.in_front.tolist() == [True, False]
    assert found.p_WQ[:, 2] == pytest.approx([0.7, -0.7])


def test_a_point_must_lie_in_front_of_both_cameras():
    """Where the right camera looks the other way, its ray passes through the point backwards."""
    left = parallel_rig().left
    away = StereoRig(left, left.at(transform(np.diag([-1.0, 1.0, -1.0]), [0.07, 0.0, 0.0])))
    found = away.triangulate([[320.0, 240.0, 280.0, 240.0]])
    assert found.p_WQ[0] == pytest.approx([0.0, 0.0, 0.7])
    assert found.in_front.tolist() == [False]


def test_what_a_camera_did_not_see_stays_open_and_the_rest_does_not_mind():
    rig = random_rig(3)
    pixels = rig.project(before(rig, 3, 5))
    gaps = pixels.copy()
    gaps[1, 0] = gaps[3, 2:] = np.nan
    covariance = np.arange(1.0, 6.0)[:, None, None] * np.eye(4)
    found, whole = rig.triangulate(gaps, covariance), rig.triangulate(pixels, covariance)
    kept = [0, 2, 4]
    for name in ("p_WQ", "covariance", "residuals"):
        assert np.isnan(getattr(found, name)[[1, 3]]).all()
        assert getattr(found, name)[kept] == pytest.approx(getattr(whole, name)[kept], abs=1e-12)
    assert found.in_front.tolist() == [True, False, True, False, True]
    assert not rig.triangulate(np.full((2, 4), np.nan)).in_front.any()
    assert rig.triangulate(np.zeros((0, 4))).p_WQ.shape == (0, 3)


def test_a_point_without_disparity_spoils_no_other_point():
    found = parallel_rig().triangulate([[340.0, 240.0, 300.0, 240.0], [300.0, 200.0, 300.0, 200.0]])
    assert found.p_WQ[0] == pytest.approx([0.035, 0.0, 0.7])
    assert not np.isfinite(found.p_WQ[1]).all() or not found.in_front[1]


@pytest.mark.parametrize(
    ("pixels", "covariance", "message"),
    [
        (np.zeros((3, 2)), 1.0, r"pixels must have shape \(N, 4\), got \(3, 2\)"),
        (np.zeros(4), 1.0, r"pixels must have shape \(N, 4\), got \(4,\)"),
        (np.zeros((3, 4)), np.eye(2), r"a number, \(4, 4\) or \(3, 4, 4\), got \(2, 2\)"),
        (np.zeros((3, 4)), np.ones((2, 4, 4)), r"or \(3, 4, 4\), got \(2, 4, 4\)"),
    ],
)
def test_wrong_shapes_are_refused(pixels, covariance, message):
    with pytest.raises(ValueError, match=message):
        parallel_rig().triangulate(pixels, covariance)


def test_a_pixel_without_a_ray_is_refused():
    camera = Camera(381.0, 381.0, 319.5, 239.5, SIZE, k1=-0.28)
    rig = StereoRig(camera, camera.at(transform(np.eye(3), [0.07, 0.0, 0.0])))
    with pytest.raises(ModelError, match="no ray belongs to them"):
        rig.triangulate([[0.0, 0.0, 0.0, 0.0]])


def test_one_point_and_what_only_one_camera_sees():
    rig = parallel_rig()
    pixels = rig.project([0.0, 0.0, 0.7])
    assert pixels == pytest.approx([320.0, 240.0, 280.0, 240.0])
    aside = StereoRig(rig.left, rig.right.at(transform(np.diag([-1.0, 1.0, -1.0]), [0.07, 0, 0])))
    assert np.isnan(aside.project([[0.0, 0.0, 0.7]])).tolist() == [[False, False, True, True]]


@a_few
@given(SEED)
def test_matched_points_satisfy_the_epipolar_equations(seed):
    rig = random_rig(seed)
    pixels = rig.project(before(rig, seed))
    ideal = [
        np.column_stack([camera.undistort(pixels[:, c]), np.ones(20)])
        for camera, c in zip(rig.cameras, (slice(0, 2), slice(2, 4)), strict=True)
    ]
    E, F = rig.essential(), rig.fundamental()
    assert np.einsum("ni,ij,nj->n", ideal[1], E, ideal[0]) == pytest.approx(0.0, abs=1e-12)
    straight = rig.undistorted_pixels(pixels)
    left, right = (np.column_stack([straight[:, c], np.ones(20)]) for c in ([0, 1], [2, 3]))
    size = np.linalg.norm(F) * np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=1)
    assert np.einsum("ni,ij,nj->n", right, F, left) / size == pytest.approx(0.0, abs=1e-12)
    assert rig.epipolar_errors(pixels) == pytest.approx(np.zeros((20, 2)), abs=1e-8)
    lines = epipolar_lines(F, left[:, :2])
    assert np.sum(lines * right, axis=1) == pytest.approx(0.0, abs=1e-8)
    assert np.linalg.norm(lines[:, :2], axis=1) == pytest.approx(np.ones(20))


@a_few
@given(SEED)
def test_the_matrices_are_what_the_thesis_ought_to_say(seed):
    rig = random_rig(seed)
    E, F = rig.essential(), rig.fundamental()
    # Two equal singular values and a zero; as long as the baseline.
    assert np.linalg.svd(E)[1] == pytest.approx([rig.baseline] * 2 + [0.0], abs=1e-14)
    K_left, K_right = rig.left.K, rig.right.K
    assert pytest.approx(E, abs=1e-14) == K_right.T @ F @ K_left
    assert abs(np.linalg.det(F)) < 1e-14 * np.linalg.norm(F) ** 3


def epipoles(rig):
    """Return where each camera's image would show the other's centre, homogeneous [px]."""
    X_LR = rig.X_LR
    return rig.left.K @ X_LR[:3, 3], rig.right.K @ inverse(X_LR)[:3, 3]


@a_few
@given(SEED)
def test_epipoles_are_the_null_vectors_and_lie_on_every_line(seed):
    rig = random_rig(seed)
    F = rig.fundamental()
    in_left, in_right = (e / np.linalg.norm(e) for e in epipoles(rig))
    size = np.linalg.norm(F)
    assert F @ in_left == pytest.approx(np.zeros(3), abs=1e-12 * size)
    assert F.T @ in_right == pytest.approx(np.zeros(3), abs=1e-12 * size)
    straight = rig.undistorted_pixels(rig.project(before(rig, seed)))
    lines = epipolar_lines(F, straight[:, :2])
    assert lines @ in_right == pytest.approx(np.zeros(20), abs=1e-8)


def test_parallel_cameras_have_level_lines():
    rig = parallel_rig()
    lines = epipolar_lines(rig.fundamental(), [[100.0, 50.0], [400.0, 300.0]])
    assert np.abs(lines[:, 0]).max() < 1e-12
    assert -lines[:, 2] / lines[:, 1] == pytest.approx([50.0, 300.0])
    assert rig.epipolar_errors([[100.0, 50.0, 90.0, 53.0]]) == pytest.approx(np.array([[3.0, 3.0]]))


@a_few
@given(SEED)
def test_a_change_of_the_world_leaves_the_pixels_alone(seed):
    rig = random_rig(seed)
    p = before(rig, seed)
    X_WV = random_pose(np.random.default_rng((seed, 2)))
    other = rig.moved(X_WV)
    assert other.project(apply(inverse(X_WV), p)) == pytest.approx(rig.project(p), abs=1e-8)
    assert pytest.approx(rig.X_LR, abs=1e-12) == other.X_LR
    assert other.baseline == pytest.approx(rig.baseline)
    assert other.fundamental() == pytest.approx(rig.fundamental(), abs=1e-12)
    back = other.moved(inverse(X_WV))
    assert pytest.approx(rig.left.X_WC, abs=1e-12) == back.left.X_WC


def test_every_parameter_has_a_name_a_value_and_a_unit():
    rig = random_rig(4)
    assert len(rig.names) == len(rig.values) == len(rig.units) == 26
    named = dict(zip(rig.names, rig.values, strict=True))
    assert (named["left.fx"], named["right.p2"]) == (rig.left.fx, rig.right.p2)
    pose = [named[f"right.pose.{n}"] for n in POSE_NAMES]
    found = transform(rotation_from_vector(pose[:3]), pose[3:])
    assert found == pytest.approx(rig.X_LR, abs=1e-12)
    assert dict(zip(rig.names, rig.units, strict=True))["right.pose.rx"] == "rad"
    assert rig_names(("left",)) == rig.names[:10]
    assert rig_names(("right",)) == rig.names[10:20]
    assert SIDES == ("left", "right")
