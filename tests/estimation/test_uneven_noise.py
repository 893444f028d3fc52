"""Joints of one body whose readings are not alike: limbs, and single joints of a chain."""

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from .simulated_trees import assembled, observed, serial, tags

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


@pytest.mark.parametrize("seed", [1, 2])
def test_limbs_that_are_read_unlike_each_other_have_noise_of_their_own(seed):
    found = calibrate_tree(two_limbs(seed), effects=())
    assert not any("readings of joint" in reason for reason in judge(found).reasons)
    sigma = found.solution.noise.joint
    assert sigma[3:] == pytest.approx(LOUD, rel=0.25)
    assert sigma[:3].max() < 0.3 * LOUD
    assert not found.solution.slipped[:, 3:].mean() > 0.02
