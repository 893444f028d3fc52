"""What training told nothing of is unknown to all that use a self-model, not exactly known."""

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge, result_of
from nico_selfmodel.estimation.monitoring.health import check_health

STILL = 1
"""Joint that hardly moved while the arm was learned."""


@pytest.fixture(scope="module")
def arm(make_truth):
    """An arm, and what was learned of it while one joint turned by two hundredths of a degree."""
    truth = make_truth(4, seed=5)
    q = truth.poses(60, seed=1)
    q[:, STILL] *= 4e-4
    data = truth.dataset(q, sigma=3e-4, known_sigma=True)
    return truth, calibrate_kinematics(data, explain=False, effects=())


def test_a_joint_that_stood_still_is_named(arm):
    _, learned = arm
    assert judge(learned).status == "FAIL"
    assert any("joint_1" in words for words in result_of(learned).unobservable)


def test_a_hand_is_as_uncertain_as_what_nobody_knows_moves_it(arm):
    truth, learned = arm
    poses = truth.poses(20, seed=2)
    moved = learned.model.predict(truth.servos.to_encoder(poses))
    error = np.linalg.norm(moved.p_WH - truth.chain.forward(poses, np.zeros(20, int)), axis=1)
    assert np.median(error) > 0.05
    assert 0.3 < np.sqrt(np.mean((error / moved.sigma) ** 2) / 3.0) < 2.0
    poses[:, STILL] *= 4e-4
    still = learned.model.predict(truth.servos.to_encoder(poses))
    error = np.linalg.norm(still.p_WH - truth.chain.forward(poses, np.zeros(20, int)), axis=1)
    assert still.sigma.max() < 1e-3
    assert 0.3 < np.sqrt(np.mean((error / still.sigma) ** 2) / 3.0) < 2.0


def test_a_body_that_never_changed_gives_no_alarm(arm):
    truth, learned = arm
    new = truth.dataset(truth.poses(40, seed=3), sigma=3e-4, seed=4)
    away = np.linalg.norm(
        learned.model.predict(new.encoders).p_WH - new.p_WH_measured, axis=1
    )  # what training told nothing of is no change
    assert np.median(away) > 0.05
    assert check_health(learned.model, new).healthy
