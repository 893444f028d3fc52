"""Poses that contradict a body here and there: how many are no accident, and what is said."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest

from nico_selfmodel.estimation.judging import judge
from nico_selfmodel.estimation.model_verdict import judge_body_errors, judge_evaluation
from nico_selfmodel.estimation.monitoring.body_health import body_contradictions, check_body_health
from nico_selfmodel.estimation.monitoring.body_relearning import relearn_body, rezero_body
from nico_selfmodel.estimation.monitoring.diagnosis import Diagnosis, Hypothesis
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.estimation.monitoring.health_document import health_document
from nico_selfmodel.estimation.monitoring.relearning import left_by_cause
from nico_selfmodel.estimation.monitoring.tool import rezero
from nico_selfmodel.estimation.noise.contradictions import most_expected
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels
from nico_selfmodel.estimation.tree.compared_errors import errors_of_tree
from nico_selfmodel.estimation.tree.tree_errors import errors_of
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS
from nico_selfmodel.model.tree.body_model import BodyModel

from ..slow_rest import slow_rest
from .simulated_bodies import body, learned, only_cameras, poses
from .simulated_trees import one_arm, two_arms


@pytest.fixture(scope="module")
def model():
    return learned(0).model


def spoilt(count, among=90, seed=4):
    """Return a recording in which so many poses are seen 60 px beside where they are."""
    data = only_cameras(poses(body(), among, seed=seed))
    pixels = data.pixels.copy()
    wrong = np.linspace(2, among - 3, count).astype(int)
    pixels[wrong, 0] += 60.0
    return replace(data, pixels=pixels), data.sample[wrong]


@pytest.mark.parametrize(("poses", "share"), [(1, 0.005), (60, 0.06), (100, 0.012), (2000, 0.03)])
def test_more_contradicting_poses_than_expected_are_rarer_than_one_in_a_thousand(poses, share):
    def beyond(k):
        return 1.0 - sum(
            comb(poses, i) * share**i * (1.0 - share) ** (poses - i) for i in range(k + 1)
        )

    most = most_expected(poses, share)
    assert beyond(most) < 1e-3 <= beyond(most - 1)


@pytest.mark.slow
def test_a_tenth_of_the_poses_off_here_and_there_fails_the_monitor_by_number(model):
    data, wrong = spoilt(9)
    report = check_health(model, data)
    assert report.alarm_at is None
    document = health_document(report)
    assert document["status"] == "FAIL"
    assert document["contradicting"]["samples"] == wrong.tolist()
    assert "9 of 90 poses are further off than noise explains" in document["reasons"][0]
    assert f"samples {wrong[0]}, {wrong[1]}" in document["reasons"][0]


def test_as_many_as_false_detections_explain_pass_and_are_named(model):
    data, wrong = spoilt(2)
    document = health_document(check_health(model, data))
    assert document["status"] == "PASS"
    assert f"samples {wrong[0]}, {wrong[1]}" in document["reasons"][-1]


def test_a_tenth_of_the_poses_off_here_and_there_fails_the_evaluation_by_number(model):
    data, wrong = spoilt(9)
    verdict = judge_evaluation(model, data, evaluate_pixels(model, data))
    assert verdict.status == "FAIL"
    assert "9 of 90 poses are further off" in verdict.reasons[0]
    assert f"samples {wrong[0]}, {wrong[1]}" in verdict.reasons[0]


def test_as_many_as_false_detections_explain_pass_the_evaluation(model):
    data, wrong = spoilt(2)
    verdict = judge_evaluation(model, data, evaluate_pixels(model, data))
    assert verdict.status == "PASS"
    assert f"samples {wrong[0]}, {wrong[1]}" in verdict.reasons[0]


def tree_of(sensor, poses=60, share=0.0):
    """Return a body that is known, and a recording of it with a share of its poses off."""
    made = one_arm(3, markers=3, poses=poses, sensor=sensor)
    noise = {s.name: 2e-4 if sensor == "points" else 0.3 for s in made.tree.sensors}
    noise |= dict.fromkeys(made.tree.joints, float(np.radians(0.2)))
    table = made.data.observations
    wrong = np.linspace(2, poses - 3, round(share * poses)).astype(int)
    values = table.values.copy()
    values[np.isin(table.pose, wrong), 0] += 0.05 if sensor == "points" else 40.0
    errors = errors_of_tree(errors_of(made.tree, made.data))
    median = {"median": float(np.median(errors.compared)), "n": poses}
    body = BodyModel("arm", made.tree, np.ones(5), noise=noise, expected={errors.unit: median})
    return body, replace(made.data, observations=replace(table, values=values)), wrong


@pytest.mark.parametrize("sensor", ["points", "camera"])
def test_a_whole_body_with_a_fifth_of_its_poses_off_fails_the_evaluation(sensor):
    body, data, wrong = tree_of(sensor, share=0.2)
    against = body_contradictions(body, data)
    assert against.sample[against.found].tolist() == wrong.tolist()
    verdict = judge_body_errors(body, errors_of_tree(errors_of(body.tree, data)), against)
    assert verdict.status == "FAIL"
    assert "12 of 60 poses are further off than noise explains" in verdict.reasons[0]
    body, data, _ = tree_of(sensor)
    sound = judge_body_errors(
        body, errors_of_tree(errors_of(body.tree, data)), body_contradictions(body, data)
    )
    assert sound.status == "PASS"


def test_a_whole_body_with_a_fifth_of_its_poses_off_fails_the_monitor():
    body, data, wrong = tree_of("camera", share=0.2)
    document = health_document(check_body_health(body, data))
    assert document["status"] == "FAIL"
    assert document["contradicting"]["samples"] == wrong.tolist()
    body, data, _ = tree_of("camera")
    assert check_body_health(body, data).healthy


def exchanged(count=30):
    """Return an arm of two points, and a recording in which their names are exchanged."""
    made = learned(0).model
    hand = np.vstack([made.dh.p_NH, made.dh.p_NH + np.array([0.0, 0.03, 0.05])])
    known = replace(made, table=replace(made.dh, markers=("hand", "thumb"), p_NH=hand))
    data = replace(only_cameras(poses(body(), count)), pixels=None)
    rows = np.repeat(np.arange(count), 2)
    marker = np.array(["hand", "thumb"] * count)
    noise = np.random.default_rng(3).normal(0.0, 1e-4, (2 * count, 3))
    places = known.predict(data.encoders[rows], np.tile([0, 1], count)).p_WH + noise
    names = ("encoders", "approach", "sample", "sweep", "mirror")
    arrays = {name: getattr(data, name)[rows] for name in names}
    told = np.array(["thumb", "hand"] * count)
    data = replace(data, **arrays, p_WH_measured=places, marker=marker, pixels=None, extra={})
    return known, data, replace(data, marker=told)


@pytest.mark.slow
def test_a_cause_that_leaves_the_misfit_is_not_told_as_the_cure():
    known, data, wrong = exchanged()
    assert check_health(known, data, "points").healthy
    report = check_health(known, wrong, "points")
    left = left_by_cause(known, wrong, report, "points")
    assert left is not None
    document = health_document(report, left)
    assert not document["explained"]
    assert "no one cause explains it" in document["reasons"][0]
    assert "each marker under its own name" in document["reasons"][1]


@pytest.mark.slow
def test_a_cause_that_explains_all_is_told_as_the_cure(model):
    one = body()
    one.faults.slip("right_elbow", np.radians(4.0))
    data = only_cameras(poses(one, 30))
    report = check_health(model, data)
    assert left_by_cause(model, data, report) is None
    assert health_document(report)["explained"]


@pytest.mark.slow
def test_a_fifth_of_the_poses_off_at_the_beginning_is_no_change_of_the_body(model):
    data = only_cameras(poses(body(), 60))
    pixels = data.pixels.copy()
    pixels[:12, 0] += 60.0
    wrong = replace(data, pixels=pixels)
    left = left_by_cause(model, wrong, check_health(model, wrong))
    assert left is not None


@pytest.mark.slow
@pytest.mark.parametrize("sensor", slow_rest(["camera", "points"]))
def test_a_body_does_not_fit_whose_new_zero_leaves_a_fifth_of_the_poses_off(sensor):
    body, data, wrong = tree_of(sensor, share=0.2)
    update = rezero_body(body, data, ["j3"])
    assert not update.fits
    assert update.against.sample[update.against.found].tolist() == wrong.tolist()
    reasons = judge(update).reasons
    assert "12 of 60 poses are further off than noise explains" in reasons[0]
    body, data, _ = tree_of(sensor)
    assert rezero_body(body, data, ["j3"]).fits


@pytest.mark.slow
def test_an_arm_does_not_fit_whose_new_zero_leaves_a_tenth_of_the_poses_off(model):
    data, wrong = spoilt(9)
    update = rezero(model, data, joints=("right_elbow",)).update
    assert not update.fits
    assert "9 of 90 poses are further off than noise explains" in update.misfit_words
    assert f"samples {wrong[0]}, {wrong[1]}" in update.misfit_words
    few, _ = spoilt(2)
    assert rezero(model, few, joints=("right_elbow",)).update.fits


@pytest.mark.slow
def test_another_robot_does_not_fit_after_its_torso_was_learned_anew():
    made = two_arms(2, poses=20, tags_each=3)
    noise = {sensor.name: 0.3 for sensor in made.tree.sensors}
    noise |= dict.fromkeys(made.tree.joints, float(np.radians(0.05)))
    X = made.tree.X_PJ.copy()
    X[1:, :3, 3] += np.random.default_rng(5).normal(0.0, 0.01, (len(X) - 1, 3))
    body = BodyModel("other", replace(made.tree, X_PJ=X), np.ones(len(X)), noise=noise)
    names = tuple(f"torso1.{part}" for part in FRAME_PARTS)
    torso = Hypothesis("the torso", names, np.zeros((0, 6)))
    nothing = np.zeros(0)
    blamed = Diagnosis(torso, 0.0, 6, 0.0, nothing, nothing, nothing)
    report = check_body_health(body, made.data)
    update = relearn_body(body, made.data, replace(report, changed_at=0, diagnoses=(blamed,)))
    assert update.against.count > 15
    assert not update.fits
