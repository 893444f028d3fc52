"""Joints that were read wrongly are named by the points that were set aside, others never."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.arm.arm_findings import _uneven_words
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.misread_joint import (
    misread_joints,
    nearest_turns,
    uneven_place,
)
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..slow_rest import slow_rest
from .random_arms import random_recording


def aside(seed, count, joint=None, joints=6, parallel=False):
    """Points 300 mm about axes of any direction, off by a joint's 1.2 deg or in any way."""
    rng = np.random.default_rng(seed)
    by_angle = 0.3 * rng.normal(size=(count, 3, joints))
    if parallel:
        by_angle[:, :, 3] = 0.8 * by_angle[:, :, 2] + 1e-3 * rng.normal(size=(count, 3))
    covariance = np.tile(5e-4**2 * np.eye(3), (count, 1, 1))
    noise = 5e-4 * rng.normal(size=(count, 3))
    if joint is None:
        way = rng.normal(size=(count, 3))
        off = 6e-3 * way / np.linalg.norm(way, axis=1, keepdims=True)
    else:
        off = by_angle[:, :, joint] * np.radians(1.2) * rng.choice([-1.0, 1.0], (count, 1))
    return off + noise, by_angle, covariance


def test_the_joint_that_was_off_is_named_with_its_angle():
    for seed in range(20):
        named, off = misread_joints(*aside(seed, 6, joint=2))
        assert named == (2,)
        assert np.degrees(np.nanmedian(np.abs(off))) == pytest.approx(1.2, rel=0.15)


def test_points_that_are_off_in_any_way_name_no_joint():
    named = [misread_joints(*aside(seed, 3 + seed % 15))[0] for seed in range(1000)]
    assert sum(map(bool, named)) <= 2


def test_a_few_points_off_in_another_way_do_not_hide_the_joint():
    for seed in range(20):
        slips, others = aside(seed, 10, joint=1), aside(100 + seed, 4)
        named, off = misread_joints(
            *(np.concatenate(both) for both in zip(slips, others, strict=True))
        )
        assert named == (1,)
        assert np.isfinite(off[:10]).sum() >= 9


def test_joints_that_points_do_not_tell_apart_are_both_named():
    named, _ = misread_joints(*aside(0, 8, joint=2, parallel=True))
    assert set(named) == {2, 3}


def test_two_points_are_too_few():
    named, off = misread_joints(*aside(0, 2, joint=2))
    assert named == ()
    assert np.isnan(off).all()
    assert misread_joints(*aside(0, 3, joint=2))[0] == (2,)


def on_circles(which, turns, radius=0.3):
    """Points that three joints turn about the axes of space, where the joints are by number."""
    start = radius * np.random.default_rng(3).normal(size=(20, 3))[which]
    for axis, angle in enumerate(turns.T):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        cos, sin, x, y = np.cos(angle), np.sin(angle), start[:, i].copy(), start[:, j].copy()
        start[:, i], start[:, j] = cos * x - sin * y, sin * x + cos * y
    return start


@pytest.mark.parametrize("degrees", [1.2, 40.0, 170.0])
def test_a_joint_that_was_off_by_any_angle_is_named_by_where_it_turns_points(degrees):
    number, off = np.arange(20), np.zeros((20, 3))
    off[:, 1] = np.radians(degrees)
    seen = on_circles(number, off) + 5e-4 * np.random.default_rng(4).normal(size=(20, 3))
    turns = nearest_turns(on_circles, seen, 3)
    step, slopes, left = 1e-6, np.zeros((20, 3, 3)), np.zeros((20, 3, 3))
    for j in range(3):
        alone = turns * (np.arange(3) == j)
        there = on_circles(number, alone)
        slopes[:, :, j] = (on_circles(number, alone + step * (np.arange(3) == j)) - there) / step
        left[:, :, j] = seen - there
    residuals = seen - on_circles(number, np.zeros((20, 3)))
    covariance = np.tile(5e-4**2 * np.eye(3), (20, 1, 1))
    named, found = misread_joints(residuals, slopes, covariance, (turns, left))
    assert named == (1,)
    assert np.degrees(np.nanmedian(found)) == pytest.approx(degrees, abs=0.2)
    if degrees > 10.0:  # no derivative at the reading leads there
        first = np.zeros((20, 3, 3))
        for j in range(3):
            by = step * np.eye(3)[[j] * 20]
            first[:, :, j] = (on_circles(number, by) - on_circles(number, 0.0 * by)) / step
        assert misread_joints(residuals, first, covariance)[0] != (1,)


@pytest.mark.parametrize(("seed", "degrees"), slow_rest([(28, 25.0), (21, 3.0), (21, 25.0)]))
def test_an_arm_names_its_joint_that_jumps_by_any_angle(seed, degrees):
    data = random_recording("joint noise", seed).dataset
    samples, middle = np.unique(data.sample), len(data.joints) // 2
    jumped = np.isin(data.sample, np.random.default_rng(seed).permutation(samples)[:10])
    by = np.outer(jumped, np.arange(len(data.joints)) == middle) * degrees  # read in deg
    found = calibrate_kinematics(replace(data, encoders=data.encoders + by), explain=False)
    (said,) = [word for word in judge(found).warnings if "the encoder of" in word]
    assert f"the encoder of '{data.joints[middle].name}' was off" in said


@pytest.mark.slow
@pytest.mark.parametrize("seed", [52, 53, 55, 56])
def test_a_marker_that_sits_elsewhere_is_no_joint_that_jumps(seed):
    # Turned far enough some joint meets a foreign point; the hand's other points stay.
    found = calibrate_kinematics(random_recording("foreign marker", seed).dataset, explain=False)
    assert not any("the encoder of" in word for word in judge(found).warnings)


def wrong_at(*which, of=200):
    """Readings 0, 1, 2 ... in any order, and which of them were wrong."""
    wrong = np.zeros(of, dtype=bool)
    wrong[np.concatenate(which)] = True
    order = np.random.default_rng(of).permutation(of)
    return np.arange(of)[order].astype(float), wrong[order]


def test_a_joint_that_is_wrong_in_one_place_is_told_with_the_place():
    assert uneven_place(*wrong_at(range(30, 42), of=80)) == (30.0, 41.0)
    assert uneven_place(*wrong_at(range(30, 42), [7, 70], of=80)) == (30.0, 41.0)


def test_a_joint_that_slips_does_so_in_no_place():
    rng = np.random.default_rng(5)
    said = [uneven_place(np.arange(80.0), rng.random(80) < 0.15) for _ in range(300)]
    assert said == [None] * 300
    assert uneven_place(np.arange(80.0), np.ones(80, dtype=bool)) is None
    assert uneven_place(*wrong_at([3, 4], of=80)) is None


@pytest.mark.parametrize(
    ("wrong", "place"),
    [
        # Chances 820 / binom(40, 8) = 1.07e-5 and 861 / binom(41, 8) = 9.0e-6 of anywhere.
        (wrong_at(range(8), of=40), None),
        (wrong_at(range(8), of=41), (0.0, 7.0)),
        # Half of the poses of a window, and one less.
        (wrong_at(range(20, 30, 2), range(31, 41, 2)), (20.0, 39.0)),
        (wrong_at(range(20, 30, 2), range(32, 42, 2)), None),
        # Half of all that are wrong, and one less.
        (wrong_at(range(50, 60), range(100, 400, 30), of=400), (50.0, 59.0)),
        (wrong_at(range(50, 60), range(90, 400, 30), of=400), None),
    ],
)
def test_a_place_is_told_from_half_wrong_and_a_chance_of_one_in_a_hundred_thousand_on(wrong, place):
    assert uneven_place(*wrong) == place


@pytest.mark.parametrize(("off", "said"), [(4.9e-3, False), (5.1e-3, True)])
def test_a_place_fails_from_5_milliradians_on(make_truth, off, said):
    truth = make_truth(3, 6, unit="rad", kind="elbow")
    q = np.zeros((60, 3))
    q[:, 1] = np.linspace(-1.0, 1.0, 60)
    rows = Observations.from_dataset(truth.dataset(q))
    wrong = np.arange(20, 32)
    words = _uneven_words(rows, 1, "'joint_1'", np.arange(60), wrong, np.full(12, off))
    assert bool(words) is said
    if said:
        low, high = sorted(np.degrees(truth.servos.to_encoder(q)[[20, 31], 1]))
        assert f"in 12 of 12 poses in which 'joint_1' read {low:.0f} to {high:.0f} deg" in words[0]
        assert "and in 0 of 48 others" in words[0]


def test_an_encoder_that_stood_is_named_before_the_time_from_which_on_outliers_lie():
    arm, world = ArmDescription.named("nico"), IMPERFECTIONS["thesis"]
    poses = replace(SweepProtocol.for_arm(arm), random_poses=60)
    data = simulated_session(arm, world, poses, "stood", seed=1, session=0)
    encoders, elbow = np.array(data.encoders), data.joint_names.index("right_elbow")
    stood = np.flatnonzero(data.sweep == "")[20:34]
    encoders[stood, elbow] = encoders[stood[0], elbow]
    verdict = judge(calibrate_kinematics(replace(data, encoders=encoders)))
    assert verdict.status == "FAIL"
    assert "'right_elbow' stands at" in verdict.reasons[0]
    assert not any("outliers lie after" in one for one in verdict.reasons)
