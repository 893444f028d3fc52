"""Write a learned arm into a Drake plant: its joint frames then carry the learned DH values."""

from dataclasses import replace

import numpy as np

from nico_selfmodel import NominalArm, SweepProtocol, calibrate_kinematics, simulated_session
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.systems import IMPERFECTIONS

arm = ArmDescription.named("nico", "right_arm")
poses = replace(SweepProtocol.for_arm(arm), random_poses=50)
data = simulated_session(arm, IMPERFECTIONS["thesis"], poses, "train", seed=2, session=0)
nominal = NominalArm(arm.chain, arm.lower, arm.upper, arm.source)
model = calibrate_kinematics(data, nominal=nominal).model

learned = SelfModelPlant.from_urdf(arm, model)
context = learned.plant.CreateDefaultContext()
learned.set_positions(context, data.encoders[0])
frame = learned.tracked_point_frame("hand")
p_WH = frame.CalcPoseInWorld(context).translation()
print(
    "plant and self-model differ by", np.abs(p_WH - model.predict(data.encoders[0]).p_WH[0]).max()
)
