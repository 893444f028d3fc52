"""The test for a bent mirror: right about flat ones as often as it says, and about bent ones."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.diagnosis.flatness import exceeded_by_chance
from nico_selfmodel.estimation.mirrors.mirror_flatness import flatness_of
from nico_selfmodel.estimation.mirrors.mirror_solution import solve_mirrors
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.systems.simulated.curved_mirror import curved_reflection

from ..slow_rest import slow_rest
from .mirror_scenes import CHAIN, MIRROR, RIG, body, poses, recording

NOISE = ReflectionNoise(0.3, 0.0)


def flatness(reflections):
    (mirror,) = solve_mirrors(reflections, (MIRROR,), NOISE).mirrors
    return flatness_of(reflections, mirror, NOISE)


def bent(radius, count=12, seed=0):
    """Return reflections in a sphere that touches the mirror's plane."""
    q = poses(count, seed)
    p = CHAIN.forward(q)
    rng = np.random.default_rng((seed, 3))
    pixels = [curved_reflection(camera, MIRROR, radius, p, camera.X_WC) for camera in RIG.cameras]
    noisy = np.concatenate(pixels, axis=1) + rng.normal(0.0, 0.3, (count, 4))
    return Reflections.from_dataset(replace(recording(q), pixels=noisy), body())


@pytest.mark.slow
def test_flat_mirrors_pass_as_often_as_they_should():
    chances = []
    for seed in range(60):
        reflections = Reflections.from_dataset(recording(poses(8, seed), seed=seed), body())
        chances.append(flatness(reflections).by_chance)
    chances = np.array(chances)
    assert 0.3 < np.mean(chances < 0.5) < 0.7
    assert np.mean(chances < 0.05) < 0.15
    assert chances.min() > 1e-3


@pytest.mark.parametrize("radius", [3.0, -3.0, 10.0, -10.0])
def test_a_bent_mirror_is_recognised(radius):
    test = flatness(bent(radius))
    assert not test.flat
    assert test.freedom == 9
    assert test.redundancy == 48 - 12


def test_a_very_long_radius_is_a_plane():
    q = poses(12)
    p = CHAIN.forward(q)
    for camera in RIG.cameras:
        flat = camera.project(MIRROR.reflect(p))
        np.testing.assert_allclose(
            curved_reflection(camera, MIRROR, 1e4, p, camera.X_WC), flat, atol=0.02
        )


def test_the_path_over_a_bent_mirror_obeys_the_law_of_reflection():
    p, camera = CHAIN.forward(poses(6)), RIG.right
    pixels = curved_reflection(camera, MIRROR, 3.0, p, camera.X_WC)
    sight = camera.rays(pixels).direction
    origin, centre = camera.X_WC[:3, 3], -(MIRROR.distance + 3.0) * MIRROR.normal
    # Where the line of sight meets the sphere: |o + t s - c| = r
    b = sight @ (origin - centre)
    t = -b - np.sqrt(b**2 - (origin - centre) @ (origin - centre) + 9.0)
    at = origin + t[:, None] * sight
    normal = (at - centre) / 3.0
    back = sight - 2.0 * np.sum(sight * normal, axis=1)[:, None] * normal
    towards = (p - at) / np.linalg.norm(p - at, axis=1)[:, None]
    np.testing.assert_allclose(back, towards, atol=1e-8)


def test_an_arm_that_is_wrong_within_its_covariance_does_not_bend_a_mirror():
    model = body(True)
    values = model.parameters.values.copy()
    values[model.parameters.names.index("tilt.theta_offset")] += 0.02
    arm = model.parameters.with_values(values)
    wrong = replace(model, table=arm.table, servo_map=arm.servos, covariance=None)
    data = recording(poses(40))
    assert not flatness(Reflections.from_dataset(data, wrong)).flat
    # Sigmas of 0.01 rad and 10 mm: the same error is now two sigmas.
    unsure = ParameterCovariance(model.covariance.names, 1000.0 * model.covariance.matrix)
    assert flatness(Reflections.from_dataset(data, replace(wrong, covariance=unsure))).flat


def test_too_few_poses_are_not_flatness():
    reflections = Reflections.from_dataset(recording(poses(4)), body())
    assert flatness(reflections) is None


def test_one_camera_can_test_a_mirror_too():
    data = recording(poses(12))
    pixels = data.pixels.copy()
    pixels[:, 2:] = np.nan
    reflections = Reflections.from_dataset(replace(data, pixels=pixels), body())
    test = flatness(reflections)
    assert test.flat
    assert test.freedom == 3


@pytest.mark.parametrize(
    ("ratio", "first", "second", "chance"),
    [(1.0, 9, 30, 0.4614), (2.21, 9, 30, 0.0501), (3.07, 9, 30, 0.01), (5.12, 3, 20, 0.0087)],
)
def test_the_upper_tail_of_f_is_right_to_a_few_per_cent(ratio, first, second, chance):
    assert exceeded_by_chance(ratio, first, second) == pytest.approx(chance, rel=0.06)


def test_no_gain_is_certain_chance():
    assert exceeded_by_chance(0.0, 9, 30) == 1.0


def test_a_flat_mirror_in_another_place_is_no_bent_one():
    moved = Mirror.from_values(MIRROR.values + np.array([0.02, 0.0, 0.01]))
    reflections = Reflections.from_dataset(recording(poses(12)), body())
    assert flatness_of(reflections, moved, NOISE).flat


def smooth_errors(q, seed, sigma):
    """Return joint angles off by a smooth function of the pose, as sag and gears make it."""
    rng = np.random.default_rng((seed, 9))
    turn, phase = rng.normal(0.0, 0.7, (4, 4)), rng.uniform(0.0, 2.0 * np.pi, 4)
    return q + sigma * np.sqrt(2.0) * np.sin(q @ turn + phase)


def seen_with_smooth_errors(seed, radius=None, count=50):
    q = poses(count, seed)
    p = CHAIN.forward(smooth_errors(q, seed, np.radians(0.5)))
    cameras = [
        camera.project(MIRROR.reflect(p))
        if radius is None
        else curved_reflection(camera, MIRROR, radius, p, camera.X_WC)
        for camera in RIG.cameras
    ]
    noise = np.random.default_rng((seed, 3)).normal(0.0, 0.3, (count, 4))
    data = replace(recording(q), pixels=np.concatenate(cameras, axis=1) + noise)
    return Reflections.from_dataset(data, body(True))


@pytest.mark.parametrize("seed", range(8))
def test_a_pose_that_one_camera_missed_does_not_bend_a_mirror(seed):
    """What was not seen is no part of the covariance of what was."""
    rng = np.random.default_rng((seed, 5))
    data = recording(poses(20, seed), sigma=0.03, play=np.radians(0.8), seed=seed)
    reflections = Reflections.from_dataset(data, body(True))
    pixels = reflections.pixels.copy()
    for row in np.flatnonzero(rng.random(20) < 0.25):
        camera = 2 * int(rng.integers(2))
        pixels[row, camera : camera + 2] = np.nan
    noise = ReflectionNoise(0.03, np.radians(0.8) / np.sqrt(3.0))
    partly = replace(reflections, pixels=pixels)
    (mirror,) = solve_mirrors(partly, (MIRROR,), noise).mirrors
    test = flatness_of(partly, mirror, noise)
    assert test.by_chance > 0.003, (seed, test)
    assert test.redundancy == int(partly.seen.sum()) - 12


@pytest.mark.slow
def test_joints_that_err_alike_in_neighbouring_poses_do_not_bend_a_mirror():
    noise = ReflectionNoise(0.3, np.radians(0.5))
    alarms = {"alike": 0, "drawn anew": 0}
    for seed in range(40):
        reflections = seen_with_smooth_errors(seed)
        (mirror,) = solve_mirrors(reflections, (MIRROR,), noise).mirrors
        alarms["alike"] += not flatness_of(reflections, mirror, noise).flat
        anew = replace(reflections, q=None)
        alarms["drawn anew"] += not flatness_of(anew, mirror, noise).flat
    assert alarms["alike"] < 1
    assert alarms["drawn anew"] > 4


@pytest.mark.parametrize("radius", slow_rest([-3.0, 3.0]))
def test_a_bent_mirror_is_recognised_by_joints_that_err_alike(radius):
    noise = ReflectionNoise(0.3, np.radians(0.5))
    for seed in range(10):
        reflections = seen_with_smooth_errors(seed, radius, count=10)
        (mirror,) = solve_mirrors(reflections, (MIRROR,), noise).mirrors
        assert not flatness_of(reflections, mirror, noise).flat


@pytest.mark.slow
def test_pixel_noise_that_was_stated_too_small_is_measured():
    stated, chances = ReflectionNoise(0.05, np.radians(0.3)), []
    for seed in range(30):
        data = recording(poses(50, seed), seed=seed, play=np.radians(0.5))
        reflections = Reflections.from_dataset(data, body())
        (mirror,) = solve_mirrors(reflections, (MIRROR,), stated).mirrors
        chances.append(flatness_of(reflections, mirror, stated).by_chance)
    # With the stated noise it is 0.2 of them.
    assert np.mean(np.array(chances) < 0.05) < 0.12
