"""A verdict that would be trusted must be earned: what makes a calibration fail."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS


@pytest.fixture(scope="module")
def session():
    arm = ArmDescription.named("nico")
    world = IMPERFECTIONS["clean"].with_noise(marker_mm=0.5)
    poses = replace(SweepProtocol.for_arm(arm), random_poses=60)
    return simulated_session(arm, world, poses, "session", seed=4, session=0)


def as_joint_angles(session):
    """Return the session as if its encoders read joint angles, though one is geared 1.6 to 1."""
    joints = tuple(
        replace(j, encoder_unit="rad", counts_per_turn=None, lower=None, upper=None)
        for j in session.joints
    )
    radians = session.encoders * 2.0 * np.pi / session.joints[0].counts_per_turn
    return replace(session, joints=joints, encoders=radians)


@pytest.mark.slow
def test_a_gear_that_contradicts_its_unit_is_named_first_and_freeing_it_cures(session):
    data = as_joint_angles(session)
    verdict = judge(calibrate_kinematics(data))
    assert verdict.status == "FAIL"
    assert "--free right_elbow.gear" in verdict.reasons[0]
    gears = [f"{joint.name}.gear" for joint in data.joints]
    cured = calibrate_kinematics(data, pins=FixedParameters.from_text(free=gears))
    assert judge(cured).status == "NOT_EVALUATED"
    values = dict(zip(cured.model.parameters.names, cured.model.parameters.values, strict=True))
    assert values["right_elbow.gear"] == pytest.approx(1.6, rel=0.05)


@pytest.mark.slow
def test_readings_that_do_not_belong_to_their_points_fail_with_the_misfit_first(session):
    shuffled = np.random.default_rng(0).permutation(session.encoders)
    data = replace(session, encoders=shuffled, sweep=np.full(len(session), ""))
    verdict = judge(calibrate_kinematics(data, starts=3))
    assert verdict.status == "FAIL"
    assert "does not explain the data" in verdict.reasons[0]
    assert len(verdict.reasons) < 8


@pytest.mark.slow
def test_a_base_that_moved_half_way_fails(session):
    points = session.p_WH_measured.copy()
    points[::2] += [0.03, 0.0, 0.0]
    data = replace(session, p_WH_measured=points)
    assert judge(calibrate_kinematics(data)).status == "FAIL"


@pytest.mark.slow
def test_too_many_outliers_fail(session):
    points = session.p_WH_measured.copy()
    rng = np.random.default_rng(1)
    wrong = rng.choice(len(points), int(0.32 * len(points)), replace=False)
    points[wrong] += 0.1 * rng.normal(size=(len(wrong), 3))
    verdict = judge(calibrate_kinematics(replace(session, p_WH_measured=points)))
    assert verdict.status == "FAIL"
    assert any("contradict the rest" in reason for reason in verdict.reasons)
