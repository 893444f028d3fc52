"""Hold each new pose against the self-model in a diagram, and say what changed.

In the middle of the day the elbow's encoder jumps by two degrees.
"""

from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from nico_selfmodel import SweepProtocol, calibrate_kinematics, simulated_session
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems import IMPERFECTIONS, SelfModelMonitor

PERIOD, JUMP_AT = 0.1, 30  # a pose every 0.1 s; the 30th is the first after the jump

arm = ArmDescription.named("nico", "right_arm")
poses = replace(SweepProtocol.for_arm(arm), random_poses=60)
train = simulated_session(arm, IMPERFECTIONS["thesis"], poses, "train", seed=1, session=0)
day = simulated_session(arm, IMPERFECTIONS["thesis"], poses, "day", seed=1, session=1, sweeps=False)
learned = calibrate_kinematics(train).model

encoders = day.encoders.copy()
elbow = day.joint_names.index("right_elbow")
encoders[JUMP_AT:, elbow] += np.radians(2.0) / day.joints[elbow].radians_per_unit

builder = DiagramBuilder()
monitor = builder.AddSystem(SelfModelMonitor(learned, PERIOD))
for port, values in (("encoders", encoders), ("p_WH_measured", day.p_WH_measured)):
    held = PiecewisePolynomial.ZeroOrderHold(PERIOD * np.arange(len(values)) - 1e-3, values.T)
    source = builder.AddSystem(TrajectorySource(held))
    builder.Connect(source.get_output_port(), monitor.GetInputPort(port))
simulator = Simulator(builder.Build())
context = monitor.GetMyContextFromRoot(simulator.get_context())
for pose in range(len(day)):
    simulator.AdvanceTo(PERIOD * (pose + 0.5))
    if monitor.GetOutputPort("alarm").Eval(context)[0]:
        print(f"alarm at pose {pose}: {monitor.GetOutputPort('cause').Eval(context)}")
        break
