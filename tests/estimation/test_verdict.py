"""PASS, FAIL or NOT_EVALUATED, each with its reason."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from nico_selfmodel.estimation.arm.evaluation import evaluate
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.estimation.diagnosis.score_test import Score
from nico_selfmodel.estimation.diagnosis.systematic_residuals import Pattern
from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.model_verdict import judge_evaluation
from nico_selfmodel.estimation.results.verdict import rank_score

SIGMA = 3e-4
SAMPLE = arrays(float, st.integers(1, 40), elements=st.integers(0, 50).map(float))
DISTINCT = st.lists(st.integers(0, 10**6), min_size=4, max_size=60, unique=True)


@pytest.fixture(scope="module")
def truth(make_truth):
    return make_truth(4, 2, unit="counts", kind="elbow")


@pytest.fixture(scope="module")
def train(truth, joined):
    circles = truth.dataset(*truth.sweeps(12), sigma=SIGMA, seed=1)
    return joined(circles, truth.dataset(truth.poses(60, 1), sigma=SIGMA, seed=2))


@pytest.fixture(scope="module")
def held_out_data(truth):
    return truth.dataset(truth.poses(60, 2), sigma=SIGMA, seed=3)


@pytest.fixture(scope="module")
def good(train, held_out_data):
    return calibrate_kinematics(train, test=held_out_data)


def test_a_good_calibration_passes_with_its_held_out_error(good):
    verdict = judge(good)
    assert verdict.status == "PASS"
    (reason,) = verdict.reasons
    assert f"{1e3 * good.test.statistics.mean:.2f} mm mean error on 60 poses" in reason


def test_a_model_is_judged_by_new_data_as_by_held_out_ones(good, held_out_data):
    verdict = judge_evaluation(good.model, held_out_data, evaluate(good.model, held_out_data))
    assert verdict.status == "PASS"
    assert f"expected {1e3 * np.median(good.cross_validation[-60:]):.2f} mm" in verdict.reasons[0]
    points = held_out_data.p_WH_measured + np.array([0.001, 0.0, 0.0])
    moved = replace(held_out_data, p_WH_measured=points)
    verdict = judge_evaluation(good.model, moved, evaluate(good.model, moved))
    assert verdict.status == "FAIL"
    assert "significantly above that of the training poses" in verdict.reasons[0]
    for data, model in (
        (held_out_data.select(np.arange(4)), good.model),
        (held_out_data, replace(good.model, fit={})),
    ):
        assert judge_evaluation(model, data, evaluate(model, data)).status == "NOT_EVALUATED"


def test_a_good_model_hardly_ever_fails_on_new_data(truth, good):
    for seed in range(40):
        new = truth.dataset(truth.poses(60, 100 + seed), sigma=SIGMA, seed=100 + seed)
        assert judge_evaluation(good.model, new, evaluate(good.model, new)).status == "PASS"


@pytest.mark.slow
def test_without_held_out_data_nothing_is_evaluated_but_cross_validated(train, good):
    alone = calibrate_kinematics(train)
    verdict = judge(alone)
    assert verdict.status == "NOT_EVALUATED"
    assert "nothing was held out" in verdict.reasons[0]
    assert len(alone.cross_validation) == len(train) - alone.outliers.sum()
    required = judge(alone, require_test_mm=5.0)
    assert required.status == "FAIL"
    assert "nothing was held out" in required.reasons[0]


def test_a_bound_in_pixels_on_held_out_poses_without_any_says_that_there_are_none(good):
    verdict = judge(good, require_test_px=3.0)
    assert verdict.status == "FAIL"
    (said,) = verdict.reasons
    assert said == "--require-test-px was given, but what was held out has no pixels"


def test_a_bound_is_met_or_missed_with_both_numbers(good):
    mean = 1e3 * good.test.statistics.mean
    assert judge(good, require_test_mm=1.01 * mean).status == "PASS"
    missed = judge(good, require_test_mm=0.25)
    assert missed.status == "FAIL"
    assert missed.reasons == (f"mean held-out error {mean:.3f} mm, required at most 0.25 mm",)


def test_a_solver_that_stopped_early_fails(good):
    verdict = judge(replace(good, converged=False, iterations=100))
    assert verdict.status == "FAIL"
    assert "stopped after 100 steps" in verdict.reasons[0]


@pytest.mark.parametrize(
    ("agreeing", "noise", "fails"),
    [(1, 0.0051, True), (1, 0.0049, False), (2, 0.0051, False)],
)
def test_a_minimum_that_one_start_reached_fails_where_it_leaves_much(good, agreeing, noise, fails):
    search = replace(good.search, labels=("random axes",) * 10, agreeing=agreeing)
    model = replace(good.model, noise_sigma=noise * good.train.observations.size)
    verdict = judge(replace(good, search=search, model=model))
    assert (verdict.status == "FAIL") is fails
    assert any("only one of 10 starts" in reason for reason in verdict.reasons) is fails


def test_a_minimum_that_one_start_reached_fails_where_residuals_depend_on_the_pose(good):
    search = replace(good.search, labels=("random axes",) * 10, agreeing=1)
    assert judge(replace(good, search=search)).status == "PASS"
    score = Score(50.0, 1, np.ones(1), np.ones(1), 1e-3, 1.1)
    pattern = Pattern("the angle of joint_1", score, np.zeros((1, 3, 1)))
    verdict = judge(replace(good, search=search, patterns=(pattern,)))
    assert "only one of 10 starts" in verdict.reasons[0]


def test_a_tracker_that_was_moved_between_recordings_fails(good, train, held_out_data):
    moved = replace(
        held_out_data, p_WH_measured=held_out_data.p_WH_measured + np.array([0.0, 0.0015, 0.0])
    )
    verdict = judge(calibrate_kinematics(train, test=moved))
    assert verdict.status == "FAIL"
    assert "significantly above" in verdict.reasons[0]
    assert "something moved between recordings" in verdict.reasons[0]


@pytest.mark.slow
def test_noise_far_above_the_stated_one_fails(train, held_out_data):
    stated = replace(train, point_sigma_m=1e-5)
    verdict = judge(calibrate_kinematics(stated, test=held_out_data))
    assert verdict.status == "FAIL"
    assert "31 times the stated point_sigma_m (0.01 mm)" in verdict.reasons[0]
    honest = replace(train, point_sigma_m=SIGMA)
    assert judge(calibrate_kinematics(honest, test=held_out_data)).status == "PASS"


@pytest.mark.slow
def test_an_arm_that_was_bent_between_recordings_fails(truth, train):
    chain = truth.chain
    shift = np.array([[0.0] * 3, [0.0] * 3, [0.002] * 3, [0.0] * 3])
    bent = replace(chain, points=chain.points + shift)
    other = replace(truth, chain=bent)
    test = other.dataset(truth.poses(60, 2), sigma=SIGMA, seed=3)
    assert judge(calibrate_kinematics(train, test=test)).status == "FAIL"


@pytest.mark.slow
def test_held_out_poses_far_from_the_training_poses_fail(truth, joined):
    near = truth.dataset(truth.poses(40, 1, span=0.3), sigma=SIGMA, seed=2)
    far = truth.dataset(truth.poses(60, 2, span=2.5), sigma=SIGMA, seed=3)
    circles = truth.dataset(*truth.sweeps(8, arc=0.3), sigma=SIGMA)
    result = calibrate_kinematics(joined(circles, near), test=far)
    assert result.test.statistics.median > 3.0 * np.median(result.cross_validation)
    verdict = judge(result)
    assert verdict.status == "FAIL"
    assert any("do not cover where the arm is used" in reason for reason in verdict.reasons)


@pytest.mark.slow
def test_a_good_calibration_hardly_ever_fails(truth, joined):
    """The held-out check is a test at one in 2000; twenty recordings must all pass."""
    q, labels = truth.sweeps(6)
    for seed in range(20):
        circles = truth.dataset(q, labels, sigma=SIGMA, seed=2 * seed)
        poses = truth.dataset(truth.poses(60, seed), sigma=SIGMA, seed=2 * seed + 1)
        test = truth.dataset(truth.poses(60, 500 + seed), sigma=SIGMA, seed=1000 + seed)
        verdict = judge(calibrate_kinematics(joined(circles, poses), test=test, starts=0))
        assert verdict.status == "PASS", (seed, verdict.reasons)


@given(values=DISTINCT, cut=st.integers(0, 58))
def test_the_rank_score_knows_which_sample_is_larger(values, cut):
    cut = 1 + cut % (len(values) - 1)
    a, b = np.array(values[:cut], dtype=float), np.array(values[cut:], dtype=float)
    score = rank_score(a, b)
    assert score == pytest.approx(-rank_score(b, a))
    assert rank_score(np.exp(1e-6 * a), np.exp(1e-6 * b)) == pytest.approx(score)
    assert rank_score(a, b + 2e6) >= score
    largest = np.sqrt(3.0 * len(a) * len(b) / (len(a) + len(b) + 1.0))
    assert abs(score) <= largest + 1e-9
    assert rank_score(a, b + 2e6) == pytest.approx(largest)


@pytest.mark.slow
@given(a=SAMPLE, b=SAMPLE)
def test_the_rank_score_is_fair_to_ties(a, b):
    assert rank_score(a, b) == pytest.approx(-rank_score(b, a), abs=1e-9)


def test_the_rank_score_is_about_standard_normal_for_one_distribution():
    rng = np.random.default_rng(0)
    scores = [rank_score(rng.rayleigh(size=50), rng.rayleigh(size=30)) for _ in range(2000)]
    assert np.mean(scores) == pytest.approx(0.0, abs=0.08)
    assert np.std(scores) == pytest.approx(1.0, abs=0.05)
