"""Joints of a body that are read as others than stated are named, by learning it mended."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.contradictions import mended_readings
from nico_selfmodel.estimation.tree.guesses.start_search import searched_start
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_setup import Wishes, blank_body
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform

from .simulated_trees import assembled, observed, one_arm, serial, tags


def read_in(data, stated, mistaken):
    """The recording with all joints stated in one unit, and some read in the other."""
    readings = data.readings.copy()
    for i in range(len(data.joints)):
        if (stated == "deg") != (i in mistaken):
            readings[:, i] = np.degrees(readings[:, i])
    joints = tuple(replace(joint, encoder_unit=stated) for joint in data.joints)
    return replace(data, readings=readings, joints=joints)


@pytest.mark.parametrize(
    ("stated", "read", "mistaken"),
    [
        ("rad", "deg", {1}),
        pytest.param("deg", "rad", {2}, marks=pytest.mark.slow),
        pytest.param("deg", "rad", {0, 3}, marks=pytest.mark.slow),
    ],
)
def test_joints_in_another_unit_are_named_and_no_others(stated, read, mistaken):
    data = one_arm(11, joints=4, markers=2, poses=40).data
    with pytest.raises(DataError) as raised:
        calibrate_tree(read_in(data, stated, mistaken), effects=())
    names = ", ".join(f"j{i + 1}" for i in sorted(mistaken))
    verb = "is" if len(mistaken) == 1 else "are"
    assert str(raised.value).startswith(f"{names} {verb} read in {read}, not in {stated}")


@pytest.mark.slow
def test_all_joints_in_another_unit_are_named_together():
    data = one_arm(11, joints=3, markers=2, poses=40).data
    with pytest.raises(DataError, match="j1, j2, j3 are read in rad, not in deg"):
        calibrate_tree(read_in(data, "deg", {0, 1, 2}), effects=())


def exchanged(data):
    order = [1, 0, 2] if len(data.joints) == 3 else [0, 2, 1, 3]
    return replace(data, readings=data.readings[:, order])


def turned_about(data):
    return replace(data, readings=data.readings[:, ::-1])


def of_the_sample_before(data):
    return replace(data, readings=np.roll(data.readings, 1, axis=0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "sensor", "named"),
    [
        (exchanged, "points", "the readings of j1 and j2 are exchanged; then 0"),
        (exchanged, "cameras", "of j2 and j3 are exchanged"),
        (turned_about, "points", "hand to the base, j1 first"),
        (of_the_sample_before, "points", "sample after"),
    ],
)
def test_readings_that_are_other_joints_or_samples_are_named(spoil, sensor, named):
    joints = 3 if sensor == "points" and spoil is exchanged else 4
    data = one_arm(11, joints=joints, markers=3, sensor=sensor).data
    with pytest.raises(DataError, match=f"no body explains data set .*{named}"):
        calibrate_tree(spoil(data), effects=())


def two_limbs(seed, joint_deg=0.02):
    """Two arms of three joints on a torso that turns, before a tracker."""
    rng = np.random.default_rng(seed)
    joints, frames = serial(rng, ["torso"], "world", 0.3)
    markers, places = [], []
    for side, sign in (("l", 1.0), ("r", -1.0)):
        names = [f"{side}{i + 1}" for i in range(3)]
        base = transform(rotation_from_vector([-sign * np.pi / 2, 0.2, 0]), [0, sign * 0.15, 0.25])
        chain, X = serial(rng, names, "torso", 0.4, base)
        own, at = tags(rng, side, names[-1], 2)
        joints, frames, markers, places = joints + chain, frames + X, markers + own, places + at
    sensors = [SensorInfo("tracker", "points")]
    tree = assembled(joints, frames, markers, places, sensors, [np.eye(4)], {})
    q = rng.uniform(-1.2, 1.2, (60, 7)) * ([0.5] + [1.0] * 6)
    how = {"sigma": {"points": 2e-4, "turn": 2e-3}, "joint_sigma": np.radians(joint_deg)}
    return observed(tree, joints, markers, sensors, q, rng, **how)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "read", "named"),
    [
        ([2, 6], [6, 2], "the readings of l2 and r3 are exchanged; then 0"),
        ([5, 6], [6, 5], "the readings of r2 and r3 are exchanged; then 0"),
        ([4, 5, 6], None, "the readings of r1, r2, r3 lag: each point fits theirs of"),
        ([*range(1, 7)], None, "the readings of l1, l2, l3, r1, r2, r3 lag: each point fits"),
        ([*range(7)], None, "the readings lag: each point fits the readings of the sample after"),
    ],
)
def test_readings_of_another_limb_or_late_in_a_limb_are_named(changed, read, named):
    data = two_limbs(5)
    readings, rows = data.readings.copy(), np.arange(len(data.sample))
    then = np.roll(rows, 1) if read is None else rows
    readings[:, changed] = data.readings[then][:, read or changed]
    with pytest.raises(DataError, match=f"no body explains data set .*{named}"):
        calibrate_tree(replace(data, readings=readings), effects=())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "spoiled", "cost", "asked"),
    [
        (0.02, [], 3.9, False),
        (0.02, [], 4.1, True),
        (0.4, [], 3.9, False),
        (0.9, [], 3.9, True),
        (0.02, [5, 6], 1.4, True),
    ],
)
def test_limbs_are_asked_alone_only_where_the_first_body_or_a_limb_of_it_is_poor(
    monkeypatch, noise, spoiled, cost, asked
):
    data, limbs = two_limbs(5, noise), []
    readings = data.readings.copy()
    readings[:, spoiled] = readings[:, spoiled[::-1]]
    data = replace(data, readings=readings)
    found = searched_start(data, blank_body(data, {}), None, Wishes(), 0, most=1)
    found = replace(found, start=replace(found.start, cost=cost * found.scalars))
    monkeypatch.setattr(mended_readings, "refuse_misread_limbs", lambda *_: limbs.append(1))
    mended_readings.start_as_it_was_read(data, np.ones(7, dtype=bool), lambda *_: found)
    assert bool(limbs) == asked


@pytest.mark.slow
@pytest.mark.parametrize("first", [36, pytest.param(48, marks=pytest.mark.slow)])
@pytest.mark.parametrize("stands", [True, False])
def test_an_encoder_that_stands_still_from_a_sample_on_is_named(first, stands):
    data = one_arm(3, joints=3, markers=3, poses=60).data
    readings = data.readings.copy()
    readings[first:, 1] = readings[first, 1] if stands else readings[first:, 1][::-1]
    try:
        reasons = judge(calibrate_tree(replace(data, readings=readings), effects=())).reasons
    except DataError as error:  # what stands in too many samples is refused
        reasons = (str(error),)
    assert any(re.search("the encoder of '?j2'? stands at", one) for one in reasons) is stands


@pytest.mark.slow
def test_a_joint_that_really_turned_little_is_believed():
    sim = one_arm(12, joints=4, markers=2, poses=40)
    q = sim.readings_true * [1.0, 0.02, 1.0, 1.0]
    rng, how = np.random.default_rng(12), {"joint_sigma": 2e-4, "sigma": {"points": 2e-4}}
    data = sim.data
    still = observed(sim.tree, data.joints, data.markers, data.sensors, q, rng, **how)
    found = calibrate_tree(read_in(still, "deg", set()), effects=())
    assert 1e3 * np.median(found.train.by_row()) < 1.0
