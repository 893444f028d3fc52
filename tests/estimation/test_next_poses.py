"""A learned arm names the poses that would teach it most."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.planning.next_poses import choose_next_poses
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording.session import record
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.robot import SimulatedRobot

ARM = ArmDescription.named("nico")


def visited(session, commands):
    body = SimulatedRobot.under_motion_capture(ARM, IMPERFECTIONS["thesis"], 0, session)
    return record(body, [("", command) for command in commands], "poses")


@pytest.fixture(scope="module")
def recorded():
    joints = SimulatedRobot.under_motion_capture(ARM, IMPERFECTIONS["thesis"], 0).joints
    low, high = (np.array([getattr(j, k) for j in joints]) for k in ("lower", "upper"))
    middle, half = 0.5 * (low + high), 0.2 * (high - low)
    return visited(1, np.random.default_rng(0).uniform(middle - half, middle + half, (30, 4)))


@pytest.fixture(scope="module")
def learned(recorded):
    return calibrate_kinematics(recorded).model


@pytest.mark.slow
def test_they_teach_more_than_as_many_by_chance(learned, recorded):
    chosen = choose_next_poses(learned, recorded, 10, np.random.default_rng(1))
    assert chosen.sigma_after < 0.8 * chosen.sigma_before
    low, high = recorded.encoders.min(axis=0), recorded.encoders.max(axis=0)
    by_chance = np.random.default_rng(2).uniform(low, high, (10, 4))
    both = [
        calibrate_kinematics(visited(1, np.vstack([recorded.encoders, poses]))).model
        for poses in (chosen.readings, by_chance)
    ]
    sigmas = [model.predict(recorded.encoders).sigma / model.noise_sigma for model in both]
    assert np.mean(sigmas[0]) < np.mean(sigmas[1])


@pytest.mark.slow
def test_the_error_they_promise_is_the_one_the_covariance_gives_afterwards(learned, recorded):
    chosen = choose_next_poses(learned, recorded, 10, np.random.default_rng(1))
    after = calibrate_kinematics(visited(1, np.vstack([recorded.encoders, chosen.readings]))).model
    sigma = after.predict(recorded.encoders).sigma
    unit = np.sqrt(3.0 * np.mean(sigma**2)) / after.noise_sigma
    assert chosen.sigma_after / learned.noise_sigma == pytest.approx(unit, rel=0.1)


@pytest.mark.slow
def test_the_error_now_is_what_the_model_says_of_itself(learned, recorded):
    chosen = choose_next_poses(learned, recorded, 2, np.random.default_rng(1))
    sigma = learned.predict(recorded.encoders).sigma
    assert chosen.sigma_before == pytest.approx(np.sqrt(3.0 * np.mean(sigma**2)), rel=1e-9)
    assert chosen.sigma_after < chosen.sigma_before


@pytest.mark.slow
def test_poses_whose_joints_are_read_worse_promise_less(learned, recorded):
    noise = learned.fit["pose_noise"]
    louder = noise | {"joint_sigma_rad": [3.0 * sigma for sigma in noise["joint_sigma_rad"]]}
    other = replace(learned, fit=dict(learned.fit) | {"pose_noise": louder})
    one, two = (
        choose_next_poses(model, recorded, 10, np.random.default_rng(1))
        for model in (learned, other)
    )
    assert one.sigma_before == two.sigma_before
    assert two.sigma_after > 1.1 * one.sigma_after


@pytest.mark.slow
def test_a_model_without_error_bars_is_refused(learned, recorded):
    with pytest.raises(ModelError, match="does not say how well it is known"):
        choose_next_poses(replace(learned, covariance=None), recorded, 5, np.random.default_rng(4))


@pytest.mark.slow
def test_no_joint_goes_further_than_it_has_been(learned, recorded):
    chosen = choose_next_poses(learned, recorded, 25, np.random.default_rng(3), criterion="D")
    assert chosen.readings.shape == (25, 4)
    assert (chosen.readings >= recorded.encoders.min(axis=0)).all()
    assert (chosen.readings <= recorded.encoders.max(axis=0)).all()


@pytest.mark.slow
def test_data_of_another_arm_or_point_are_refused(learned, recorded):
    rng = np.random.default_rng(4)
    with pytest.raises(ValueError, match="no marker 'elbow'; there are hand"):
        choose_next_poses(learned, recorded, 5, rng, marker="elbow")
    other = SimulatedRobot.under_motion_capture(
        ArmDescription.named("nico", "left_arm"), IMPERFECTIONS["clean"], 0
    )
    middle = [0.5 * (joint.lower + joint.upper) for joint in other.joints]
    left = record(other, [("", np.array(middle))], "left")
    with pytest.raises(DataError, match="has the joints left_"):
        choose_next_poses(learned, left, 5, rng)


@pytest.mark.slow
def test_data_in_other_units_are_refused(learned, recorded):
    first = replace(recorded.joints[0], encoder_unit="deg", counts_per_turn=None)
    other = replace(recorded, joints=(first, *recorded.joints[1:]))
    with pytest.raises(DataError, match="is read in deg"):
        choose_next_poses(learned, other, 5, np.random.default_rng(4))
