"""Recordings whose readings were taken wrongly: the way is told, and no joint is called changed."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.monitoring.body_health import check_body_health
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.estimation.monitoring.health_document import health_document
from nico_selfmodel.estimation.monitoring.misread import ReadPoses, off_by_mended
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_result import body_model

from .arms_that_change import CELLS, learned_arm, session
from .simulated_trees import one_arm

WORLD, SEED, POSES = CELLS["clean"], 7300, 30


def late(readings):
    return np.roll(readings, 1, axis=0)


def other_sign(readings):
    return readings * np.where(np.arange(readings.shape[1]) == 1, -1.0, 1.0)


def exchanged(readings):
    return readings[:, [0, 2, 1, *range(3, readings.shape[1])]]


def other_unit(readings):
    return np.degrees(readings)


def other_unit_of_one(readings):
    return np.where(np.arange(readings.shape[1]) == 2, np.degrees(readings), readings)


def frozen(readings):
    stuck = readings.copy()
    stuck[8:, 1] = readings[8, 1]
    return stuck


WAYS = {
    late: "the readings lag: each point fits the readings of the sample after its own",
    other_sign: "the readings of {1} have the other sign than in training",
    exchanged: "the readings of {1} and {2} are exchanged",
    other_unit: "joints are read in deg, not in rad as stated",
    other_unit_of_one: "{2} is read in deg, not in rad as stated",
    frozen: "the encoder of {1} stands at",
}


@cache
def body():
    """Return a learned body before a tracker, and a recording of it that it was not learned by."""
    sim = one_arm(SEED, joints=5, markers=3, poses=90)
    train, test = sim.data.split(2.0 / 3.0, 0)
    return body_model(calibrate_tree(train)), test


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_a_body_says_how_its_readings_were_taken_wrongly(way):
    model, test = body()
    found = check_body_health(model, replace(test, readings=way(np.asarray(test.readings))))
    assert not found.healthy
    assert WAYS[way].format(*test.joint_names) in found.misread
    assert found.diagnoses == ()


@pytest.mark.parametrize("way", [late, other_sign, exchanged, frozen], ids=lambda way: way.__name__)
def test_an_arm_that_is_read_in_counts_says_how_its_readings_were_taken_wrongly(way):
    model, data = learned_arm(WORLD, SEED), session(WORLD, SEED, 3, POSES)
    found = check_health(model, replace(data, encoders=way(data.encoders)), "points")
    document = health_document(found)
    assert document["status"] == "FAIL"
    assert WAYS[way].format(*data.joint_names) in document["reasons"][0]
    assert document["causes"] == []


@pytest.mark.parametrize(("fitting", "told"), [(0.8, True), (0.7, False)])
def test_mended_readings_fit_in_three_of_four_poses(fitting, told):
    readings = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 2))

    def off_by(tried):
        right = np.allclose(tried, readings[:, ::-1])
        return np.where(np.arange(100) < 100 * fitting, 1.0 if right else 30.0, 1e4)

    read = ReadPoses(("a", "b"), ("deg", "deg"), np.arange(20), readings, off_by)
    words = read.misread(np.arange(20))
    assert (words == "the readings of a and b are exchanged; then the poses fit") == told


def test_a_pose_that_is_further_off_than_any_was_as_read_does_not_fit():
    def read(readings):
        far = np.where(np.arange(4)[:, None] < 2, readings[:4], 1e7 * (readings[:4] - 10.0))
        dof = np.ones(4, dtype=int)
        return SimpleNamespace(residuals=far, dof=dof, innovations=np.full(4, 0.1))

    def broken(readings):
        raise DataError("nothing was seen")

    off_by_mended(broken, len, np.zeros((4, 1)))  # of a healthy body nothing is asked
    off_by = off_by_mended(read, lambda poses: poses.innovations, np.full((4, 1), 10.0))
    assert off_by(np.full((4, 1), 10.0)).tolist() == [0.1] * 4
    assert off_by(np.full((4, 1), -9.0)).tolist() == [0.1, 0.1, np.inf, np.inf]


def test_poses_that_show_nothing_once_they_are_mended_do_not_fit():
    readings = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 2))

    def off_by(tried):
        return np.full(5, 30.0) if np.array_equal(tried, readings) else np.zeros(0)

    read = ReadPoses(("a", "b"), ("deg", "deg"), np.arange(20), readings, off_by)
    assert read.misread(np.arange(20)) is None


def test_columns_of_joints_that_are_read_in_other_units_may_be_exchanged():
    readings = np.random.default_rng(2).uniform(-60.0, 60.0, (20, 3)) * [30.0, 1.0, 1.0]

    def off_by(given):
        return np.mean((given - readings) ** 2, axis=1)

    swapped = readings[:, [1, 0, 2]]
    units = ("counts", "deg", "deg")
    read = ReadPoses(("shoulder", "elbow", "roll"), units, np.arange(20), swapped, off_by)
    words = "the readings of shoulder and elbow are exchanged; then the poses fit"
    assert read.misread(np.arange(20)) == words


def test_sound_readings_and_a_joint_that_slipped_are_not_called_misread():
    model, test = body()
    assert check_body_health(model, test).misread is None
    slipped = np.array(test.readings)
    slipped[:, 1] += np.radians(40.0)
    found = check_body_health(model, replace(test, readings=slipped))
    assert found.misread is None
    assert found.diagnoses[0].hypothesis.cause == f"zero of {test.joint_names[1]}"


@pytest.mark.parametrize(
    ("stated", "mended", "told"), [(26.0, 3.9, True), (24.0, 1.0, False), (26.0, 4.1, False)]
)
def test_only_readings_that_are_far_off_and_fit_once_mended_are_misread(stated, mended, told):
    readings = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 2))

    def off_by(tried):
        right = tried.shape == readings.shape and np.allclose(tried, readings[:, ::-1])
        return np.full(5, mended if right else stated)

    read = ReadPoses(("a", "b"), ("deg", "deg"), np.arange(20), readings, off_by)
    words = read.misread(np.arange(20))
    assert (words is not None) == told
    if told:
        assert words == "the readings of a and b are exchanged; then the poses fit"
