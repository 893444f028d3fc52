"""A recording whose joints hang on or follow others than a description has them is refused."""

import re

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.tree.tree_setup import blank_body
from nico_selfmodel.plant.described_body import described_body

JOINT = """<link name="l_{name}"/><joint name="{name}" type="revolute"><parent link="l_{parent}"/>
<child link="l_{name}"/><origin xyz="0.1 0 0.2"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/>{mimic}</joint>"""
JOINTS = (
    ("upper", "base", ""),
    ("fore", "upper", ""),
    ("level", "fore", '<mimic joint="passive" multiplier="2"/>'),
    ("passive", "upper", '<mimic joint="fore" multiplier="-0.55"/>'),
    ("hand", "level", ""),
    ("other", "base", ""),
)


@pytest.fixture
def urdf(tmp_path):
    joints = (JOINT.format(name=n, parent=p, mimic=mimic) for n, p, mimic in JOINTS)
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="arm"><link name="l_base"/>{"".join(joints)}</robot>')
    return path


def described(urdf, *joints):
    """The body of a recording with these joints as the description has it."""
    table = ObservationTable([0], [0], [0], [-1], [[0.0, 0.0, 0.0, *[np.nan] * 3]])
    markers, sensors = (MarkerInfo("tag", joints[-1].name),), (SensorInfo("tracker", "points"),)
    readings = [[0.0 if joint.is_read else np.nan for joint in joints]]
    data = BodyDataset("arm", joints, markers, sensors, [0], readings, table)
    return described_body(urdf, joints, blank_body(data, {}))


UPPER, FORE = LinkJoint("upper"), LinkJoint("fore", parent="upper")
HAND = LinkJoint("hand", parent="level")


def level(**follows):
    return LinkJoint("level", parent="fore", follows=follows)


def test_a_recording_that_says_the_same_is_described(urdf):
    joints = (UPPER, FORE, level(fore=-1.1), HAND, LinkJoint("other"))
    assert described(urdf, *joints).joints == ("upper", "fore", "level", "hand", "other")


def test_joints_that_do_not_move_may_be_left_out(urdf):
    assert described(urdf, UPPER, LinkJoint("hand", parent="upper")).parent.tolist() == [-1, 0]


def test_a_joint_that_mimics_may_be_read(urdf):
    described(urdf, UPPER, FORE, LinkJoint("level", parent="fore"), HAND)


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        (
            (UPPER, LinkJoint("other", parent="upper")),
            "joint 'other' is carried by 'upper' in the data set, by 'world' in ",
        ),
        (
            (UPPER, FORE, LinkJoint("hand", parent="upper")),
            "joint 'hand' is carried by 'upper' in the data set, by 'fore' in ",
        ),
        (
            (UPPER, FORE, LinkJoint("hand", parent="fore")),
            "{name: level, parent: fore, motion: revolute, follows: {fore: -1.1}}",
        ),
        (
            (UPPER, FORE, level(fore=-1.0), HAND),
            "joint 'level' follows {fore: -1} in the data set, {fore: -1.1} in ",
        ),
        (
            (UPPER, FORE, level(upper=-1.1), HAND),
            "joint 'level' follows {upper: -1.1} in the data set, {fore: -1.1} in ",
        ),
    ],
)
def test_a_recording_of_another_structure_is_refused(urdf, joints, words):
    with pytest.raises(ModelError, match=re.escape(words)):
        described(urdf, *joints)
