"""Residuals that depend on something the model has not: found, named, and not found in noise."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.score_test import arm_test
from nico_selfmodel.estimation.diagnosis.systematic_residuals import _effects, _hats
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.noise.arm_solution import Linearised
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.arm.dh_table import DhTable

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


def bump(q, degrees):
    """Return angles of an arm whose second joint goes off within 60 deg of its turn."""
    x = (q[:, 1] - 0.3) / np.radians(60.0)
    there = np.abs(x) < 0.5
    true = q + np.radians(0.1) * np.random.default_rng(9).normal(size=q.shape)
    true[:, 1] += np.radians(degrees) * 0.5 * (1.0 + np.cos(2.0 * np.pi * x)) * there
    return true, there


@pytest.mark.slow
def test_a_joint_that_is_far_off_in_one_place_fails_by_the_poses_there(make_truth):
    truth = make_truth(3, 6, kind="elbow")
    q = truth.poses(70, 6, span=2.6)
    true, there = bump(q, 4.0)
    data = recorded(truth, q, true)
    result = calibrate_kinematics(data, explain=False, effects=())
    (words,) = [said for said in judge(result).reasons if "the encoder and the gear there" in said]
    found = words.split(" read ")[1].split(" deg ")[0].split(" to ")
    assert " 'joint_1' read " in words
    low, high = np.sort(np.degrees(data.encoders[there, 1]))[[0, -1]]
    assert low - 0.5 <= float(found[0]) < float(found[1]) <= high + 0.5
    assert float(found[1]) - float(found[0]) > 20.0


@pytest.mark.slow
def test_a_joint_that_is_off_in_one_place_fails_by_its_residuals(make_truth):
    truth = make_truth(3, 6, kind="elbow")
    q = truth.poses(150, 6, span=2.6)
    true, _ = bump(q, 2.0)
    result = calibrate_kinematics(recorded(truth, q, true), explain=False, effects=())
    assert result.patterns[0].uneven == "joint_1"
    verdict = judge(result)
    (words,) = [said for said in verdict.reasons if "no gear and no ripple" in said]
    assert words.startswith("the residuals depend on the angle of joint_1, in places (uneven ")
    assert words.endswith("check joint_1 there")
    assert not any("in places" in said for said in verdict.warnings)


def test_hats_share_a_turn_and_those_without_poses_are_left_out():
    turn = np.radians(np.linspace(-30.0, 69.0, 400))
    hats = _hats(turn, np.arange(400), 100)
    assert hats.shape == (400, 6)  # one every 20 deg, both ends counted
    assert hats.sum(axis=1) == pytest.approx(1.0)
    assert hats.min() == 0.0
    assert _hats(np.radians(np.linspace(-30.0, 71.0, 400)), np.arange(400), 100).shape[1] == 7
    assert _hats(turn, np.arange(400), 4).shape[1] == 4
    assert np.array_equal(_hats(turn, np.flatnonzero(turn < 0.0), 100), hats[:, :3])


@pytest.mark.parametrize(("height", "hats"), [(9e-4, 2), (1.1e-3, 3)])
def test_a_hat_counts_from_a_thousandth_of_its_height_on(height, hats):
    place = np.radians(20.0) * np.array([0.0, 1.0 + height, 3.0])
    assert _hats(place, np.array([0, 1]), 100).shape[1] == hats


def test_each_hat_has_five_poses(truth):
    for poses, most in ((29, 5), (30, 6)):
        rows = Observations.from_dataset(truth.dataset(truth.poses(poses, 1, span=5.0)))
        parameters = DhParameters(DhTable.from_chain(truth.chain), truth.servos)
        uneven = [e for e in _effects(rows, parameters, np.arange(len(rows.sample))) if e.uneven]
        assert [effect.turns.shape[1] for effect in uneven] == [most] * 4


@pytest.mark.parametrize("sigma", [1e4, 1e-9])
def test_a_loose_prior_is_none_and_a_tight_one_holds_its_parameter(truth, sigma):
    q = truth.poses(40, 3)
    true = q + np.radians(0.1) * np.random.default_rng(8).normal(size=q.shape)
    result = calibrate_kinematics(recorded(truth, q, true), explain=False, effects=())
    parameters = result.model.parameters
    rows = result.train.observations
    linear = Linearised.at(rows, parameters, ~result.outliers, result.noise)
    values = dict(zip(linear.names, parameters.values, strict=True))
    held = sorted(name for name in result.free if name.endswith("theta_offset"))[:2]
    assert len(held) == 2
    priors = {name: (values[name], sigma) for name in held}
    found = arm_test(linear, result.free, priors, parameters.values)
    other = arm_test(linear, result.free - (set() if sigma > 1.0 else set(held)))
    wave = np.linspace(0.0, 1.0, len(linear.residuals))[:, None, None] ** 2
    for joint in range(4):
        columns = linear.by_angle[:, :, joint, None] * wave
        assert found.of(columns).values == pytest.approx(other.of(columns).values, rel=1e-5)


@pytest.mark.slow
def test_few_poses_show_no_pattern(truth):
    q = truth.poses(19, 1)
    true = q + np.radians(1.0) * np.sin(2.0 * q)
    assert not calibrate_kinematics(recorded(truth, q, true), effects=()).patterns


@pytest.mark.slow
def test_noise_makes_a_pattern_as_rarely_as_is_said():
    """Chances of all effects of sound arms, with joint noise and many markers, are uniform."""
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
