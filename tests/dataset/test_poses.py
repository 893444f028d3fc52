"""Which rows are one pose, and what of a test set is held out."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.held_out import held_out_of
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.poses import mean_of_visits, pose_numbers
from nico_selfmodel.errors import DataError

JOINTS = (JointInfo("a", "rad", None), JointInfo("b", "rad", None))


def dataset(encoders, points=None, samples=None, name="set"):
    encoders = np.asarray(encoders, dtype=float)
    count = len(encoders)
    points = np.arange(3.0 * count).reshape(count, 3) if points is None else points
    samples = np.arange(count) if samples is None else samples
    return Dataset(name, JOINTS, np.asarray(samples), encoders, points)


def test_equal_readings_are_one_pose_wherever_they_stand_and_each_stay_is_a_visit():
    readings = [[0, 0], [1, 1], [1, 1], [5, 5], [0, 0], [5, 5]]
    pose, visit = pose_numbers(np.arange(6), np.array(readings, dtype=float))
    assert pose.tolist() == [0, 1, 1, 2, 0, 2]
    assert visit.tolist() == [0, 1, 1, 2, 3, 4]


def test_a_robot_that_stands_still_but_for_the_last_digits_is_at_one_pose():
    readings = np.array([[0, 0], [1, 1], [1 + 4e-5, 1], [1 + 2e-4, 1], [1, 1]])
    pose, visit = pose_numbers(np.arange(5), readings)
    assert pose.tolist() == [0, 1, 1, 2, 1]
    assert visit.tolist() == [0, 1, 1, 2, 3]


def test_readings_of_a_robot_that_stands_still_are_their_mean_and_others_stay():
    readings = np.array([[0.0, 1.0], [2.0, 0.3], [2.0001, 0.30001], [5.0, -1.0], [0.0, 1.0]])
    visit = pose_numbers(np.arange(5), readings)[1]
    mean = mean_of_visits(readings, visit)
    np.testing.assert_allclose(mean[1:3], [[2.00005, 0.300005]] * 2, rtol=1e-12)
    assert (mean[[0, 3, 4]] == readings[[0, 3, 4]]).all()


def test_a_slow_motion_is_no_stand():
    readings = np.linspace(0.0, 1.0, 50001)[:, None] * np.ones(2)
    pose, _ = pose_numbers(np.arange(50001), readings)
    assert pose.max() > 9000


@given(st.permutations(range(12)))
def test_the_order_of_rows_does_not_matter(order):
    order = np.array(order)
    readings = np.random.default_rng(0).integers(0, 3, (12, 2)).astype(float)
    samples = np.arange(12) * 3
    pose, visit = pose_numbers(samples, readings)
    shuffled = pose_numbers(samples[order], readings[order])
    assert (shuffled[0] == pose[order]).all()
    assert (shuffled[1] == visit[order]).all()


def test_a_split_never_parts_equal_readings():
    readings = np.repeat(np.random.default_rng(1).uniform(size=(20, 2)), 5, axis=0)
    order = np.random.default_rng(2).permutation(100)
    whole = dataset(readings[order])
    for seed in range(10):
        train, test = whole.split(0.3, seed)
        assert len(test) == 30
        assert not {tuple(r) for r in train.encoders} & {tuple(r) for r in test.encoders}


def test_rows_that_were_learned_from_are_refused_as_held_out():
    readings = np.random.default_rng(1).uniform(size=(10, 2))
    train = dataset(readings)
    again = replace(train.select(np.arange(4, 8)), name="other", sample=np.arange(4))
    with pytest.raises(DataError, match="4 of 4 rows of data set 'other' stand in 'set' too"):
        held_out_of(train, again)


def test_poses_that_were_learned_from_are_not_held_out():
    readings = np.random.default_rng(1).uniform(size=(10, 2))
    train = dataset(readings[:6])
    other = dataset(readings[4:], points=np.random.default_rng(3).uniform(size=(6, 3)))
    assert held_out_of(train, other).encoders.tolist() == readings[6:].tolist()
    with pytest.raises(DataError, match="no pose that 'set' has not"):
        held_out_of(train, other.select([0, 1]))
    assert held_out_of(dataset(readings[:4]), other) is other
