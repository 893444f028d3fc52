"""Recordings that went wrong: each fails, or passes with a word on what was set aside, and why."""

import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.fault_hypotheses import neighbours_explain
from nico_selfmodel.estimation.diagnosis.mistaken_units import mistaken_units
from nico_selfmodel.estimation.diagnosis.nominal_check import robot_size
from nico_selfmodel.estimation.diagnosis.suspected_readings import unwrapped_readings
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.model_verdict import judge_evaluation
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.outlier_words import (
    chance_of_more,
    describe_outliers,
    foreign_markers,
    stood_in_a_row,
    stuck_encoder,
)
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable

from ..slow_rest import slow_rest

SIGMA = 3e-4
POSES = 70


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth(3, 2)


@pytest.fixture(scope="module")
def counting(make_truth):
    return make_truth(3, 2, unit="counts")


@pytest.fixture(scope="module")
def train(truth):
    return truth.dataset(truth.poses(POSES, 1), sigma=SIGMA, seed=2)


@pytest.fixture(scope="module")
def test_data(truth):
    return truth.dataset(truth.poses(40, 2), sigma=SIGMA, seed=3)


def moved(data: Dataset, rows, shift) -> Dataset:
    points = data.p_WH_measured.copy()
    points[rows] += shift
    return replace(data, p_WH_measured=points)


def failing(data: Dataset, **options) -> str:
    verdict = judge(calibrate_kinematics(data, **options))
    assert verdict.status == "FAIL"
    return verdict.reasons[0]


@pytest.mark.slow
def test_held_out_outliers_are_told_apart_from_the_error_of_the_model(train, test_data):
    spoiled_train = moved(train, [4, 20, 33, 50], [0.1, 0.0, 0.0])
    spoiled_test = moved(test_data, [7, 12], [0.0, 0.2, 0.0])
    result = calibrate_kinematics(spoiled_train, test=spoiled_test)
    verdict = judge(result)
    assert verdict.status == "PASS"
    assert "mean error on 40 poses that were held out, 38 of 40 points" in verdict.reasons[0]
    assert "samples 8, 13" in verdict.reasons[0]
    assert verdict.reasons[1].startswith("4 of 70 training points set aside: samples 5, 21,")
    again = judge_evaluation(result.model, spoiled_test, evaluate(result.model, spoiled_test))
    assert again.status == "PASS"
    assert "2 of 40 points are further off" in again.reasons[0]


@pytest.mark.slow
def test_held_out_points_that_are_wrong_far_more_often_than_training_points_fail(train, test_data):
    spoiled = moved(test_data, np.arange(8), [0.0, 0.2, 0.0])
    result = calibrate_kinematics(train, test=spoiled)
    assert "8 of 40 held-out points are further off" in judge(result).reasons[0]
    most = moved(test_data, np.arange(12), [0.0, 0.2, 0.0])
    assert judge_evaluation(result.model, most, evaluate(result.model, most)).status == "FAIL"


FROZEN = (
    "in 10 of which the encoder of b stands at 7 deg while the hand moves: it was frozen, or not "
    "read"
)


def test_a_frozen_encoder_is_named(train):
    encoders = train.encoders.copy()
    encoders[10:24, 1] = encoders[10, 1]
    result = calibrate_kinematics(replace(train, encoders=encoders))
    words = describe_outliers(result.train.observations, result.outliers)
    assert "encoder of joint_1 stands at" in words
    assert "frozen" in words


@pytest.mark.parametrize(
    ("poses", "named"),
    [
        pytest.param(14, r"'joint_1' stands at [\d.-]+ deg that was off", marks=pytest.mark.slow),
        pytest.param(24, r"'joint_1' stands at [\d.-]+ rad from sample 16 to 39 while others move"),
        pytest.param(35, "'joint_1' stands at .* from sample 16 to 50", marks=pytest.mark.slow),
    ],
)
def test_an_encoder_that_stands_in_part_of_a_recording_fails_by_name(train, poses, named):
    """In a fifth, a third and a half of 70 poses."""
    encoders = train.encoders.copy()
    encoders[15 : 15 + poses, 1] = encoders[15, 1]
    reason = failing(replace(train, encoders=encoders))
    assert re.search(named, reason)
    assert "frozen, or not read" in reason


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda read: read, True),
        (lambda read: read[:7], False),  # too few in a row
        (lambda read: read * [0.0, 1.0], False),  # both stand
        (lambda read: read[:, [1]], False),  # nothing else moves
        (lambda read: read[np.r_[:4, 8:12, 4:8]], False),  # not in a row
    ],
)
def test_an_encoder_stands_where_it_alone_reads_the_same_in_eight_samples_in_a_row(change, told):
    moving = np.linspace(0.0, 1.0, 12)
    read = change(np.column_stack([np.where(np.arange(12) < 8, 2.0, moving), moving])[:, ::-1])
    found = stood_in_a_row(("a", "b")[: read.shape[1]], ("rad", "deg"), np.arange(len(read)), read)
    assert (found is not None) is told
    if found is not None:
        assert (found[0], found[1].tolist()) == ("b", list(range(8)))
        assert "'b' stands at 2 deg from sample 0 to 7" in found[2]


@pytest.mark.parametrize(("right", "named"), [(0, True), (4, True), (5, False)])
def test_an_encoder_is_frozen_where_few_of_its_poses_are_right(right, named):
    sample = np.arange(20)
    readings = np.column_stack([np.linspace(0.0, 1.0, 20), np.where(sample < 10 + right, 7.0, 1.0)])
    words = stuck_encoder(("a", "b"), ("rad", "deg"), readings, sample, sample < 10)
    assert (words == FROZEN) is named


def test_a_whole_pose_that_has_no_reading_is_not_frozen():
    sample = np.arange(20)
    nothing = np.full((20, 1), np.nan)
    assert stuck_encoder(("tcp",), ("pose",), nothing, sample, sample < 10) == ""


@pytest.mark.slow
def test_a_marker_that_is_not_on_the_hand_is_named(make_truth):
    truth = make_truth(2, 5, markers=3)
    data = truth.dataset(truth.poses(30, 1), sigma=SIGMA, seed=2)
    ahead = truth.poses(30, 1)
    ahead[:, -1] = 0.0  # what a point on the link before the last sees
    other = truth.dataset(ahead, sigma=SIGMA, seed=3)
    own = data.marker == "wrist"
    points = np.where(own[:, None], other.p_WH_measured, data.p_WH_measured)
    reason = failing(replace(data, p_WH_measured=points), starts=1)
    assert reason.startswith("marker wrist does not move with the hand")
    assert "leave it out" in reason


def test_a_marker_whose_points_are_all_set_aside_is_named(train):
    rows = Observations.from_dataset(train)
    labelled = replace(rows, markers=("hand", "wrist"), marker=np.arange(POSES) % 2)
    reasons = foreign_markers(labelled, labelled.marker == 1)
    assert reasons[0].startswith("35 of 35 points of marker wrist contradict the other markers")
    assert not foreign_markers(labelled, np.arange(POSES) < 20)


@pytest.mark.slow
def test_a_tracker_that_was_pushed_in_the_middle_fails_and_says_when(train):
    pushed = moved(train, np.arange(POSES) >= 40, [5 * SIGMA, 0.0, 0.0])
    reason = failing(pushed)
    assert reason.startswith("tracker or base moved by about (1.")
    after = int(re.search(r"after sample (\d+)", reason)[1])
    assert abs(after - 40) <= 2
    assert judge(calibrate_kinematics(train)).status == "NOT_EVALUATED"


@pytest.mark.slow
def test_an_encoder_that_wraps_in_the_middle_of_its_range_is_named_with_the_cure(counting):
    data = counting.dataset(counting.poses(POSES, 1), sigma=SIGMA, seed=2)
    wrapped = data.encoders.copy()
    wrapped[:, 2] = (wrapped[:, 2] - np.median(wrapped[:, 2])) % 10000.0
    reason = failing(replace(data, encoders=wrapped))
    assert "unwrap them (add " in reason
    assert "10000 to readings of joint_2" in reason
    unwrapped, joints = unwrapped_readings(
        Observations.from_dataset(replace(data, encoders=wrapped))
    )
    assert joints == [2]
    good = Observations.from_dataset(data).angles
    assert np.ptp(unwrapped - good, axis=0) == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "words"), [(1, "before"), (-1, "after")])
def test_readings_that_lag_by_a_row_are_named(train, shift, words):
    reason = failing(replace(train, encoders=np.roll(train.encoders, -shift, axis=0)), starts=1)
    assert f"the readings of the sample {words} its own" in reason


@pytest.mark.slow
def test_joints_told_from_the_hand_to_the_base_are_named(make_truth):
    truth = make_truth(4, 3)
    data = truth.dataset(truth.poses(POSES, 4), sigma=SIGMA, seed=5)
    about = replace(data, encoders=data.encoders[:, ::-1])
    assert failing(about, starts=1).startswith("joints are told from the hand to the base")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("read", "words"),
    [
        (lambda a, b: (a + b, a - b), "joint_1 and joint_2 turn by half the sum and half the diff"),
        (lambda a, b: (a + b, b - a), "joint_1 and joint_2 turn by half the difference and half"),
        (lambda a, b: (a, b - a), "joint_2 turns by the sum of what is read of joint_1 and of it"),
        (lambda a, b: (a, a + b), "joint_2 turns by what is read of it less that of joint_1"),
    ],
)
def test_drives_that_move_two_joints_are_named(train, read, words):
    encoders = train.encoders.copy()
    encoders[:, 1:] = np.stack(read(*train.encoders.T[1:]), axis=1)
    assert failing(replace(train, encoders=encoders), starts=1).startswith(words)


@pytest.mark.parametrize(("share", "explain"), [(0.07, False), (0.12, True)])
def test_sums_of_readings_are_asked_where_neighbours_explain_a_tenth(truth, share, explain):
    q = truth.poses(600, 1)
    coupled = q + 1e-4 * q[:, [1]] * [1.0, 0.0, 0.0]
    seen = Observations.from_dataset(truth.dataset(q))
    off = truth.chain.forward(coupled, seen.marker) - seen.p_WH
    noise = np.random.default_rng(0).normal(size=off.shape)
    noise *= np.linalg.norm(off) / np.linalg.norm(noise) * np.sqrt(1.0 / share - 1.0)
    arm = ArmEstimate(truth.chain, truth.servos.gear, truth.servos.offset)
    assert neighbours_explain(replace(seen, p_WH=seen.p_WH + off + noise), arm) is explain


@pytest.mark.slow
def test_radians_stated_as_degrees_are_named(train):
    joints = tuple(replace(joint, encoder_unit="deg") for joint in train.joints)
    reason = failing(replace(train, joints=joints), starts=1)
    assert reason.startswith("all joints are read in rad, not in deg as stated")


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "read"), [("deg", "rad"), ("rad", "deg")])
def test_one_joint_read_in_another_unit_than_stated_is_named_alone(make_truth, stated, read):
    truth = make_truth(4, 3)
    data = truth.dataset(truth.poses(POSES, 4), sigma=SIGMA, seed=5)  # all are read in rad
    mistaken = np.arange(4) == 2
    in_stated = mistaken if stated == "rad" else ~mistaken
    encoders = np.where(in_stated, np.degrees(data.encoders), data.encoders)
    joints = tuple(replace(joint, encoder_unit=stated) for joint in data.joints)
    reason = failing(replace(data, joints=joints, encoders=encoders), starts=1)
    assert f"{joints[2].name} is read in {read}, not in {stated}" in reason
    assert not any(f"{joint.name} is read in" in reason for joint in np.delete(joints, 2))
    assert "--free" not in reason


def test_only_joints_that_are_asked_about_and_turn_too_little_are_in_doubt():
    spans = np.radians([170.0, 120.0, 2.0, 90.0])
    angles = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 4)) * spans
    asked = np.array([True, True, False, True])
    assert np.all(mistaken_units(angles, ("deg",) * 4, asked) == 1.0)
    assert np.flatnonzero(mistaken_units(angles, ("deg",) * 4, ~asked) != 1.0).tolist() == [2]


@pytest.mark.parametrize(
    ("stated", "spans", "mistaken"),
    [
        ("deg", [0.21, 0.15], True),
        ("deg", [0.22, 0.15], False),
        ("rad", [13.0, 20.0], True),
        ("rad", [12.0, 20.0], False),
        ("counts", [0.1, 0.1], False),
    ],
)
def test_all_joints_are_in_doubt_where_all_turned_too_far_or_too_little(stated, spans, mistaken):
    angles, asked = np.linspace(0.0, 1.0, 9)[:, None] * spans, np.ones(2, dtype=bool)
    assert (mistaken_units(angles, (stated,) * 2, asked) != 1.0).all() == mistaken
    assert (mistaken_units(angles, (stated,) * 2, ~asked) == 1.0).all()


def test_a_mirrored_or_rescaled_robot_is_told_from_a_described_one(make_truth):
    nominal = make_truth(6, 3, kind="elbow").chain
    for known in (np.ones(6, dtype=bool), np.zeros(6, dtype=bool)):
        for scale, word in ((1.0, None), (-1.0, "left-handed"), (1e-3, "0.001 times"), (1.2, None)):
            # Mirrored points turn every sense of rotation: a scale of -1 with directions as before.
            learned = Chain(
                nominal.joints,
                nominal.directions,
                scale * nominal.points,
                nominal.markers,
                scale * nominal.p_WH_zero,
            )
            size = robot_size(nominal, DhTable.from_chain(learned), known)
            assert size is not None
            assert size.scale == pytest.approx(scale)
            assert (size.reason is None) == (word is None)
            assert word is None or word in str(size.reason)
            assert (size.warning is None) == (scale != 1.2)


def test_points_within_some_millimetres_are_asked_about_when_they_are_read(train, tmp_path):
    save_dataset(replace(train, p_WH_measured=1e-3 * train.p_WH_measured), tmp_path / "tiny")
    with pytest.warns(UserWarning, match="were metres given as millimetres"):
        load_dataset(tmp_path / "tiny")


def test_the_chance_of_more_outliers_is_that_of_fishers_exact_test():
    # 3 of 4 against 1 of 4: 17 / 70.
    assert chance_of_more(3, 4, 1, 4) == pytest.approx(17.0 / 70.0)
    assert chance_of_more(0, 4, 1, 4) == pytest.approx(1.0)


def with_exchanged(data: Dataset, share: float, seed: int) -> tuple[Dataset, list[int]]:
    """Return a recording in a share of whose samples two markers' names are exchanged."""
    samples = np.unique(data.sample)
    rng = np.random.default_rng(seed)
    some = rng.choice(samples, round(share * len(samples)), replace=False)
    first, second = sorted(dict.fromkeys(data.marker.tolist()))[:2]
    other = np.where(data.marker == first, second, np.where(data.marker == second, first, ""))
    mixed = np.isin(data.sample, some) & (other != "")
    return replace(data, marker=np.where(mixed, other, data.marker)), sorted(some.tolist())


@pytest.fixture(scope="module")
def of_three(make_truth):
    truth = make_truth(3, 4, markers=3)
    return truth.dataset(truth.poses(100, 1), sigma=SIGMA, seed=2)


@pytest.mark.slow
def test_markers_exchanged_in_an_eighth_of_the_samples_are_named(of_three):
    data, samples = with_exchanged(of_three, 0.12, 7)
    warnings = judge(calibrate_kinematics(data)).warnings
    first, second = sorted(dict.fromkeys(of_three.marker.tolist()))[:2]
    (words,) = [w for w in warnings if "exchanged" in w]
    assert words.startswith(f"markers {first} and {second} are exchanged in 12 of 100 samples")
    assert f"samples {samples[0]}, {samples[1]}" in words
    sound = judge(calibrate_kinematics(of_three))
    assert not any("exchanged" in words for words in (*sound.warnings, *sound.reasons))


@pytest.mark.parametrize("share", slow_rest([0.5, 0.3]))
def test_markers_exchanged_in_many_samples_fail_by_name(of_three, share):
    data, _ = with_exchanged(of_three, share, 7)
    first, second = sorted(dict.fromkeys(of_three.marker.tolist()))[:2]
    words = f"markers {first} and {second} are exchanged in {round(100 * share)} of 100 samples"
    assert failing(data).startswith(words)
