"""Poses for learning a mirror: seen by both cameras, off the glass, and telling much."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from nico_selfmodel.errors import EstimationError, ModelError
from nico_selfmodel.estimation.mirrors.mirror_solution import solve_mirrors
from nico_selfmodel.estimation.mirrors.reflections import ReflectionNoise, Reflections
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.planning.mirror_poses import free_space, plan_mirror_poses

from .mirror_scenes import CHAIN, MIRROR, RIG, SERVOS, SIZE, body, poses, recording

LIMITS = tuple(np.sort(SERVOS.to_encoder(np.array([[-0.7] * 4, [0.7] * 4])), axis=0))


def plan(count=8, mirror=MIRROR, seed=0, **options):
    rng = np.random.default_rng(seed)
    return plan_mirror_poses(body(), mirror, LIMITS, count, rng, pool=600, **options)


def test_every_pose_shows_the_reflection_to_both_cameras_within_the_limits():
    found = plan(margin=30.0)
    assert found.encoders.shape == (8, 4)
    assert (found.encoders >= LIMITS[0]).all()
    assert (found.encoders <= LIMITS[1]).all()
    p = CHAIN.forward(SERVOS.to_joint(found.encoders))
    assert_allclose(MirrorRig(RIG, MIRROR).project(p), found.pixels, atol=1e-9)
    assert (found.pixels >= 30.0).all()
    assert (found.pixels <= np.tile(SIZE, 2) - 31.0).all()


def test_arm_and_way_keep_off_the_glass():
    near = Mirror.from_values([0.0, 0.0, 0.30])
    found = plan(5, near, clearance=0.06)
    q = SERVOS.to_joint(found.encoders)
    rig = MirrorRig(RIG, near)
    assert free_space(CHAIN, rig, q).min() >= 0.06
    for start, end in pairwise(q):
        way = start + np.linspace(0.0, 1.0, 100)[:, None] * (end - start)
        assert near.in_front_by(CHAIN.forward(way)).min() > 0.055
    assert (found.clearance >= 0.06).all()


def test_what_is_not_known_of_the_plane_counts_against_the_arm():
    q = poses(5)
    sure, unsure = (
        free_space(CHAIN, MirrorRig(RIG, replace(MIRROR, covariance=covariance)), q)
        for covariance in (None, np.diag([0.0, 0.0, 0.01]) ** 2)
    )
    assert_allclose(sure - unsure, 0.03, atol=1e-9)


def test_the_elbow_counts_where_it_is_nearest():
    # An elbow bent backwards leaves the hand behind it.
    q = np.array([[0.0, 0.0, 0.0, -2.6]])
    room = free_space(CHAIN, MirrorRig(RIG, MIRROR), q)[0]
    hand = MIRROR.in_front_by(CHAIN.forward(q))[0]
    assert room < hand - 0.02


def test_chosen_poses_tell_more_than_random_ones():
    noise = ReflectionNoise(0.3, 0.0)

    def volume(q):
        data = Reflections.from_dataset(recording(q), body())
        covariance = solve_mirrors(data, (MIRROR,), noise).mirrors[0].covariance
        return np.linalg.slogdet(covariance)[1]

    chosen = volume(SERVOS.to_joint(plan(6).encoders))
    random = [volume(poses(6, seed)) for seed in range(8)]
    assert chosen < np.min(random)


def test_sigmas_shrink_with_every_pose():
    sigma = plan().sigma
    assert (np.diff(sigma, axis=0) <= 1e-12).all()
    assert np.degrees(sigma[-1, :2]).max() < 0.2


def test_the_same_generator_gives_the_same_poses():
    assert_allclose(plan(4).encoders, plan(4).encoders, atol=0.0)


def test_a_mirror_that_cannot_be_used_is_said_to_be_so():
    with pytest.raises(EstimationError, match="turn the mirror towards the cameras"):
        plan(3, Mirror.from_values([np.radians(60.0), 0.0, 0.5]))
    with pytest.raises(EstimationError, match="mm from the glass"):
        plan(3, Mirror.from_values([0.0, 0.0, 0.06]), clearance=0.1)
    with pytest.raises(EstimationError, match=r"only \d+ of 500 poses") as caught:
        plan_mirror_poses(body(), MIRROR, LIMITS, 500, np.random.default_rng(0), pool=300)
    assert 0 < len(caught.value.partial.encoders) < 500


def test_what_is_missing_is_named():
    with pytest.raises(ModelError, match="no pair of cameras"):
        plan_mirror_poses(body(cameras={}), MIRROR, LIMITS, 3, np.random.default_rng(0))
    with pytest.raises(ValueError, match="limits must be finite"):
        plan_mirror_poses(body(), MIRROR, (LIMITS[1], LIMITS[0]), 3, np.random.default_rng(0))
    with pytest.raises(ValueError, match="no marker 'tool'"):
        plan(3, marker="tool")
