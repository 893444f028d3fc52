"""Backlash whose side nobody told, and joints that turn too far for a bend, are no PASS."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.conversion import body_dataset_of
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.bending.implausible import FAR_TURNS, TURNS
from nico_selfmodel.estimation.bending.ladder import Ladder
from nico_selfmodel.estimation.bending.steps import HIDDEN, Step
from nico_selfmodel.estimation.bending.what_bends import bending_faults
from nico_selfmodel.estimation.diagnosis.pattern_taken_for_noise import pattern_taken_for_noise
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree

from .sagging_arms import SaggingArm

COUNT = 60


def errors_of(kind, share, rng):
    """A joint's errors, a share of their squares by what is asked for, and its places."""
    place = rng.uniform(-1.3, 1.3, COUNT)
    step = np.diff(place, prepend=0.0)
    made = {"side": np.sign(step), "angle": np.sin(2.0 * place + 0.4), "moment": step}[kind]
    return 0.01 * (np.sqrt(share) * made + np.sqrt(1.0 - share) * rng.normal(size=COUNT)), place


@pytest.mark.parametrize(("share", "found"), [(0.95, True), (0.3, False)])
@pytest.mark.parametrize(("kind", "side"), [("side", True), ("angle", False), ("moment", None)])
def test_what_most_of_a_joint_s_errors_follow_is_found(kind, side, share, found):
    errors, place = errors_of(kind, share, np.random.default_rng(3))
    pattern = pattern_taken_for_noise(errors, place, np.arange(COUNT))
    assert (pattern is not None) == (found and side is not None)
    if pattern is not None:
        assert pattern.side == side
        assert not side or pattern.size == pytest.approx(0.0097, rel=0.1)


def test_samples_that_were_left_out_tell_no_side():
    errors, place = errors_of("side", 0.99, np.random.default_rng(3))
    kept = np.random.default_rng(4).permutation(COUNT)[:45]
    kept.sort()
    assert pattern_taken_for_noise(errors[kept], place[kept], kept).side
    assert pattern_taken_for_noise(errors[:19], place[:19], np.arange(19)) is None


@pytest.mark.parametrize(
    ("reason", "gain", "sigma", "fails"),
    [
        (TURNS, 0.42, 0.1, True),
        (FAR_TURNS, 0.42, 0.1, True),
        (FAR_TURNS, 0.39, 0.1, False),
        (FAR_TURNS, 0.42, 0.22, False),
        (HIDDEN, 0.42, 0.1, False),
    ],
)
def test_a_joint_that_turns_too_far_fails_where_unseen_poses_would_be_met_much_better(
    reason, gain, sigma, fails
):
    step = Step("ripple", False, 3.0, 2.0, gain, sigma, 99.0, reason, joint="wrist")
    said = bending_faults(Ladder((step,), None))
    assert len(said) == fails
    assert all("'wrist' would turn by more than 3 deg" in one for one in said)


@pytest.mark.slow
@pytest.mark.parametrize("body", [False, True])
@pytest.mark.parametrize(
    ("fault", "words"), [("backlash", "backlash, half"), ("ripple", "no bend")]
)
def test_one_joint_s_backlash_or_ripple_that_nothing_learns_fails_by_name(body, fault, words):
    rng = np.random.default_rng((3, 77))
    arm = SaggingArm.drawn(rng, sag=0.0)
    gaps, waves = np.zeros(6), np.zeros((6, 2, 2))
    if fault == "backlash":
        gaps[4] = np.radians(0.6)
    else:
        waves[4, 0] = np.radians(4.0) * np.array([0.8, 0.6])
    arm = replace(arm, backlash=gaps, ripple=waves)
    train, test = (
        replace(arm.recorded(rng, n)[0], approach=None, point_sigma_m=None) for n in (80, 40)
    )
    learned = (
        calibrate_tree(body_dataset_of(train), test=body_dataset_of(test))
        if body
        else calibrate_kinematics(train, test=test)
    )
    verdict = judge(learned)
    assert verdict.status == "FAIL"
    assert words in verdict.reasons[0]
    assert "j5" in verdict.reasons[0]
    assert not any("direction from which" in warning for warning in verdict.warnings)
