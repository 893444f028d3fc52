from pathlib import Path

import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant import robots
from nico_selfmodel.plant.robots import ROBOTS, find_robot, named_arm


def test_nico_is_found_by_name_and_any_robot_by_its_path(project_root, tmp_path):
    assert find_robot("nico").name == "nico.urdf"
    assert find_robot("nico").read_text().startswith("<?xml")
    mine = tmp_path / "mine.urdf"
    mine.write_text("<robot/>")
    assert find_robot(mine) == find_robot(str(mine)) == mine.resolve()


def test_nico_is_found_in_a_wheel_before_a_checkout(monkeypatch, tmp_path):
    for folder in ("wheel", "checkout"):
        (tmp_path / folder).mkdir()
    folders = (tmp_path / "wheel", tmp_path / "checkout")
    monkeypatch.setattr(robots, "_URDF_FOLDERS", folders)
    with pytest.raises(ModelError, match="neither a robot's name"):
        find_robot("nico")
    for folder in reversed(folders):
        (folder / "nico.urdf").touch()
        assert find_robot("nico") == (folder / "nico.urdf").resolve()


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda: find_robot("nicco"), r"nicco is neither a robot's name \(nico\) nor a URDF file"),
        (lambda: find_robot(Path(__file__).parent), "is a folder: give a URDF file"),
        (lambda: named_arm("nicco"), "no robot is named 'nicco'; there is nico"),
        (lambda: named_arm("nico", "tail"), "no arm 'tail'; it has right_arm, left_arm, neck"),
    ],
)
def test_a_wrong_name_is_answered_with_the_right_ones(ask, message):
    with pytest.raises(ModelError, match=message):
        ask()


def test_the_right_arm_is_nicos_default():
    assert named_arm("nico") is ROBOTS["nico"]["right_arm"]
