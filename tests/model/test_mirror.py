"""Mirrors: planes, charts, reflected cameras, and what reflections say of points."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect, reflection, reflection_slopes
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror, mirror_camera
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig, reflected_projection
from nico_selfmodel.model.cameras.projection import project_in_camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import load_model, save_model

SIZE = (640, 480)
BENT = {"k1": -0.28, "k2": 0.09, "k3": -0.012, "p1": 2e-3, "p2": -1e-3, "skew": 0.7}
RIG = StereoRig(
    Camera(381.0, 383.0, 326.0, 233.0, SIZE, **BENT),
    Camera(
        379.0, 380.0, 315.0, 244.0, SIZE, k1=-0.27, k2=0.085,
        X_WC=transform(rotation_from_vector([0.01, -0.03, 0.02]), [0.07, 0.001, -0.002]),
    ),
)  # fmt: skip
X_WV = transform(rotation_from_vector([0.4, -1.2, 0.3]), [0.5, -0.2, 0.9])


def mirror_at(tilt_deg=(6.0, -9.0), distance=0.48, covariance=None):
    return Mirror.from_values([*np.radians(tilt_deg), distance], covariance)


def body_points(count=40, seed=0):
    """Return points before the cameras and before the mirror. Shape (N, 3)."""
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.12, -0.1, 0.12], [0.16, 0.1, 0.36], (count, 3))


def turned(camera):
    """Return [-R S | -(t - 2 d R n)]: the reflected camera as a proper rotation that looks away."""
    extrinsics = camera.X_CW.copy()
    extrinsics[:3] *= -1.0
    return extrinsics


tilts = st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
planes = st.builds(mirror_at, tilts, st.floats(0.4, 1.2))


@given(planes, st.integers(0, 1000), st.booleans())
def test_projection_into_a_mirror_is_that_of_the_explicit_reflection(mirror, seed, elsewhere):
    rig = RIG.moved(X_WV) if elsewhere else RIG
    points = body_points(seed=seed)
    in_world = apply(rig.left.X_WC, points)
    virtual = apply(rig.left.X_WC, mirror.reflect(points))
    shown = MirrorRig(rig, mirror).project(in_world)
    expected = rig.project(virtual)
    expected[mirror.in_front_by(points) <= 0.0] = np.nan
    assert_allclose(shown, expected, rtol=0.0, atol=1e-9)


@given(planes)
def test_both_forms_of_a_mirror_camera_give_the_same_pixels(mirror):
    points = body_points()
    camera = RIG.right
    first = mirror_camera(camera, mirror.plane)
    second = turned(first)
    assert np.linalg.det(first.X_WC[:3, :3]) == pytest.approx(-1.0)
    assert np.linalg.det(second[:3, :3]) == pytest.approx(1.0)
    assert_allclose(second[:3, :3] @ second[:3, :3].T, np.eye(3), atol=1e-12)
    depth = apply(first.X_CW, points)[:, 2]
    assert_allclose(apply(second, points)[:, 2], -depth, atol=1e-12)
    one = project_in_camera(apply(first.X_CW, points).T, camera.values)[0]
    other = project_in_camera(apply(second, points).T, camera.values)[0]
    seen = depth > 1e-3
    assert_allclose(one[:, seen], other[:, seen], rtol=1e-9, atol=1e-9)


def test_the_thesis_initial_mirror_camera_misses_by_half_a_turn():
    # Eq. 9.10-9.12 with the least rotation from z to the new axis, camera at the origin.
    mirror = mirror_at()
    n, d = -mirror.normal, -mirror.distance
    centre = -2.0 * d * n
    meets = np.array([0.0, 0.0, -d / n[2]])
    axis = (centre - meets) / np.linalg.norm(centre - meets)
    about = np.cross([0.0, 0.0, 1.0], axis)
    angle = np.arctan2(np.linalg.norm(about), axis[2])
    turn = rotation_from_vector(about / np.linalg.norm(about) * angle).T
    proper = turned(mirror_camera(Camera(1.0, 1.0, 0.0, 0.0, SIZE), mirror.plane))
    assert_allclose(inverse(proper)[:3, 3], centre, atol=1e-12)
    assert_allclose(proper[:3, :3], np.diag([-1.0, -1.0, 1.0]) @ turn, atol=1e-12)


def test_the_virtual_cameras_are_the_reflected_ones_and_keep_their_relative_pose():
    rig = MirrorRig(RIG.moved(X_WV), mirror_at())
    assert_allclose(rig.virtual.X_LR, RIG.X_LR, atol=1e-12)
    centre = reflect(rig.plane, rig.rig.right.X_WC[:3, 3])
    assert_allclose(rig.virtual.right.X_WC[:3, 3], centre, atol=1e-12)


@given(st.tuples(st.floats(-150.0, 150.0), st.floats(-90.0, 90.0)), st.floats(0.01, 5.0))
def test_values_and_mirror_are_two_ways_of_saying_the_same(tilt_deg, distance):
    if np.hypot(*tilt_deg) > 170.0:
        tilt_deg = tuple(0.5 * t for t in tilt_deg)
    values = np.array([*np.radians(tilt_deg), distance])
    mirror = Mirror.from_values(values)
    assert_allclose(mirror.values, values, atol=1e-9)
    again = Mirror(mirror.normal, mirror.distance)
    assert_allclose(again.values, values, atol=1e-9)


def test_a_positive_tilt_turns_the_normal_right_and_up():
    right, up = mirror_at((10.0, 0.0)).normal, mirror_at((0.0, 10.0)).normal
    assert right[0] > 0.1
    assert up[1] < -0.1
    assert_allclose(mirror_at((0.0, 0.0)).normal, [0.0, 0.0, -1.0])


def test_a_mirror_may_be_given_by_a_plane_with_either_normal():
    mirror = mirror_at()
    for sign in (1.0, -1.0):
        found = Mirror.from_plane(Plane(sign * mirror.normal, sign * mirror.distance))
        assert_allclose(found.values, mirror.values, atol=1e-15)


def test_reflecting_twice_changes_nothing():
    plane = Plane(mirror_at().normal, 0.48)
    points = body_points()
    assert_allclose(reflect(plane, reflect(plane, points)), points, atol=1e-15)
    assert_allclose(apply(reflection(plane), points), reflect(plane, points), atol=1e-15)
    assert_allclose(reflection(plane) @ reflection(plane), np.eye(4), atol=1e-15)


def test_the_plane_in_another_frame_is_at_the_same_distance_from_points():
    mirror, points = mirror_at(), body_points()
    plane = mirror.plane_in(X_WV)
    assert_allclose(plane.distance_to(apply(X_WV, points)), mirror.in_front_by(points), atol=1e-12)


def test_slopes_of_a_reflection_are_its_finite_differences():
    points, plane, step = body_points(5), mirror_at().plane, 1e-6
    slopes = reflection_slopes(plane, points)
    for k in range(4):
        change = step * np.eye(4)[k]
        ahead = reflect(Plane(plane.normal + change[:3], plane.offset + change[3]), points)
        back = reflect(Plane(plane.normal - change[:3], plane.offset - change[3]), points)
        assert_allclose(slopes[:, :, k], (ahead - back) / (2.0 * step), atol=1e-9)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_slopes_of_a_reflected_projection_are_its_finite_differences(elsewhere):
    rig = RIG.moved(X_WV) if elsewhere else RIG
    points, mirror, step = apply(rig.left.X_WC, body_points(8)), mirror_at(), 1e-6
    shown = reflected_projection(rig.cameras, mirror.values, points)
    for k in range(3):
        change = step * np.eye(3)[k]
        ahead, back = (
            reflected_projection(rig.cameras, mirror.values, points + s * change).pixels
            for s in (1, -1)
        )
        assert_allclose(
            shown.by_point[:, :, k], (ahead - back) / (2.0 * step), rtol=1e-5, atol=1e-4
        )
        ahead, back = (
            reflected_projection(rig.cameras, mirror.values + s * change, points) for s in (1, -1)
        )
        slope = (ahead.pixels - back.pixels) / (2.0 * step)
        assert_allclose(shown.by_mirror[:, :, k], slope, rtol=1e-5, atol=1e-4)


def test_a_reflected_pixel_pair_gives_back_the_real_point():
    rig = MirrorRig(RIG.moved(X_WV), mirror_at())
    points = apply(rig.rig.left.X_WC, body_points())
    pixels = rig.project(points)
    seen = np.isfinite(pixels).all(axis=1)
    found = rig.triangulate(pixels)
    assert seen.sum() > 10
    assert_allclose(found.p_WQ[seen], points[seen], atol=1e-9)
    assert np.isnan(found.p_WQ[~seen]).all()
    assert_allclose(found.in_front, seen)


def test_the_covariance_of_a_point_seen_in_the_mirror_is_what_noise_makes_of_it():
    rng = np.random.default_rng(3)
    true = mirror_at()
    point = np.tile([0.03, 0.02, 0.25], (4000, 1))
    covariance = np.diag([2e-3, 3e-3, 1e-3]) ** 2
    pixels = MirrorRig(RIG, true).project(point) + rng.normal(0.0, 0.3, (len(point), 4))
    draws = true.values + rng.normal(size=(len(point), 3)) * np.sqrt(np.diag(covariance))
    behind = RIG.triangulate(pixels, 0.3).p_WQ
    found = np.array([Mirror.from_values(v).reflect(p) for v, p in zip(draws, behind, strict=True)])
    expected = MirrorRig(RIG, replace(true, covariance=covariance)).triangulate(pixels[:1], 0.3)
    ratio = np.cov(found.T) / expected.covariance[0]
    assert_allclose(np.diag(ratio), 1.0, atol=0.12)
    alone = MirrorRig(RIG, true).triangulate(pixels[:1], 0.3)
    assert np.trace(alone.covariance[0]) < np.trace(expected.covariance[0])


def test_what_is_behind_the_glass_has_no_reflection():
    rig = MirrorRig(RIG, mirror_at())
    assert np.isnan(rig.project([0.0, 0.0, 0.6])).all()
    assert np.isfinite(rig.project([0.0, 0.0, 0.3])).all()


def test_pixels_of_a_thing_behind_the_glass_are_not_in_front():
    # Seen through the place of the glass, nearer to the cameras than it: no reflection looks so.
    rig = MirrorRig(RIG, mirror_at())
    near = RIG.project(np.array([[0.0, 0.0, 0.3]]))
    assert not rig.triangulate(near).in_front.any()


@pytest.mark.parametrize(
    ("normal", "distance", "message"),
    [
        ([0.0, 0.0, -2.0], 0.5, "unit length"),
        ([0.0, 0.0, -1.0], -0.5, "must be positive"),
        ([0.0, 0.0, -1.0], 0.0, "must be positive"),
        ([0.0, -1.0], 0.5, "shape"),
        ([0.0, np.nan, -1.0], 0.5, "finite"),
    ],
)
def test_what_is_no_mirror_is_refused(normal, distance, message):
    with pytest.raises(ValueError, match=message):
        Mirror(np.array(normal), distance)


def test_angles_between_mirrors():
    assert mirror_at((45.0, 0.0)).angle_to(mirror_at((-45.0, 0.0))) == pytest.approx(np.pi / 2)
    assert mirror_at().normal_sigma is None


def test_a_self_model_with_mirrors_survives_the_round_trip(tmp_path):
    known = mirror_at(covariance=np.diag([1e-3, 2e-3, 1e-3]) ** 2)
    cameras = {"left": RIG.left, "right": RIG.right}
    model = SelfModel(
        "cameras", cameras=cameras, mirrors={"m 1": known, "b": mirror_at((0, 0), 1.0)}
    )
    save_model(model, tmp_path / "model.yaml")
    loaded = load_model(tmp_path / "model.yaml")
    assert tuple(loaded.mirrors) == ("m 1", "b")
    assert np.array_equal(loaded.mirrors["m 1"].normal, known.normal)
    assert np.array_equal(loaded.mirrors["m 1"].covariance, known.covariance)
    assert loaded.mirrors["m 1"].distance == known.distance
    assert loaded.mirrors["b"].covariance is None
    with pytest.raises(TypeError):
        loaded.mirrors["c"] = known


def test_a_mirror_that_was_not_learned_is_named():
    cameras = {"left": RIG.left, "right": RIG.right}
    with pytest.raises(ModelError, match="calibrate mirror"):
        SelfModel("cameras", cameras=cameras).mirror_rig("glass")
    with pytest.raises(ModelError, match="there are wall"):
        SelfModel("cameras", cameras=cameras, mirrors={"wall": mirror_at()}).mirror_rig("glass")
    with pytest.raises(ModelError, match="no pair of cameras"):
        SelfModel("unobservable", mirrors={"wall": mirror_at()}).mirror_rig("wall")
    with pytest.raises(ValueError, match="names"):
        SelfModel("cameras", mirrors={"": mirror_at()})


def test_a_broken_mirror_in_a_file_is_refused(tmp_path):
    path = tmp_path / "model.yaml"
    save_model(SelfModel("cameras", mirrors={"wall": mirror_at()}), path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("distance: 0.48", "distance: -0.48"), encoding="utf-8")
    with pytest.raises(ModelError, match="distance must be positive"):
        load_model(path)
