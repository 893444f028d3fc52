"""Learn a simulated arm from its circles, and ask the self-model where the hand is."""

from dataclasses import replace

from nico_selfmodel import SweepProtocol, calibrate_kinematics, judge, simulated_session
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems import IMPERFECTIONS

arm = ArmDescription.named("nico", "right_arm")
poses = replace(SweepProtocol.for_arm(arm), random_poses=100)
train = simulated_session(arm, IMPERFECTIONS["thesis"], poses, "train", seed=1, session=0)
test = simulated_session(
    arm, IMPERFECTIONS["thesis"], poses, "test", seed=1, session=1, sweeps=False
)

learned = calibrate_kinematics(train, test=test)
print(judge(learned).status, f"{1e3 * learned.test.statistics.mean:.2f} mm")
here = learned.model.predict(test.encoders[0])
print("hand at", here.p_WH[0], "m, model sigma", f"{1e3 * here.sigma[0]:.2f} mm")
