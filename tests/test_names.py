"""Names are refused where a terminal would obey them, and listed so that a person reads them."""

import re
import time

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.cameras.camera_options import by_full_name
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import (
    LONGEST_NAME,
    called,
    check_name,
    did_you_mean,
    listed,
    refuse_unknown,
    shown,
)

OBEYED = ["\x1b[31mred", "a\nb", "a\rb", "\x00", "a\u202eb", "\x9b1m", "a\u2028b", "\ud800"]


@pytest.mark.parametrize("name", ["left arm: no. 1", "ünïcode", "漢", "=x", "a" * LONGEST_NAME])
def test_what_people_call_things_is_a_name(name):
    check_name(name, "a name")


@pytest.mark.parametrize("name", [*OBEYED, "", " ", " a", "a ", "a" * (LONGEST_NAME + 1), 3, None])
def test_what_a_terminal_obeys_or_nobody_reads_is_none(name):
    with pytest.raises(ValueError, match="a name must") as caught:
        check_name(name, "a name")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 250


def model_with(name="m", joint="a", marker="hand", mirror=None):
    chain = Chain((joint, "b"), np.eye(3)[:2], np.zeros((2, 3)), (marker,), np.ones((1, 3)))
    servos = ServoMap((joint, "b"), [0, 0], [1, 1], ("rad", "rad"), [np.nan] * 2, [1, 1])
    mirrors = {} if mirror is None else {mirror: Mirror(np.array([0.0, 0.0, -1.0]), 0.3)}
    return SelfModel(name, DhTable.from_chain(chain), servos, mirrors=mirrors)


def dataset_with(name="d", joint="a", marker="hand", mirror=""):
    return Dataset(
        name=name,
        joints=(JointInfo(joint, "rad"),),
        sample=np.array([1]),
        encoders=np.zeros((1, 1)),
        marker=np.array([marker]),
        mirror=np.array([mirror]),
        pixels=np.ones((1, 4)),
    )


@pytest.mark.parametrize("make", [model_with, dataset_with])
@pytest.mark.parametrize("what", ["name", "joint", "marker", "mirror"])
def test_nothing_has_such_a_name(make, what):
    make()
    for name in OBEYED[:3]:
        with pytest.raises((ValueError, DataError), match="must be printable text"):
            make(**{what: name})


@pytest.mark.parametrize(
    "words",
    [
        ("calibrate", "kinematics", "data"),
        ("calibrate", "stereo", "data", "--board", "9x6", "--square-mm", "25"),
        ("calibrate", "camera", "data", "--board", "9x6", "--square-mm", "25"),
        ("calibrate", "body", "data", "--model", "m"),
        ("calibrate", "mirror", "data", "--model", "m"),
        ("import", "csv", "table.csv", "--map", "map.yaml"),
        ("import", "vicon", "table.csv", "--encoders", "e.csv"),
    ],
)
def test_no_command_takes_one(command, tmp_path, words):
    done = command(*words, "--out", tmp_path / "out", "--name", "\x1b[2Jgone")
    assert done.returncode == 2
    assert "--name must be printable text" in done.stderr
    assert "\x1b" not in done.stderr


def test_a_folder_that_gives_its_name_must_have_one(command, tmp_path):
    for words in (("record", "--out"), ("simulate", "motion-capture", "--out")):
        done = command(*words, tmp_path / "a\x1b[2Jb")
        assert done.returncode == 2
        assert "must be printable text" in done.stderr
        assert "\x1b" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_few_names_are_listed_and_of_many_those_that_are_meant():
    assert listed(["a", "b"]) == "a, b"
    assert listed("abcdefgh") == "a, b, c, d, e, f, g, h"
    many = [f"joint_{i}.{part}" for i in range(7) for part in ("D", "r", "alpha", "gear")]
    assert listed(many).endswith(", ... and 20 more")
    assert listed(many, "joint_5.gaer").startswith("joint_5.gear, ")
    assert len(listed(many)) < 150


def test_a_refusal_does_not_list_seventy_names():
    names = [f"joint_{i}.{part}" for i in range(7) for part in ("D", "r", "alpha", "beta", "gear")]
    with pytest.raises(ValueError, match=r"did you mean 'joint_5\.gear'") as caught:
        by_full_name({"joint_5.gaer": 0.0}, tuple(names))
    assert "... and 32 more" in str(caught.value)
    assert len(str(caught.value)) < 300


def test_a_long_value_is_shown_short_and_guessed_at_quickly():
    assert len(shown(["x" * 10**6] * 10**5)) < 700
    assert len(shown(10**1000)) < 60
    began = time.perf_counter()
    assert did_you_mean("x" * 10**6, ["a" * 10**6, "b"]) == ""
    assert time.perf_counter() - began < 0.5


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("elbw", "no joint 'elbw', did you mean 'elbow'? There are elbow, wrist"),
        ("nose", "no joint 'nose'; there are elbow, wrist"),
    ],
)
def test_an_unknown_name_is_refused_with_those_that_exist(name, words):
    refuse_unknown("joint", "wrist", ("elbow", "wrist"))
    with pytest.raises(ValueError, match=f"^{re.escape(words)}$"):
        refuse_unknown("joint", name, ("elbow", "wrist"))
    with pytest.raises(ValueError, match="there are none"):
        refuse_unknown("joint", name, ())


def test_a_name_that_says_what_it_is_says_it_once():
    assert (called("joint", "elbow"), called("joint", "joint_1")) == ("joint elbow", "joint_1")
