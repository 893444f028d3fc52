"""Places that are told in a description's link frames, whose joints' axes may be any."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import save_body_dataset
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.tree.tree_setup import blank_body
from nico_selfmodel.geometry.rotation import rotation_from_vector, rpy_of
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.plant.described_body import described_body
from nico_selfmodel.plant.described_links import (
    in_joint_frames,
    refuse_parts_on_turned,
    turned_links,
)

from ..cli.one_line import assert_one_clear_line
from ..estimation.simulated_trees import one_arm

JOINT = """<link name="l_{name}"/><joint name="{name}" type="revolute">
<parent link="{parent}"/><child link="l_{name}"/><origin xyz="{xyz}" rpy="{rpy}"/>
<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""
ABOUT_X = transform(rotation_from_vector([np.pi, 0.0, 0.0]), np.zeros(3))


def words(values):
    return " ".join(f"{value:.12g}" for value in values)


def described(tree, X_LJ, path):
    """Write a body as a URDF whose link frames are turned, the body's being X_LJ in them."""
    links, X_last, parent = [], np.eye(4), "base"
    for name, X_PJ, X in zip(tree.joints, tree.X_PJ, X_LJ, strict=True):
        origin = X_last @ X_PJ @ inverse(X)
        place, turn = words(origin[:3, 3]), words(rpy_of(origin[:3, :3]))
        axis = words(X[:3, 2])
        links.append(JOINT.format(name=name, parent=parent, xyz=place, rpy=turn, axis=axis))
        X_last, parent = X, f"l_{name}"
    path.write_text(f'<robot name="r"><link name="base"/>{"".join(links)}</robot>')
    return path


def told_in(data, tree, X_LJ):
    """Tell markers in the link frames of that URDF."""
    places = [X_LJ[m.on] @ m.X_LA for m in tree.markers]
    infos = zip(data.markers, places, strict=True)
    return replace(data, markers=tuple(replace(m, xyz=tuple(X[:3, 3].tolist())) for m, X in infos))


@pytest.fixture
def arm():
    return one_arm(3, joints=3, markers=2, poses=30)


@pytest.mark.parametrize("seed", range(3))
def test_markers_told_in_a_descriptions_link_frames_are_where_the_description_has_them(
    arm, tmp_path, seed
):
    rng, q = np.random.default_rng(seed), arm.readings_true
    turns = rotation_from_vector(rng.normal(size=(3, 3)))
    X_LJ = [transform(turn, np.zeros(3)) for turn in turns]
    urdf = described(arm.tree, X_LJ, tmp_path / "r.urdf")
    data = told_in(arm.data, arm.tree, X_LJ)
    camera = replace(data.sensors[0], name="carried", on="j2", X_LS=X_LJ[1] @ arm.tree.X_PJ[0])
    data = replace(data, sensors=(*data.sensors, camera))
    data = in_joint_frames(data, turned_links(urdf, data.joints))
    body = described_body(urdf, data.joints, blank_body(data, {}))
    true, found = TreeMotion.at(arm.tree, q), TreeMotion.at(body, q)
    for one, other in zip(arm.tree.markers, body.markers, strict=True):
        assert found.pose_of(other)[1] == pytest.approx(true.pose_of(one)[1], abs=1e-9)
    at = true.pose_of(replace(arm.tree.sensors[0], on=1, X_LA=arm.tree.X_PJ[0]))
    for part, own in zip(found.pose_of(body.sensors[1]), at, strict=True):
        assert part == pytest.approx(own, abs=1e-9)
    assert body.sensors[0].on == WORLD


def test_link_frames_whose_axis_is_z_are_the_bodys(arm, tmp_path):
    urdf = described(arm.tree, [np.eye(4)] * 3, tmp_path / "r.urdf")
    assert turned_links(urdf, arm.data.joints) == {}


def test_parts_of_a_plane_are_told_from_its_own_pose_on_any_link(arm, tmp_path):
    turned = turned_links(described(arm.tree, [ABOUT_X] * 3, tmp_path / "r.urdf"), arm.data.joints)
    palm = SensorInfo("palm", "plane", on="j3", X_LS=np.eye(4))
    data = replace(arm.data, sensors=(*arm.data.sensors, palm))
    refuse_parts_on_turned(data, turned, ["palm.z"])
    with pytest.raises(ValueError, match=r"hand_tag0\.z: told on the link of 'j3'"):
        refuse_parts_on_turned(data, turned, ["palm.z", "hand_tag0.z"])


def test_told_places_beside_a_description_whose_axes_point_back_pass(arm, tmp_path, command):
    urdf = described(arm.tree, [ABOUT_X] * 3, tmp_path / "r.urdf")
    save_body_dataset(told_in(arm.data, arm.tree, [ABOUT_X] * 3), tmp_path / "data")
    call = ("calibrate", "body", tmp_path / "data", "--robot", urdf)
    done = command(*call, "--out", tmp_path / "out", "--test-fraction", 0.3)
    assert done.returncode == 0, done.stdout + done.stderr
    for told in (("--fix", "hand_tag0.x=0.1"), ("--prior", "hand_tag0.x=0.1,0.01")):
        done = command(*call, "--out", tmp_path / "fixed", *told)
        assert_one_clear_line(done, "hand_tag0.x", "0 0 -1", "'xyz' in dataset.yaml")
