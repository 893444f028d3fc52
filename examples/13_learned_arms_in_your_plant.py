"""Put learned arms into a plant of one's own, plan with one of them, and let time pass.

Two robots of different descriptions stand beside a table, each moving as its self-model has it.
Here simulated robots stand in for what was learned; yours comes from `load_model("my_result")`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.solvers import Solve
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel import NominalArm, SweepProtocol, calibrate_kinematics, simulated_session
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.systems import IMPERFECTIONS


def learn(arm):
    poses = replace(SweepProtocol.for_arm(arm), random_poses=60)
    data = simulated_session(arm, IMPERFECTIONS["thesis"], poses, "train", seed=1, session=0)
    nominal = NominalArm(arm.chain, arm.lower, arm.upper, arm.source)
    return calibrate_kinematics(data, nominal=nominal).model


six_axis = ArmDescription.from_urdf(Path(__file__).parent / "six_axis.urdf", tip_link="tool0")
nico = ArmDescription.named("nico", "right_arm")

builder = DiagramBuilder()
plant, _ = AddMultibodyPlantSceneGraph(builder, MultibodyPlant(1e-3))
table = RigidTransform([0.0, 0.0, -0.5])
friction = CoulombFriction(0.8, 0.6)
plant.RegisterCollisionGeometry(plant.world_body(), table, Box(3, 3, 0.1), "table", friction)
beside = FixedOffsetFrame("beside", plant.world_frame(), RigidTransform([1.0, 0.0, 0.0]))
arm = SelfModelPlant.add_to(plant, six_axis, learn(six_axis))
other = SelfModelPlant.add_to(plant, nico, learn(nico), frame=plant.AddFrame(beside))
plant.Finalize()
diagram = builder.Build()
simulator = Simulator(diagram)
root = simulator.get_mutable_context()
context = plant.GetMyMutableContextFromRoot(root)

# Inverse kinematics of the learned arm: its tool shall go where the self-model sees this point.
q = np.array([0.3, -0.9, 1.1, 0.4, -0.5, 0.2])
target = arm.model.chain.forward(q)
ik = InverseKinematics(plant, context)
frame, world = arm.tracked_point_frame(), plant.world_frame()
ik.AddPositionConstraint(frame, [0, 0, 0], world, target, target)
start = plant.GetPositions(context)
start[arm.columns] = q + 0.1
found = Solve(ik.prog(), start)
reached = arm.model.chain.forward(found.GetSolution(ik.q())[arm.columns])
print(f"solved {found.is_success()}, {1e6 * np.linalg.norm(reached - target):.1f} um away")

# Another day's self-model goes into a context; new ones, and other contexts, hold the first.
arm.write(root, learn(six_axis))
plant.get_actuation_input_port().FixValue(context, np.zeros(plant.num_actuators()))
simulator.AdvanceTo(0.5)
print(f"{len(arm.arm.joints)} and {len(other.arm.joints)} learned joints fell for 0.5 s")
