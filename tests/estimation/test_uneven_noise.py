"""Joints of one body whose readings are not alike: limbs, and single joints of a chain."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import COLUMNS
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.bending.what_bends import kept_words
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.estimation.tree.contradictions.wrong_readings import noisy_gears
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_setup import Wishes

from ..slow_rest import slow_rest
from .random_arms import random_recording
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


@pytest.mark.slow
@pytest.mark.parametrize("seed", slow_rest([1, 2]))
def test_limbs_that_are_read_unlike_each_other_have_noise_of_their_own(seed):
    found = calibrate_tree(two_limbs(seed), effects=())
    assert not any("readings of joint" in reason for reason in judge(found).reasons)
    sigma = found.solution.noise.joint
    assert sigma[3:] == pytest.approx(LOUD, rel=0.25)
    assert sigma[:3].max() < 0.3 * LOUD
    assert not found.solution.slipped[:, 3:].mean() > 0.02


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(("times", "named"), [(20.0, True), (1.0, False)])
def test_a_joint_that_is_read_worse_than_others_is_named(times, named):
    noise = np.full(5, 2e-4) * np.where(np.arange(5) == 2, times, 1.0)
    arm = one_arm(11, joints=5, markers=3, poses=50, joint_sigma=noise)
    words = [
        word for word in judge(calibrate_tree(arm.data, effects=())).warnings if "play" in word
    ]
    assert ["'j3' is read" in word for word in words] == [True] * named


def geared(gear):
    """An arm of which the third joint turns as many times as far as is read."""
    arm = one_arm(2, joints=5, markers=3, poses=40, joint_sigma=np.full(5, 5e-4))
    return replace(arm.data, readings=arm.data.readings * np.where(np.arange(5) == 2, gear, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize(("gear", "named"), [(1.013, True), (1.007, False), (0.98, True)])
def test_a_gear_that_contradicts_its_unit_is_a_fault_of_the_joint_by_name(gear, named):
    data = geared(gear)
    found = calibrate_tree(data)
    said = any("`j3.gear` is held at 1" in reason for reason in judge(found).reasons)
    assert said == named
    if not named:
        assert found.tree.gear[2] == pytest.approx(gear, abs=2e-3)
        (words,) = kept_words(found.ladder, found.tree.bending, found.at)
        assert words.startswith("gears are a little off (`j3.gear` is 1.00")


@pytest.mark.slow
@pytest.mark.parametrize(("gear", "named"), [(1.03, True), (1.0, False)])
def test_a_gear_of_which_half_looks_like_noise_is_named_with_its_value(gear, named):
    noise = np.radians(0.2) * np.where(np.arange(7) == 3, 1.0 if named else 5.0, 1.0)
    arm = one_arm(0, joints=7, markers=2, poses=30, joint_sigma=noise)
    readings = arm.data.readings * np.where(np.arange(7) == 3, gear, 1.0)
    found = calibrate_tree(replace(arm.data, readings=readings), effects=())
    # Where links are described, unseen poses gain too little for the ladder to tell the gear.
    found = replace(found, ladder=replace(found.ladder, steps=()))
    assert 3 in found.solution.noise.loud
    assert any("`j4.gear` is held at 1" in reason for reason in judge(found).reasons) is named
    bend = found.ladder.solution
    for told in noisy_gears(bend.problem, bend.solution):
        assert told.value == pytest.approx(gear, abs=3.0 * told.sigma)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 7])
def test_an_arm_with_such_a_gear_is_told_so_as_a_body_is(seed):
    data = random_recording("joint noise", seed).dataset
    turned = np.arange(len(data.joints)) == len(data.joints) // 2
    data = replace(data, encoders=data.encoders * np.where(turned, 1.015, 1.0))
    reasons = judge(calibrate_kinematics(data, explain=False)).reasons
    name = data.joints[int(np.argmax(turned))].name
    assert any(f"`{name}.gear` is held at 1" in reason for reason in reasons)


@pytest.mark.slow
def test_freeing_a_gear_that_contradicts_its_unit_cures_it():
    wishes = Wishes(FixedParameters.from_text(free=["j3.gear"]))
    found = calibrate_tree(geared(1.02), wishes=wishes)
    assert not any("gear" in reason for reason in judge(found).reasons)
    assert found.tree.gear[2] == pytest.approx(1.02, abs=1e-3)


@pytest.mark.slow
def test_a_joint_that_is_read_in_another_direction_is_no_louder_one():
    arm = one_arm(7, joints=5, markers=3, poses=60)
    readings = arm.data.readings.copy()
    readings[:, 3] = -readings[:, 3] + 0.3 * np.sin(5.0 * readings[:, 3])
    found = calibrate_tree(replace(arm.data, readings=readings), effects=())
    verdict = judge(found)
    assert verdict.status == "FAIL"
    assert "readings of joint 'j4' would be wrong" in verdict.reasons[0]
    assert 3 not in found.solution.noise.loud


@pytest.mark.slow
def test_a_tracker_is_not_blamed_for_the_last_digits_of_a_robot_that_stands_still():
    read, sensor = 1e-4, 5e-6
    arm = one_arm(3, joints=6, poses=70, joint_sigma=0.0, sigma={"points": sensor})
    table, rng = arm.data.observations, np.random.default_rng(0)
    # Each pose is recorded twice: the robot stands, its encoders flicker.
    twice = np.repeat(np.arange(70), 2)
    values = table.values[twice] + [*sensor * np.ones(3), 0, 0, 0] * rng.normal(size=(140, 6))
    seen = replace(table, **{key: getattr(table, key)[twice] for key in COLUMNS})
    flicker = read * rng.normal(size=(140, 6)).clip(-1.0, 1.0)
    data = replace(
        arm.data,
        sample=np.arange(140),
        readings=arm.data.readings[twice] + flicker,
        flanges=np.asarray(arm.data.flanges)[twice],
        approach=np.asarray(arm.data.approach)[twice],
        observations=replace(seen, pose=np.arange(140), values=values),
    )
    assert len(np.unique(data.visit)) == 70
    found = calibrate_tree(data, effects=())
    assert found.noise["tracker"] == pytest.approx(sensor, rel=0.6)


def tailed(seed, markers, astray=0.0, read=2e-4):
    """An arm whose readings are five times as far off in one of twenty, any joint's; rms of all."""
    arm = one_arm(
        seed, joints=6, markers=markers, poses=100, joint_sigma=read, sigma={"points": 0.1 * read}
    )
    rng = np.random.default_rng((seed, 3))
    shape = arm.data.readings.shape
    tail = np.sqrt(24.0) * read * rng.normal(size=shape) * (rng.random(shape) < 0.05)
    table = arm.data.observations
    values = table.values.copy()
    values[:3, :3] += astray
    data = replace(
        arm.data, readings=arm.data.readings + tail, observations=replace(table, values=values)
    )
    return calibrate_tree(data, effects=()), float(np.sqrt(read**2 + np.mean(tail**2)))


@pytest.mark.parametrize(
    ("markers", "seed"), slow_rest([(3, 41), (1, 42), (3, 43), (1, 45)], plain=0)
)
def test_heavy_tails_of_all_joints_are_noise_and_no_joint_is_named(markers, seed):
    found, rms = tailed(seed, markers)
    assert not any("the encoder of" in word for word in judge(found).warnings)
    assert found.noise["j1"] > 1.05 * found.solution.noise.joint[0]
    assert found.noise["j1"] == pytest.approx(rms, rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize("seed", slow_rest([41, 43]))
def test_tails_of_joints_that_are_read_badly_count_beyond_a_hundredth_of_their_travel(seed):
    found, rms = tailed(seed, 3, read=np.radians(0.2))
    assert found.noise["j1"] == pytest.approx(rms, rel=0.12)


@pytest.mark.slow
def test_a_reading_that_is_farther_off_than_tails_reach_is_no_noise():
    arm = one_arm(7, joints=6, markers=3, poses=60)
    readings = arm.data.readings.copy()
    readings[5, 2] += 0.3
    found = calibrate_tree(replace(arm.data, readings=readings), effects=())
    assert found.solution.slipped[:, 2].sum() == 1
    assert found.noise["j1"] == found.solution.noise.joint[0]


@pytest.mark.slow
@pytest.mark.parametrize(("markers", "seed"), slow_rest([(1, 2), (1, 3), (3, 2), (3, 3)]))
def test_heavy_tails_of_a_tracker_are_no_noise_of_joints(markers, seed):
    rng = np.random.default_rng((seed, 9))
    arm = one_arm(
        seed, joints=6, markers=markers, poses=90, joint_sigma=2e-4, sigma={"points": 2e-4}
    )
    values = arm.data.observations.values.copy()
    far = rng.normal(size=(len(values), 3)) * (rng.random((len(values), 1)) < 0.05)
    values[:, :3] += np.sqrt(24.0) * 2e-4 * far
    data = replace(arm.data, observations=replace(arm.data.observations, values=values))
    found = calibrate_tree(data, effects=())
    assert found.solution.outliers.any()
    assert found.solution.slipped.any()
    assert found.noise["j1"] == found.solution.noise.joint[0]


@pytest.mark.slow
def test_observations_astray_are_no_tails_of_noise():
    found, rms = tailed(42, 1, astray=0.03)
    assert found.solution.outliers[:3].all()
    assert found.noise["j1"] == pytest.approx(rms, rel=0.25)
