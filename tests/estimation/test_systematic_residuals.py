"""Residuals that depend on something the model has not: found, named, and not found in noise."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.score_test import arm_test
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.noise.arm_solution import Linearised

from .random_arms import random_recording

SIGMA = 3e-4


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth(4, 2, unit="rad", kind="elbow", markers=2)


def recorded(truth, q, true, seed=1) -> Dataset:
    """Record an arm that stands at other angles than its encoders say."""
    data = truth.dataset(true, sigma=SIGMA, seed=seed)
    rows = np.repeat(np.arange(len(q)), len(truth.chain.markers))
    return replace(data, encoders=truth.servos.to_encoder(q)[rows])


def causes(result: KinematicCalibration) -> list[str]:
    return [pattern.cause for pattern in result.patterns]


@pytest.mark.slow
def test_an_eccentric_gear_is_named_by_its_joint(truth):
    q = truth.poses(120, 1)
    true = q.copy()
    true[:, 2] += np.radians(1.0) * np.sin(2.0 * q[:, 2])
    result = calibrate_kinematics(recorded(truth, q, true), effects=())
    (words, _, size) = causes(result)[0].partition("encoder, ")
    assert words == "the angle of joint_2 (eccentric gear or "
    # Waves of 1 deg over less than a turn, less what zero and gear take of them.
    wave = np.sin(2.0 * q[:, 2])
    line = np.column_stack([np.ones(len(q)), q[:, 2]])
    left = wave - line @ np.linalg.lstsq(line, wave, rcond=None)[0]
    assert float(size.split()[0]) == pytest.approx(0.5 * np.ptp(left), rel=0.15)
    warnings = judge(result).warnings
    assert any("the residuals depend on the angle of joint_2" in words for words in warnings)
    assert any("sigmas of parameters and predictions are too small" in w for w in warnings)


@pytest.mark.slow
def test_coupling_is_named_by_the_joint_that_is_moved(truth):
    q = truth.poses(120, 1)
    true = q.copy()
    true[:, 1] += 0.01 * q[:, 0] * q[:, 0] + 0.02 * q[:, 3]
    found = causes(calibrate_kinematics(recorded(truth, q, true), effects=()))
    assert found[0].startswith("the other joints at joint_1 (coupling)")


@pytest.mark.slow
def test_backlash_is_named_with_its_half_width(truth):
    q = truth.poses(120, 1)
    side = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    true = q + np.radians(0.2) * side * np.array([0.0, 0.0, 0.0, 1.0])
    found = causes(calibrate_kinematics(recorded(truth, q, true), effects=()))
    assert found[0].startswith("the direction from which joint_3 came (backlash, half width 0.")
    assert float(found[0].split()[-2]) == pytest.approx(0.2, rel=0.1)


@pytest.mark.slow
def test_sag_is_named_as_gravitys(truth):
    q = truth.poses(150, 1)
    chain = truth.chain
    p = chain.forward(q)
    motions = np.stack([chain.link_motions(row) for row in q])
    axis = motions[:, 1, :3, :3] @ chain.directions[1]
    at = np.einsum("nij,j->ni", motions[:, 1, :3, :3], chain.points[1]) + motions[:, 1, :3, 3]
    moment = np.sum(axis * np.cross(p - at, [0.0, 0.0, -1.0]), axis=1)
    true = q.copy()
    true[:, 1] += np.radians(1.5) * moment / np.abs(moment).max()
    found = causes(calibrate_kinematics(recorded(truth, q, true), effects=()))
    assert any(words.startswith("gravity (sag of joint_1") for words in found[:2])


@pytest.mark.slow
def test_few_poses_show_no_pattern(truth):
    q = truth.poses(19, 1)
    true = q + np.radians(1.0) * np.sin(2.0 * q)
    assert not calibrate_kinematics(recorded(truth, q, true), effects=()).patterns


@pytest.mark.slow
def test_noise_makes_a_pattern_as_rarely_as_is_said():
    """Chances of all effects of sound arms, with joint noise and many markers, are uniform."""
    from nico_selfmodel.estimation.diagnosis.systematic_residuals import _effects
    from nico_selfmodel.estimation.observations.observations import Observations

    chances = []
    for kind in ("clean", "joint noise"):
        for seed in range(40):
            data = random_recording(kind, 5000 + seed).dataset
            result = calibrate_kinematics(data, explain=False, effects=())
            rows, parameters = Observations.from_dataset(data), result.model.parameters
            linear = Linearised.at(rows, parameters, ~result.outliers, result.noise)
            test = arm_test(linear, result.free)
            for effect in _effects(rows, parameters, linear.rows):
                by_angle = linear.by_angle[:, :, effect.joint, None]
                chances.append(test.of(by_angle * effect.turns[:, None]).chance)
    chances = np.array(chances)
    for level, slack in ((0.1, 0.03), (0.01, 0.008)):
        assert np.mean(chances < level) == pytest.approx(level, abs=slack)
    assert chances.min() > 1e-6
