"""Joints of one body whose readings are not alike: limbs, and single joints of a chain."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from ..slow_rest import slow_rest
from .simulated_trees import assembled, observed, one_arm, serial, tags

QUIET, LOUD = 2e-5, 2e-3


def two_limbs(seed, poses=60):
    """Two arms of three joints before a tracker, one read a hundred times as well as the other."""
    rng = np.random.default_rng(seed)
    chain, frames, infos, attached = [], [], [], []
    for hand in ("left", "right"):
        names = [f"{hand}{i}" for i in range(3)]
        some, at = serial(rng, names, "world", 0.4)
        chain, frames = [*chain, *some], [*frames, *at]
        own, where = tags(rng, hand, names[-1], 3)
        infos, attached = [*infos, *own], [*attached, *where]
    sensors = [SensorInfo("tracker", "points")]
    tree = assembled(chain, frames, infos, attached, sensors, [np.eye(4)], {})
    q = rng.uniform(-1.2, 1.2, size=(poses, 6))
    noise = np.repeat([QUIET, LOUD], 3)
    return observed(tree, chain, infos, sensors, q, rng, joint_sigma=noise, sigma={"points": 2e-4})


@pytest.mark.parametrize("seed", slow_rest([1, 2]))
def test_limbs_that_are_read_unlike_each_other_have_noise_of_their_own(seed):
    found = calibrate_tree(two_limbs(seed), effects=())
    assert not any("readings of joint" in reason for reason in judge(found).reasons)
    sigma = found.solution.noise.joint
    assert sigma[3:] == pytest.approx(LOUD, rel=0.25)
    assert sigma[:3].max() < 0.3 * LOUD
    assert not found.solution.slipped[:, 3:].mean() > 0.02


@pytest.mark.parametrize("markers", slow_rest([3, 1]))
def test_joints_of_a_chain_that_are_read_worse_than_others_do_not_count_as_slipping(markers):
    noise = np.array([QUIET, QUIET, QUIET, LOUD, LOUD, QUIET])
    arm = one_arm(7, joints=6, markers=markers, poses=100, joint_sigma=noise)
    found = calibrate_tree(arm.data, effects=())
    assert not any("readings of joint" in reason for reason in judge(found).reasons)
    sigma = found.solution.noise.joint
    if markers > 1:  # a single one may leave it to slips that are few
        assert 0.8 * LOUD < sigma[[3, 4]].max() < 1.4 * LOUD
    assert sigma[[0, 1, 2, 5]].max() < 0.6 * LOUD


def test_a_joint_that_is_read_in_another_direction_is_no_louder_one():
    arm = one_arm(7, joints=5, markers=3, poses=60)
    readings = arm.data.readings.copy()
    readings[:, 3] = -readings[:, 3] + 0.3 * np.sin(5.0 * readings[:, 3])
    found = calibrate_tree(replace(arm.data, readings=readings), effects=())
    verdict = judge(found)
    assert verdict.status == "FAIL"
    assert "readings of joint 'j4' would be wrong" in verdict.reasons[0]
    assert 3 not in found.solution.noise.loud
