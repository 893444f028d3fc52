"""Driving a body through poses makes a data set of what it sensed."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.planning.plans import given_commands, random_commands, sweep_commands
from nico_selfmodel.recording.session import record
from nico_selfmodel.systems.measurements import Measurement

JOINTS = (
    JointInfo("base", "counts", 1000.0, -400.0, 400.0),
    JointInfo("tip", "counts", 1000.0, -100.0, 300.0),
)


@dataclass
class Body:
    """A body whose marker can be lost for some visits."""

    lost: int = 0
    joints: tuple = JOINTS
    markers: tuple = ("hand", "elbow")
    visits: list = field(default_factory=list)

    def move_and_measure(self, command):
        self.visits.append(np.asarray(command))
        seen = len(self.visits) > self.lost
        p = np.array([*command, 0.0]) * 1e-3
        return Measurement(np.asarray(command), {"hand": p if seen else None, "elbow": None})


def test_sweeps_turn_one_joint_about_home_and_stay_between_the_stops():
    home = np.array([0.0, 50.0])
    plan = sweep_commands(JOINTS, home, [200.0, 600.0], [4, 5], home_repeats=2)
    labels = [label for label, _ in plan]
    assert labels == ["home"] * 2 + ["base"] * 4 + ["tip"] * 5
    commands = np.array([command for _, command in plan])
    assert commands[2:6, 0] == pytest.approx([-100.0, -100.0 / 3, 100.0 / 3, 100.0])
    assert np.all(commands[2:6, 1] == 50.0)
    assert commands[6:, 1].min() == -100.0
    assert commands[6:, 1].max() == 300.0
    assert not np.any(commands[6:, 1] == 50.0)


def test_random_poses_stay_between_the_stops_and_come_from_the_seed():
    a, b = (
        random_commands(JOINTS, [0.0, 0.0], [1e6, 100.0], 200, np.random.default_rng(1))
        for _ in range(2)
    )
    commands = np.array([command for _, command in a])
    assert np.array_equal(commands, [command for _, command in b])
    assert np.abs(commands[:, 0]).max() <= 400.0
    assert np.abs(commands[:, 1]).max() <= 50.0
    assert {label for label, _ in a} == {""}


def test_a_recording_holds_every_pose_and_marker_and_leaves_lost_ones_empty():
    body, done = Body(), []
    plan = [("home", np.array([0.0, 0.0])), ("", np.array([10.0, 20.0]))]
    data = record(body, plan, "trial", progress=lambda *step: done.append(step))
    assert data.marker.tolist() == ["hand", "elbow"] * 2
    assert data.sample.tolist() == [1, 1, 2, 2]
    assert data.measured.tolist() == [True, False, True, False]
    assert data.p_WH_measured[2] == pytest.approx([0.01, 0.02, 0.0])
    assert done == [(1, 2), (2, 2)]


def test_a_pose_is_visited_until_it_is_seen_and_given_up_in_the_end():
    plan = [("", np.array([1.0, 2.0])), ("", np.array([3.0, 4.0]))]
    body = Body(lost=2)
    assert len(record(body, plan, "trial", until_seen=3)) == 4
    assert len(body.visits) == 4
    patient = Body(lost=3)
    data = record(patient, plan, "trial", until_seen=3)
    assert data.encoders[0].tolist() == [3.0, 4.0]


def test_a_recording_in_which_nothing_was_seen_is_an_error():
    with pytest.raises(DataError):
        record(Body(lost=100), [("", np.array([1.0, 2.0]))], "trial", until_seen=2)


def test_poses_that_somebody_chose_are_visited_as_they_are_or_refused_by_number():
    joints = [JointInfo("a", "rad", None, -1.0, 1.0), JointInfo("b", "deg")]
    poses = np.array([[0.5, 400.0], [-1.0, 0.0]])
    plan = given_commands(joints, poses)
    assert [label for label, _ in plan] == ["", ""]
    assert np.array([command for _, command in plan]) == pytest.approx(poses, abs=0.0)
    with pytest.raises(ValueError, match=r"pose 2 of 2: a would go to -1.1, its stops are at -1"):
        given_commands(joints, poses - [[0.0, 0.0], [0.1, 0.0]])
    for wrong in (np.zeros((0, 2)), np.zeros((3, 3)), np.zeros(2)):
        with pytest.raises(ValueError, match="must have shape"):
            given_commands(joints, wrong)
