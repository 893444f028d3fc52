"""Arms of any build are learned from free poses alone, also where a wrong minimum attracts more."""

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.model.arm.chain import Chain

NOISE = 1e-3


def industrial_arm(rng, joints, markers):
    """Return an arm whose axes lie along the coordinate axes in some order."""
    directions = np.eye(3)[rng.integers(0, 3, joints)]
    lever = rng.uniform(0.05, 0.2)
    points = np.cumsum(lever * rng.normal(size=(joints, 3)), axis=0)
    hands = points[-1] + lever * rng.normal(size=(markers, 3))
    names = tuple(f"joint{i}" for i in range(joints))
    return Chain(names, directions, points, tuple(f"m{k}" for k in range(markers)), hands)


def free_poses(chain, poses, rng):
    """Return poses of an arm with encoders in degrees, a zero of their own, and some noise."""
    n, m = len(chain.joints), len(chain.markers)
    span = np.radians(rng.uniform(30.0, 100.0, n))
    q = rng.uniform(-span, span, (poses, n)) + rng.uniform(-1.0, 1.0, n)
    readings = np.degrees(q + rng.uniform(-1.0, 1.0, n))
    marker = np.tile(np.arange(m), poses)
    p = chain.forward(np.repeat(q, m, axis=0), marker)
    rows = poses * m
    return Dataset(
        name="free poses",
        joints=tuple(JointInfo(name=name, encoder_unit="deg") for name in chain.joints),
        sample=np.repeat(np.arange(poses), m),
        sweep=np.full(rows, ""),
        marker=np.array(chain.markers)[marker],
        mirror=np.full(rows, ""),
        encoders=np.repeat(readings, m, axis=0),
        p_WH_measured=p + rng.normal(0.0, NOISE, (rows, 3)),
        pixels=np.full((rows, 4), np.nan),
    )


def learned(seed, joints, markers, poses):
    rng = np.random.default_rng(seed)
    data = free_poses(industrial_arm(rng, joints, markers), poses, rng)
    train, test = data.split(0.3, 0)
    return calibrate_kinematics(train, test=test)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "joints", "markers", "poses"),
    [(65, 3, 2, 130), (211, 5, 2, 129), (277, 3, 1, 43), (0, 2, 1, 40), (1, 7, 2, 90)],
)
def test_the_right_minimum_is_found_although_others_attract_more_starts(
    seed, joints, markers, poses
):
    result = learned(seed, joints, markers, poses)
    assert judge(result).status == "PASS"
    assert result.test.statistics.rms < 1.3 * np.sqrt(3.0) * NOISE
