"""A robot that is none is refused in one line, before Drake may end the process over it."""

import subprocess
import sys

import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant import ArmDescription

from ..slow_rest import slow_rest

ROBOT = """<?xml version="1.0"?>
<robot name="two">
  <link name="base"/>
  <link name="l1">
    <inertial><mass value="1"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="l2"/>
  <link name="tool"/>
  <joint name="j0" type="revolute"><origin xyz="0.1 0 0.2"/><parent link="base"/>
    <child link="l1"/><axis xyz="0 0 1"/>
    <limit lower="-5" upper="2" effort="1" velocity="1"/></joint>
  <joint name="j1" type="revolute"><origin xyz="0.2 0 0" rpy="1.57 0 0"/><parent link="l1"/>
    <child link="l2"/><axis xyz="0 1 0"/>
    <limit lower="-5" upper="2" effort="1" velocity="1"/></joint>
  <joint name="t" type="fixed"><origin xyz="0.2 0 0"/><parent link="l2"/>
    <child link="tool"/></joint>
</robot>
"""
LAUGHS = "".join(f'<!ENTITY a{i} "{10 * (f"&a{i - 1};" if i else "ha")}">' for i in range(10))
BAD = {
    "limits exchanged": ('lower="-5"', 'lower="5"', "j0.*lower limit 5 lies above its upper one 2"),
    "a limit nan": ('upper="2"', 'upper="nan"', "j0.*limit upper: nan is not finite"),
    "a limit inf": ('upper="2"', 'upper="inf"', "not finite; leave out what has no limit"),
    "a limit huge": ('upper="2"', 'upper="1e308"', r"1e\+308 is larger than anything"),
    "a velocity negative": ('velocity="1"', 'velocity="-1"', "velocity must not be negative"),
    "an axis zero": ('axis xyz="0 0 1"', 'axis xyz="0 0 0"', "j0': its axis is zero"),
    "an axis nan": ('axis xyz="0 0 1"', 'axis xyz="nan 0 1"', "axis xyz: nan is not finite"),
    "an axis of two": ('axis xyz="0 0 1"', 'axis xyz="0 1"', "3 numbers expected, got '0 1'"),
    "an origin of words": ('xyz="0.1 0 0.2"', 'xyz="a b c"', "'a' is not a number"),
    "xacro left over": ('lower="-5"', 'lower="${a}"', "is not a number"),
    "a mass negative": ('mass value="1"', 'mass value="-1"', "mass value: must not be negative"),
    "a box negative": ('size="0.1 0.1', 'size="-0.1 0.1', "box size: must be positive"),
    "damping negative": ("<limit", '<dynamics damping="-1"/><limit', "damping: must not be neg"),
    "a parent nowhere": ('parent link="l1"', 'parent link="l9"', "its parent 'l9' is not there"),
    "a child nowhere": ('child link="l2"', 'child link="l9"', "its child 'l9' is not there"),
    "no parent": ('<parent link="l1"/>', "", "j1' names no parent link"),
    "no type": (' type="revolute"', "", "j0' has no type"),
    "a ring": ('parent link="base"', 'parent link="tool"', "hang on each other in a ring"),
    "itself": ('child link="l2"', 'child link="l1"', "j1' hangs 'l1' on itself"),
    "two parents": ('child link="tool"', 'child link="l1"', "'l1' is the child of two joints"),
    "a link twice": ('<link name="l2"/>', '<link name="l2"/>' * 2, "link 'l2' is there twice"),
    "a joint twice": ('joint name="j1"', 'joint name="j0"', "joint 'j0' is there twice"),
    "no name": ('<link name="l2"/>', "<link/>", "a link has no name"),
    "a mimic of nothing": ("<limit", '<mimic joint="x"/><limit', "mimics 'x', which is not there"),
    "entities": ('<?xml version="1.0"?>', f"<!DOCTYPE r [{LAUGHS}]>", "no document type"),
    "a deep nest": ('<link name="l2"/>', "<a>" * 99_999, "nested more than 50 deep"),
    "nul": ('"l1"', '"l\0"', "not valid XML"),
}


def changed(tmp_path, old, new):
    assert old in ROBOT
    path = tmp_path / "robot.urdf"
    path.write_text(ROBOT.replace(old, new, 1))
    return path


@pytest.mark.parametrize(("old", "new", "message"), BAD.values(), ids=BAD)
def test_a_robot_that_is_none_is_refused_in_one_line(tmp_path, old, new, message):
    with pytest.raises(ModelError, match=message) as caught:
        ArmDescription.from_urdf(changed(tmp_path, old, new), "base", "tool")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


GOOD = {
    "as it is": ("two", "two"),
    "no limits": ('<limit lower="-5" upper="2" effort="1" velocity="1"/>', ""),
    "unlimited effort": ('effort="1"', 'effort="-1"'),
    "what cannot move has any axis": ('type="fixed">', 'type="fixed"><axis xyz="0 0 0"/>'),
    "a mesh that is not there": ('<box size="0.1 0.1 0.1"/>', '<mesh filename="gone.obj"/>'),
    "no mass": ('mass value="1"', 'mass value="0"'),
    "another root": ('<link name="l2"/>', '<link name="l2"/><link name="other"/>'),
}


@pytest.mark.parametrize(("old", "new"), GOOD.values(), ids=GOOD)
def test_what_robots_may_be_is_accepted(tmp_path, old, new):
    path = changed(tmp_path, old, new)
    if "mass" in old:
        path.write_text(path.read_text().replace('"0.01"', '"0"'))
    assert ArmDescription.from_urdf(path, "base", "tool").joints == ("j0", "j1")


@pytest.mark.parametrize(
    "name", slow_rest(["limits exchanged", "a velocity negative", "a mass negative"])
)
def test_the_command_line_says_it_and_ends_with_two(tmp_path, name):
    old, new, _ = BAD[name]
    path = changed(tmp_path, old, new)
    code = "from nico_selfmodel.cli.main import main; main()"
    words = ("learn", "--robot", path, "--base", "base", "--tip", "tool", "--out", tmp_path / "o")
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("nico-selfmodel: ")
    assert not (tmp_path / "o").exists()
