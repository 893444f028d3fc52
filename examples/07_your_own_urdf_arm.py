"""Calibrate an arm from its URDF: sweep it, watch a point on it, write the learned URDF."""

import tempfile
from dataclasses import replace
from pathlib import Path

from nico_selfmodel import NominalArm, SweepProtocol, calibrate_kinematics, judge, simulated_session
from nico_selfmodel.plant import ArmDescription, learned_urdf
from nico_selfmodel.systems import IMPERFECTIONS

LINK = """<link name="{0}"><inertial><mass value="0.3"/>
  <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>
  <origin xyz="{3}"/><axis xyz="{4}"/>
  <limit lower="-1.5" upper="1.5" velocity="2" effort="5"/></joint>"""
URDF = "\n".join(
    [
        '<robot name="three_joints">',
        *(LINK.format(name) for name in ("foot", "turret", "upper", "fore")),
        JOINT.format("turn", "foot", "turret", "0 0 0.1", "0 0 1"),
        JOINT.format("lift", "turret", "upper", "0.02 0 0.05", "0 1 0"),
        JOINT.format("bend", "upper", "fore", "0.25 0 0", "0 1 0"),
        '<link name="tip"/><joint name="tip_mount" type="fixed"><parent link="fore"/>'
        '<child link="tip"/><origin xyz="0.2 0.03 0"/></joint>',
        "</robot>",
    ]
)

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "three_joints.urdf"
    path.write_text(URDF)
    arm = ArmDescription.from_urdf(path, "foot", "tip")
    # Here a simulated robot stands in; your own data come with Dataset or import_csv.
    poses = replace(SweepProtocol.for_arm(arm), random_poses=60)
    train = simulated_session(arm, IMPERFECTIONS["thesis"], poses, "train", seed=1, session=0)
    test = simulated_session(
        arm, IMPERFECTIONS["thesis"], poses, "test", seed=1, session=1, sweeps=False
    )
    nominal = NominalArm(arm.chain, arm.lower, arm.upper, arm.source)
    learned = calibrate_kinematics(train, test=test, nominal=nominal)
    (Path(folder) / "learned.urdf").write_text(learned_urdf(learned.model, arm))
    print(judge(learned).status, f"{1e3 * learned.test.statistics.mean:.2f} mm on new poses")
    print("learned URDF:", (Path(folder) / "learned.urdf").stat().st_size, "bytes")
