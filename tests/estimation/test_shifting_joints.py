"""Joints that shift what they carry, found from nothing among those that turn."""

import numpy as np
import pytest

from nico_selfmodel.estimation.initialization.axis_search import random_starts
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.tree.tree_motion import TreeMotion

from ..slow_rest import slow_rest
from .simulated_trees import one_arm

SCARA = "rrsr"
RAIL = "srrrrrr"
GANTRY = "sss"


def calibrated(kind, seed, poses=50, **how):
    shifts = np.array([letter == "s" for letter in kind])
    arm = one_arm(seed, joints=len(kind), shifts=shifts, poses=poses + 20, **how)
    first = np.arange(poses + 20) < poses
    found = calibrate_tree(arm.data.select(first), test=arm.data.select(~first), effects=())
    verdict = judge(found)
    assert verdict.status == "PASS", verdict.reasons
    return arm, found


@pytest.mark.parametrize("kind", slow_rest([SCARA, RAIL, GANTRY]))
def test_joints_that_shift_are_found_from_what_a_tracker_saw(kind):
    arm, found = calibrated(kind, 3, markers=2)
    shifts = [i for i, letter in enumerate(kind) if letter == "s"]
    assert found.tree.gear[shifts].tolist() == [1.0] * len(shifts)
    # Both trees are told in the tracker's frame.
    table = arm.data.observations
    told, true = (
        TreeMotion.at(tree, arm.data.readings).points(table.marker, table.pose)
        for tree in (found.tree, arm.tree)
    )
    assert np.linalg.norm(told - true, axis=1).mean() < 1e-3


def test_what_shifts_is_told_by_its_direction_alone():
    _, found = calibrated(SCARA, 5, markers=2)
    told = {joint["name"]: joint for joint in to_json(found, judge(found))["joints"]}
    assert told["j2"]["axis_distance_mm"] > 0.0
    for beside in ("j3", "j4"):
        assert told[beside]["axis_distance_mm"] is None
        assert 0.0 <= told[beside]["axis_angle_deg"] <= 180.0


@pytest.mark.slow
def test_the_travel_of_a_joint_tells_cameras_how_large_everything_is():
    arm, found = calibrated(RAIL, 4, sensor="camera", markers=3)
    assert found.setup.scale_from == "j1 (travel)"
    true, learned = (
        np.linalg.norm(np.subtract(*(s.X_LA[:3, 3] for s in tree.sensors)))
        for tree in (arm.tree, found.tree)
    )
    assert learned == pytest.approx(true, rel=0.01)


def test_the_search_finds_shifts_between_turns_to_rounding():
    rng = np.random.default_rng(0)
    shifting = np.array([False, True, False, True])
    arm = one_arm(5, joints=4, shifts=shifting, markers=2, poses=40, joint_sigma=0.0)
    table, q = arm.data.observations, arm.data.readings
    exact = TreeMotion.at(arm.tree, q).points(table.marker, table.pose)
    names, nan = arm.data.joint_names, np.full(4, np.nan)
    observations = Observations(
        names,
        ("a", "b"),
        q[table.pose],
        table.marker,
        exact,
        table.pose,
        table.pose,
        table.pose,
        np.arange(len(table)),
        np.zeros((len(table), 4)),
        ServoMap(names, np.zeros(4), np.ones(4), ("rad",) * 4, nan, np.ones(4)),
    )
    known = np.ones(4, dtype=bool)
    drawn = random_starts(observations, known, np.zeros(4), rng, shifting=shifting)
    arms = [next(drawn) for _ in range(12)]
    lengths = np.array([found.gear[shifting] for found in arms])
    best = np.abs(lengths - 1.0).max(axis=1).argmin()
    assert lengths[best] == pytest.approx(1.0, abs=1e-6)
    # As far from each other as the true axes are turned.
    true = TreeMotion.at(arm.tree, np.zeros((1, 4))).R_WL[:4, :, 2, 0]
    assert np.abs(arms[best].chain.directions @ arms[best].chain.directions.T) == pytest.approx(
        np.abs(true @ true.T), abs=1e-6
    )
