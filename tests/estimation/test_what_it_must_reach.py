"""The figures that the estimators of the arm must reach, over many seeds."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

pytestmark = pytest.mark.slow
PLAY = IMPERFECTIONS["clean"].with_noise(play_deg=0.5, marker_mm=0.5)
ARM = ArmDescription.named("nico")


def sessions(seed, *, world=PLAY, random_poses=0, share=1.0, few=False):
    """Return a training and a test session of one individual."""
    protocol = SweepProtocol.for_arm(ARM).on_share_of_arcs(share)
    protocol = protocol.minimal() if few else protocol
    train = replace(protocol, random_poses=random_poses)
    test = replace(protocol, random_poses=100)
    return (
        simulated_session(ARM, world, train, "train", seed=seed, session=0),
        simulated_session(ARM, world, test, "test", seed=seed, session=1, sweeps=False),
    )


def mean_mm(calibration):
    assert calibration.test is not None
    return 1e3 * calibration.test.statistics.mean


@pytest.mark.parametrize(
    ("method", "random_poses", "bound"),
    [("circle-points", 0, 3.5), ("refine", 0, 2.5), ("refine", 100, 2.0)],
)
def test_with_half_a_degree_of_play_the_mean_over_ten_arms_is_small(method, random_poses, bound):
    errors = []
    for seed in range(10):
        train, test = sessions(seed, random_poses=random_poses)
        assert len(train) == 104 + random_poses
        errors.append(mean_mm(calibrate_kinematics(train, method=method, test=test)))
    assert np.mean(errors) <= bound, errors


def test_nine_samples_on_short_arcs_and_a_hundred_random_poses_reach_the_best_minimum():
    for seed in range(10):
        train, test = sessions(
            seed, world=IMPERFECTIONS["thesis"], share=0.25, few=True, random_poses=100
        )
        calibration = calibrate_kinematics(train, test=test, seed=seed)
        assert mean_mm(calibration) <= 3.3, seed
        assert judge(calibration).status == "PASS"


@pytest.mark.parametrize("loss", ["trimmed", "cauchy", "tukey"])
def test_a_tenth_of_gross_outliers_costs_at_most_five_percent(loss):
    for seed in range(10):
        train, test = sessions(seed, random_poses=100)
        clean = mean_mm(calibrate_kinematics(train, test=test, loss=loss))
        rng = np.random.default_rng((seed, 5))
        points = train.p_WH_measured.copy()
        wrong = rng.choice(len(points), round(0.1 * len(points)), replace=False)
        points[wrong] += rng.choice([0.03, 0.15]) * rng.normal(size=(len(wrong), 3))
        spoilt = calibrate_kinematics(replace(train, p_WH_measured=points), test=test, loss=loss)
        assert mean_mm(spoilt) <= 1.05 * clean, seed


@pytest.mark.parametrize("world", [IMPERFECTIONS["clean"].with_noise(marker_mm=1.0), PLAY])
def test_the_predicted_covariance_is_that_of_the_errors(world):
    """NEES of the predicted hand over 200 recordings of one arm, its own mean as the truth."""
    protocol = replace(SweepProtocol.for_arm(ARM), random_poses=100)
    quiet = replace(world, play=0.0, marker_sigma=0.0)
    truth = simulated_session(
        ARM, quiet, replace(protocol, random_poses=20), "truth", seed=0, session=9, sweeps=False
    )
    nees = []
    for session in range(200):
        data = simulated_session(ARM, world, protocol, "data", seed=0, session=session)
        model = calibrate_kinematics(data, loss="none", starts=0).model
        prediction = model.predict(truth.encoders)
        error = prediction.p_WH - truth.p_WH_measured
        assert prediction.covariance is not None
        solved = np.linalg.solve(prediction.covariance, error[:, :, None])[:, :, 0]
        nees.append(np.sum(error * solved, axis=1).mean())
    assert 0.9 <= np.mean(nees) / 3.0 <= 1.15
