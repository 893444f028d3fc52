"""Poses that contradict a body here and there: how many are no accident, and what is said."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest

from nico_selfmodel.estimation.model_verdict import judge_evaluation
from nico_selfmodel.estimation.monitoring.health import check_health
from nico_selfmodel.estimation.monitoring.health_document import health_document
from nico_selfmodel.estimation.noise.contradictions import most_expected
from nico_selfmodel.estimation.observations.pixel_evaluation import evaluate_pixels

from .simulated_bodies import body, learned, only_cameras, poses


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
