"""Joints that were read wrongly are named by the points that were set aside, others never."""

import numpy as np
import pytest

from nico_selfmodel.estimation.diagnosis.misread_joint import misread_joints


def aside(seed, count, joint=None, joints=6, parallel=False):
    """Points 300 mm about axes of any direction, off by a joint's 1.2 deg or in any way."""
    rng = np.random.default_rng(seed)
    by_angle = 0.3 * rng.normal(size=(count, 3, joints))
    if parallel:
        by_angle[:, :, 3] = 0.8 * by_angle[:, :, 2] + 1e-3 * rng.normal(size=(count, 3))
    covariance = np.tile(5e-4**2 * np.eye(3), (count, 1, 1))
    noise = 5e-4 * rng.normal(size=(count, 3))
    if joint is None:
        way = rng.normal(size=(count, 3))
        off = 6e-3 * way / np.linalg.norm(way, axis=1, keepdims=True)
    else:
        off = by_angle[:, :, joint] * np.radians(1.2) * rng.choice([-1.0, 1.0], (count, 1))
    return off + noise, by_angle, covariance


def test_the_joint_that_was_off_is_named_with_its_angle():
    for seed in range(20):
        named, off = misread_joints(*aside(seed, 6, joint=2))
        assert named == (2,)
        assert np.degrees(np.nanmedian(np.abs(off))) == pytest.approx(1.2, rel=0.15)


def test_points_that_are_off_in_any_way_name_no_joint():
    named = [misread_joints(*aside(seed, 3 + seed % 15))[0] for seed in range(1000)]
    assert sum(map(bool, named)) <= 2


def test_a_few_points_off_in_another_way_do_not_hide_the_joint():
    for seed in range(20):
        slips, others = aside(seed, 10, joint=1), aside(100 + seed, 4)
        named, off = misread_joints(
            *(np.concatenate(both) for both in zip(slips, others, strict=True))
        )
        assert named == (1,)
        assert np.isfinite(off[:10]).sum() >= 9


def test_joints_that_points_do_not_tell_apart_are_both_named():
    named, _ = misread_joints(*aside(0, 8, joint=2, parallel=True))
    assert set(named) == {2, 3}


def test_two_points_are_too_few():
    named, off = misread_joints(*aside(0, 2, joint=2))
    assert named == ()
    assert np.isnan(off).all()
    assert misread_joints(*aside(0, 3, joint=2))[0] == (2,)
