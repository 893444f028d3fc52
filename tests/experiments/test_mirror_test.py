"""The mirror test: what its report says of trials, and one short run of the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.contingency.contingency import (
    CANNOT_TELL,
    NOBODY,
    NOT_ME,
    ODDS,
    SELF,
    Contingency,
)
from nico_selfmodel.estimation.contingency.motion_response import MotionResponse
from nico_selfmodel.experiments.mirror_test.encounters import EXPECTED, EncounterStage, Trial
from nico_selfmodel.experiments.mirror_test.report import report_of
from nico_selfmodel.experiments.mirror_test.unmarked import LIGHTS, Look, UnmarkedStage
from nico_selfmodel.experiments.mirror_test.unmarked_report import unmarked_document
from nico_selfmodel.sessions.mirror_looks import MirrorLook
from nico_selfmodel.vision.surprise.surprise import Expectation, Surprise

RESPONSE = MotionResponse(0.05, 1, np.array([[0.01, 0.5], [0.5, 0.99]]), 0.01, 0.1, 0.8, 30.0)


def said(verdict, seconds=1.0):
    """Return a verdict that fell after some time."""
    top = 0.0 if verdict == CANNOT_TELL else np.log(ODDS) * (1.0 if verdict == SELF else -1.0)
    return Contingency(verdict, seconds, True, np.linspace(0.0, 1.001 * top, round(seconds / 0.05)))


def stage(count, **exceptions):
    """Return a stage in which all is told rightly, but for some encounters."""
    names = [name for name in EXPECTED for _ in range(count)]
    trials = [Trial(0, name, said(EXPECTED[name])) for name in names]
    for name, found in exceptions.items():
        at = names.index(name.replace("_", " "))
        trials[at] = Trial(0, names[at], found)
    return EncounterStage(tuple(trials), {0: RESPONSE}, {0: 0.07})


def test_a_hundred_right_verdicts_in_time_pass():
    document = report_of(stage(15)).document
    assert document["status"] == "PASS"
    assert [one["stage"] for one in document["stages"]] == ["1"]


def test_few_trials_are_no_pass():
    assert report_of(stage(2)).document["status"] == "NOT_EVALUATED"


@pytest.mark.parametrize(
    ("exceptions", "reason"),
    [
        ({"mirror": said(NOT_ME)}, "mirror: 1 of 15 verdicts are wrong"),
        ({"other_robot": said(SELF)}, "other robot: 1 of 15 verdicts are wrong"),
        ({"other_robot": said(NOBODY)}, "other robot: 1 of 15 verdicts are wrong"),
        ({"mirror": said(SELF, 6.0)}, "6.0 s, at most 5 s"),
        ({"mirror": said(CANNOT_TELL, 10.0)}, "1 of 15 could not be told"),
    ],
)
def test_one_wrong_late_or_missing_verdict_fails_and_is_named(exceptions, reason):
    document = report_of(stage(15, **exceptions)).document
    assert document["status"] == "FAIL"
    assert reason in document["reasons"][0]


def test_not_me_is_no_mistake_where_nobody_is():
    assert report_of(stage(15, nobody=said(NOT_ME))).document["status"] == "PASS"


def test_tables_chart_and_json_are_written(tmp_path):
    report_of(stage(2)).write(tmp_path / "out")
    found = {path.name for path in (tmp_path / "out").iterdir()}
    assert found == {"tables.md", "contingency.png", "result.json"}
    text = (tmp_path / "out" / "tables.md").read_text("utf-8")
    assert "| own motion 0.1 s late | not me | 2 |" in text
    assert "No other stage is part of this test" in text
    document = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert len(document["stages"][0]["encounters"]) == 7


def looks(count, surprised):
    """Return looks at an unmarked body, some of which surprise."""
    nothing = np.zeros((4, 4))
    picture = np.zeros((4, 4, 3), np.uint8)
    one = MirrorLook(
        "left", picture, Expectation(picture, nothing, 2.0, 0.0), Surprise(nothing, 1.0), ()
    )
    found = [
        Look(0, LIGHTS[k % 3], (0.9, 0.9), (100, 100), (3.0, 3.0), int(k < surprised))
        for k in range(count)
    ]
    return UnmarkedStage(tuple(found), (one, replace(one, side="right")))


@pytest.mark.parametrize(
    ("count", "surprised", "status"),
    [
        (100, 0, "PASS"),
        (100, 1, "PASS"),
        (100, 2, "FAIL"),
        (99, 0, "NOT_EVALUATED"),
        (9, 1, "FAIL"),
    ],
)
def test_an_unmarked_body_may_surprise_once_in_a_hundred_looks(count, surprised, status):
    document = unmarked_document(looks(count, surprised))
    assert document["status"] == status
    assert f"{surprised} of {count} looks" in document["reasons"][0]
    assert "the arm that moves" in document["not_judged"]


def test_both_stages_are_in_one_report_and_the_worse_status_counts():
    report = report_of(stage(15), looks(30, 0))
    assert [one["status"] for one in report.document["stages"]] == ["PASS", "NOT_EVALUATED"]
    assert report.document["status"] == "NOT_EVALUATED"
    assert set(report.charts) == {"contingency", "surprise"}
    assert "| 0.9 | 10 | 0 | 0.900 | 100 | 1.00 |" in "".join(t.markdown for t in report.tables)


def test_too_few_trials_are_refused_in_one_line(tmp_path, command):
    done = command("experiment", "mirror-test", "--trials", 3, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "--trials must be at least 7" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_one_robot_tells_itself_from_others_and_looks_as_it_expects(tmp_path, command):
    out = tmp_path / "out"
    done = command("experiment", "mirror-test", "--trials", 7, "--seed", 4, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads((out / "result.json").read_text("utf-8"))
    assert document["status"] == "NOT_EVALUATED"
    assert [one["stage"] for one in document["stages"]] == ["1", "4"]
    assert all(row["wrong"] == 0 for row in document["stages"][0]["encounters"])
