"""A robot that is roughly known: as a start without sweeps, and for the zero of its joints."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.motion_capture_scenario import nominal_of
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

ARM = ArmDescription.named("nico")
NOMINAL = nominal_of(ARM)


@pytest.fixture(scope="module")
def session():
    world = IMPERFECTIONS["clean"].with_noise(marker_mm=0.3)
    poses = replace(SweepProtocol.for_arm(ARM), random_poses=80)
    return simulated_session(ARM, world, poses, "free", seed=6, session=0, sweeps=False)


@pytest.mark.slow
def test_limits_on_both_sides_make_a_described_robot_a_start(session):
    result = calibrate_kinematics(session, nominal=NOMINAL)
    assert result.search is not None
    assert result.search.best_label == "robot"
    assert judge(result).status == "NOT_EVALUATED"
    assert result.model.noise_sigma == pytest.approx(0.3e-3, rel=0.2)


@pytest.mark.slow
def test_joints_count_from_the_robots_own_zero(session):
    result = calibrate_kinematics(session, nominal=NOMINAL)
    described = DhTable.from_chain(NOMINAL.chain)
    assert result.model.dh.theta_zero == pytest.approx(described.theta_zero, abs=1e-9)
    # The stops of the encoders, as joint angles, lie where the description has its limits.
    lower = result.model.servos.to_joint([joint.lower for joint in session.joints])
    assert lower == pytest.approx(NOMINAL.lower, abs=np.radians(8.0))
    without = calibrate_kinematics(session).model.predict(session.encoders).p_WH
    assert result.model.predict(session.encoders).p_WH == pytest.approx(without, abs=1e-6)


@pytest.mark.slow
def test_without_limits_of_the_encoders_the_robot_cannot_be_placed_but_the_arm_is_learned(session):
    joints = tuple(replace(joint, lower=None, upper=None) for joint in session.joints)
    result = calibrate_kinematics(replace(session, joints=joints), nominal=NOMINAL)
    assert result.search is not None
    assert set(result.search.labels) == {"random axes"}
    assert judge(result).status == "NOT_EVALUATED"


def test_a_pin_without_a_value_holds_the_robots(session):
    name = "right_upper_arm_twist.D"
    result = calibrate_kinematics(session, nominal=NOMINAL, pins=FixedParameters.from_text([name]))
    held = dict(zip(result.model.parameters.names, result.model.parameters.values, strict=True))
    assert held[name] == pytest.approx(0.130, abs=1e-9)
    assert name not in result.free


def test_a_robot_with_other_joints_is_refused(session):
    left = nominal_of(ArmDescription.named("nico", "left_arm"))
    with pytest.raises(ModelError, match="left_elbow"):
        calibrate_kinematics(session, nominal=left)
