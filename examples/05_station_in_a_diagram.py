"""Put Nico into a diagram of one's own: prediction against observation, before any learning."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from nico_selfmodel import VisibleWorkspace, commands_of_angles
from nico_selfmodel.systems import NicoStation, SelfModelPredictor

builder = DiagramBuilder()
nico = builder.AddNamedSystem("nico", NicoStation("thesis", seed=1))
arm = nico.arm
guess = VisibleWorkspace.of(arm).first_guess(nico.joints)  # the robot as described, nothing learned
predictor = builder.AddNamedSystem("predictor", SelfModelPredictor(guess, "fiducial"))
builder.Connect(nico.GetOutputPort("encoders"), predictor.GetInputPort("encoders"))
seen = LogVectorOutput(nico.GetOutputPort("pixels"), builder, 0.5)
expected = LogVectorOutput(predictor.GetOutputPort("pixels_predicted"), builder, 0.5)
diagram = builder.Build()

simulator = Simulator(diagram)
context = simulator.get_mutable_context()
pose = np.radians([[-30.0, 50.0, 0.0, -70.0]])
command = commands_of_angles(nico.joints, arm.lower, arm.upper, pose)[0]
nico.GetInputPort("encoders_commanded").FixValue(nico.GetMyMutableContextFromRoot(context), command)
simulator.AdvanceTo(2.0)

tracked = seen.FindLog(context).data()[:4, -1].reshape(2, 2)
predicted = expected.FindLog(context).data()[:, -1].reshape(2, 2)
for camera, here, there in zip(("left", "right"), tracked, predicted, strict=True):
    print(f"{camera}: seen at {here.round(1)}, expected at {there.round(1)}")
print("off by", np.linalg.norm(tracked - predicted, axis=1).round(1), "px: time to learn")
