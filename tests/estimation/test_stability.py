"""What changed in the middle of a recording: found with its size and time, not found in order."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.judging import judge

from ..slow_rest import slow_rest
from .random_arms import random_recording

SIGMA = 3e-4
POSES = 90


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth(4, 2, unit="counts", kind="elbow", markers=2)


@pytest.fixture(scope="module")
def data(truth) -> Dataset:
    return truth.dataset(truth.poses(POSES, 1), sigma=SIGMA, seed=1)


def late(data: Dataset, after: int = 40):
    return (data.sample > after)[:, None]


def reason(data: Dataset) -> str:
    verdict = judge(calibrate_kinematics(data))
    assert verdict.status == "FAIL"
    return " ".join(verdict.reasons)


@pytest.mark.parametrize("seed", slow_rest((10, 11, 12, 13, 14)))
def test_nothing_changed_where_nothing_changed(truth, seed):
    again = truth.dataset(truth.poses(POSES, 1), sigma=SIGMA, seed=seed)
    result = calibrate_kinematics(again)
    assert result.change is None
    assert result.lag is None


@pytest.mark.slow
def test_an_encoder_that_jumped_is_named_with_how_far_and_when(truth, data):
    counts = np.radians(2.0) * truth.servos.gear[2] * 10000.0 / (2.0 * np.pi)
    jumped = data.encoders + late(data) * np.array([0.0, 0.0, round(counts), 0.0])
    words = reason(replace(data, encoders=jumped))
    assert "the encoder of 'joint_2' jumped by about 2" in words
    assert any(f"after sample {k}:" in words for k in (39, 40, 41))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "named"),
    [(0.0, "marker thumb"), (0.003, "what carries the markers on the hand moved by about 3")],
)
def test_a_marker_that_slipped_is_named_or_what_carries_all(truth, data, first, named):
    moved = truth.chain.p_WH_zero + np.array([[0.0, first, 0.0], [0.0, 0.003, 0.0]])
    slipped = replace(truth, chain=replace(truth.chain, p_WH_zero=moved))
    other = slipped.dataset(truth.poses(POSES, 1), sigma=SIGMA, seed=1)
    points = np.where(late(data), other.p_WH_measured, data.p_WH_measured)
    words = reason(replace(data, p_WH_measured=points))
    assert named in words


@pytest.mark.slow
def test_a_tracker_that_drifts_is_named(data):
    drift = (data.sample / POSES)[:, None] * np.array([0.004, 0.0, 0.0])
    words = reason(replace(data, p_WH_measured=data.p_WH_measured + drift))
    assert "tracker or base drifted by about (" in words


@pytest.mark.slow
def test_a_change_too_small_to_matter_is_a_note(data):
    shift = late(data) * np.array([1.2 * SIGMA, 0.0, 0.0])
    result = calibrate_kinematics(replace(data, p_WH_measured=data.p_WH_measured + shift))
    assert result.change is not None
    assert not result.change.notable
    verdict = judge(result)
    assert verdict.status == "NOT_EVALUATED"
    assert any("too little to matter" in words for words in verdict.warnings)


@pytest.mark.parametrize(("ratio", "status"), [(1.11, "FAIL"), (1.09, "NOT_EVALUATED")])
def test_a_notable_change_fails(data, ratio, status):
    shift = late(data) * np.array([0.002, 0.0, 0.0])
    result = calibrate_kinematics(replace(data, p_WH_measured=data.p_WH_measured + shift))
    assert result.change is not None
    changed = replace(result, change=replace(result.change, ratio=ratio))
    assert judge(changed).status == status


@pytest.mark.slow
def test_what_depends_on_the_place_is_not_blamed_on_time_where_poses_follow_an_order(truth):
    q = truth.poses(POSES, 1)
    q = q[np.argsort(q[:, 0])]
    true = q.copy()
    true[:, 0] += np.radians(0.4) * np.sin(3.0 * q[:, 0])
    data = truth.dataset(true, sigma=SIGMA, seed=2)
    rows = np.repeat(np.arange(POSES), 2)
    result = calibrate_kinematics(replace(data, encoders=truth.servos.to_encoder(q)[rows]))
    assert result.change is None or not result.change.notable


def path(truth, count=120):
    rng = np.random.default_rng(5)
    knots = np.cumsum(rng.normal(size=(count // 6 + 2, 4)), axis=0)
    knots = 0.8 * knots / np.abs(knots).max(axis=0)
    at = np.linspace(0.0, len(knots) - 1.001, count)
    k, s = at.astype(int), (at % 1.0)[:, None]
    return (1.0 - s) * knots[k] + s * knots[k + 1]


@pytest.mark.slow
@pytest.mark.parametrize("late_by", [0.4, pytest.param(1.5, marks=pytest.mark.slow)])
def test_points_that_lag_behind_the_readings_are_named_with_how_far(truth, late_by):
    q = path(truth)
    at = np.arange(len(q)) - late_by
    true = np.stack([np.interp(at, np.arange(len(q)), column) for column in q.T], axis=1)
    data = truth.dataset(true, sigma=SIGMA, seed=2)
    rows = np.repeat(np.arange(len(q)), 2)
    lagging = replace(data, encoders=truth.servos.to_encoder(q)[rows])
    words = reason(lagging)
    assert "the points lag behind the readings by about" in words
    size = float(words.split("by about ")[-1].split()[0])
    assert size == pytest.approx(late_by, rel=0.35)


@pytest.mark.slow
def test_a_jump_that_looks_like_an_eccentric_gear_is_told_by_what_it_explains():
    recording = random_recording("encoder jump", 5003, fresh=1)
    train, _ = recording.dataset.split(0.3, 1)
    result = calibrate_kinematics(train, explain=False, effects=())
    assert result.patterns
    assert result.change is not None
    assert result.change.notable


@pytest.mark.slow
def test_a_jump_that_joint_noise_took_for_its_own_is_told_by_what_it_explains():
    recording = random_recording("encoder jump", 6115, fresh=1)
    train, _ = recording.dataset.split(0.3, 1)
    result = calibrate_kinematics(train, explain=False)
    assert "the encoder of 'j1' jumped by about 2.8 deg after sample 18" in reason_of(result)


def reason_of(result) -> str:
    return " ".join(judge(result).reasons)


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [6100, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (6109, 6113))]
)
def test_backlash_in_sweeps_is_no_jump(seed):
    """A joint stands on one side of its play before its own sweep, and on the other after it."""
    train, _ = random_recording("backlash", seed, fresh=1).dataset.split(0.3, 1)
    result = calibrate_kinematics(train, explain=False)
    assert result.change is None or not result.change.notable


def swung(truth, count=60):
    """Return joints that swing at frequencies of their own. Shape (count, n)."""
    rng, n = np.random.default_rng(5), len(truth.servos.gear)
    t, size = np.linspace(0.0, 1.0, count)[:, None], rng.uniform(0.6, 1.2, n)
    return size * np.sin(2.0 * np.pi * (rng.uniform(2.0, 6.0, n) * t + rng.uniform(size=n)))


@pytest.mark.parametrize("seed", slow_rest(range(4)))
def test_no_bend_hides_an_encoder_that_leads_all_others(make_truth, seed):
    truth = make_truth(6, seed)
    q = swung(truth)
    ahead = q.copy()
    ahead[:-1, 2] += 0.15 * np.diff(q[:, 2])
    data = truth.dataset(q, sigma=SIGMA, seed=seed)
    words = reason(replace(data, encoders=truth.servos.to_encoder(ahead)))
    assert "the readings of 'joint_2' lead what was seen by about 0.1" in words
