"""A second of a diagram of one's own takes less than a second of processor time."""

import time

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.plant import ArmDescription, SelfModelPlant

pytestmark = pytest.mark.benchmark


@pytest.fixture
def arms(project_root):
    ur5 = ArmDescription.from_urdf(project_root / "examples" / "six_axis.urdf", tip_link="tool0")
    return ur5, ArmDescription.named("nico", "right_arm")


def processor_seconds(simulator, end):
    begin = time.process_time()
    simulator.AdvanceTo(end)
    return time.process_time() - begin


def test_a_table_and_two_arms_are_simulated_faster_than_they_fall(arms):
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, MultibodyPlant(1e-3))
    table, friction = RigidTransform([0.0, 0.0, -0.05]), CoulombFriction(0.8, 0.6)
    plant.RegisterCollisionGeometry(
        plant.world_body(), table, Box(3.0, 3.0, 0.1), "table", friction
    )
    robots = [SelfModelPlant.add_to(plant, arm) for arm in arms]
    plant.Finalize()
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    robots[0].set_joint_angles(root, [0.0, -1.0, 1.4, 0.3, 0.2, 0.1])
    context = plant.GetMyMutableContextFromRoot(root)
    plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
    simulator.Initialize()
    seconds = processor_seconds(simulator, 1.0)
    print(f"1 s of a table and two arms: {seconds:.2f} s")
    assert seconds < 1.0


def test_an_unpowered_nico_falls_in_a_fraction_of_the_time(arms):
    builder = DiagramBuilder()
    robot = SelfModelPlant.from_urdf(arms[1], builder=builder)
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    robot.set_joint_angles(root, [-0.4, 0.2, 0.1, -0.8])
    context = robot.own_context(root)
    actuation = np.zeros(robot.plant.num_actuators())
    robot.plant.get_actuation_input_port().FixValue(context, actuation)
    seconds = processor_seconds(simulator, 0.25)
    print(f"0.25 s of an unpowered Nico: {seconds:.3f} s")
    assert seconds < 0.25
