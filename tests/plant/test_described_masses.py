"""Masses of a description as the loads of a body: gravity's torques are Drake's."""

import re
from dataclasses import replace

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import MarkerInfo, SensorInfo
from nico_selfmodel.estimation.tree.tree_setup import blank_body
from nico_selfmodel.model.arm.bending import Bending
from nico_selfmodel.model.tree.spread_weight import tree_loads, tree_rods
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.plant.described_body import described_body, described_masses

URDF = """<robot name="crane">
  <link name="base"><inertial><mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0"
    izz="1"/></inertial></link>
  {links}
</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="{com}" rpy="0.3 0.2 0.1"/>
  <mass value="{mass}"/>
  <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>
  <origin xyz="{at}" rpy="{turn}"/><axis xyz="{axis}"/>
  <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>"""
LINKS = (
    ("torso", "q1", "revolute", "base", "0 1 0", 4.0),
    ("left", "q2", "revolute", "torso", "1 0 0", 2.0),
    ("left_hand", "q3", "revolute", "left", "0 0.6 0.8", 1.0),
    ("left_tool", "fixed", "fixed", "left_hand", "1 0 0", 0.5),
    ("right", "q4", "revolute", "torso", "1 0 0", 1.5),
    ("wagon", "unread", "revolute", "right", "0 0 1", 0.7),
)


@pytest.fixture
def urdf(tmp_path):
    rng = np.random.default_rng(3)

    def numbers():
        return " ".join(f"{x:.3f}" for x in 0.3 * rng.normal(size=3))

    links = [
        LINK.format(
            name=name, joint=joint, kind=kind, parent=parent, axis=axis, mass=mass,
            com=numbers(), at=numbers(), turn=numbers(),
        )
        for name, joint, kind, parent, axis, mass in LINKS
    ]  # fmt: skip
    path = tmp_path / "crane.urdf"
    path.write_text(URDF.format(links="\n".join(links)))
    return path


@pytest.fixture
def data():
    joints = (
        LinkJoint("q1"),
        LinkJoint("q2", parent="q1"),
        LinkJoint("q3", parent="q2"),
        LinkJoint("q4", parent="q1"),
    )
    table = ObservationTable([0], [0], [0], [-1], [[0.0, 0.0, 0.0, *[np.nan] * 3]])
    markers, sensors = (MarkerInfo("hand", "q3"),), (SensorInfo("tracker", "points"),)
    return BodyDataset("crane", joints, markers, sensors, [0], np.zeros((1, 4)), table)


def test_moments_of_described_masses_are_gravitys_torques(urdf, data):
    body = described_body(urdf, data.joints, blank_body(data, {}))
    mass, centre = described_masses(urdf, body)
    assert mass == pytest.approx([4.0, 2.0, 1.5, 2.2])
    pivots = tree_rods(TreeMotion.at(body, np.zeros((1, 4))))[1]
    loads = tree_loads(body, mass, centre, pivots)
    still = Bending.none(body.joints, np.eye(3)[2], loads, pivots).with_effects("sag")
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 4))
    found = TreeMotion.at(replace(body, bending=still), q).load.moments[:, :, 2].T
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    for row, moments in zip(q, found, strict=True):
        for i, joint in enumerate(body.joints):
            plant.GetJointByName(joint).set_angle(context, row[i])
        forces = plant.CalcGravityGeneralizedForces(context)
        places = [plant.GetJointByName(joint).position_start() for joint in body.joints]
        weight = mass.sum() * 9.81
        assert weight * moments == pytest.approx(forces[places], abs=1e-9)


def test_a_description_without_masses_has_none(urdf, data, tmp_path):
    bare = tmp_path / "bare.urdf"
    bare.write_text(re.sub(r"<inertial>.*?</inertial>", "", urdf.read_text(), flags=re.S))
    body = described_body(bare, data.joints, blank_body(data, {}))
    assert described_masses(bare, body) is None
