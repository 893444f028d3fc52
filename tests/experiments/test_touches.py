"""Stage 7 of the mirror test: what its report says, and how the true arm goes a way."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.estimation.mirrors.mark_place import ON_ME
from nico_selfmodel.experiments.mirror_test import report, touches
from nico_selfmodel.experiments.mirror_test.marks import MarkStage, MarkTrial
from nico_selfmodel.experiments.mirror_test.painting import MARK, Painted
from nico_selfmodel.experiments.mirror_test.report import report_of
from nico_selfmodel.experiments.mirror_test.stages import MirrorTest
from nico_selfmodel.experiments.mirror_test.touches import (
    Executed,
    TouchJudge,
    TouchStage,
    TouchTrial,
    places_near,
    run_touches,
)
from nico_selfmodel.experiments.mirror_test.touches_report import (
    ENOUGH_TOUCHES,
    touches_document,
    touches_table,
)
from nico_selfmodel.plant.touching.touch_planner import OutOfReach, Touch, TouchPlanner
from nico_selfmodel.sessions.looks.finding import Finding
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import FINGER, touching_arm
from nico_selfmodel.systems.rendering.mark_on_body import Mark

from ..knowing_nico import knowing

WAY = Touch(np.zeros((4, 6)), np.zeros((4, 6)), np.zeros((4, 3)), 0.006, 0.2)
WENT = Executed(0.002, 0.001, 0.004, "head and right_hand")
TOUCHED = TouchTrial(0.005, True, WAY, WENT)
BEYOND = TouchTrial(0.005, False, OutOfReach("the finger stays 90 mm away"), None)


def stage(inside=30, beyond=30, plans=50, first=TOUCHED, first_plan=TOUCHED):
    """Return a stage in which all goes well, but for the first mark and the first place drawn."""
    marks = (first, *[TOUCHED] * (inside - 1), *[BEYOND] * beyond)
    return TouchStage(marks, (first_plan, *[TOUCHED] * (plans - 1)), 900)


def test_marks_touched_and_nothing_else_pass():
    document = touches_document(stage())
    assert document["status"] == "PASS"
    assert "30 of 30 marks in reach" in document["reasons"][0]
    assert "30 of 30 others" in document["reasons"][0]


def test_few_marks_in_reach_or_few_ways_are_no_pass():
    assert touches_document(stage(inside=ENOUGH_TOUCHES))["status"] == "PASS"
    assert touches_document(stage(inside=ENOUGH_TOUCHES - 1))["status"] == "NOT_EVALUATED"
    assert touches_document(stage(plans=49))["status"] == "NOT_EVALUATED"


def test_a_tenth_may_be_missed_and_no_more():
    missed = replace(TOUCHED, executed=replace(WENT, off=0.0051))
    three = TouchStage((missed,) * 3 + (TOUCHED,) * 27, stage().plans, 0)
    assert touches_document(three)["status"] == "PASS"
    four = TouchStage((missed,) * 4 + (TOUCHED,) * 26, stage().plans, 0)
    assert touches_document(four)["status"] == "FAIL"
    assert "26 of 30 marks in reach" in touches_document(four)["reasons"][0]


HIT = replace(TOUCHED, executed=replace(WENT, clearance=-1e-4))


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"first": HIT}, "1 of 60 marks: something else touches the body, head and right_hand"),
        ({"first_plan": HIT}, "1 of 50 ways to places drawn: something else touches"),
        ({"first": replace(HIT, way_exists=False)}, "of 1 marks that are out of reach"),
    ],
)
def test_one_thing_that_touches_or_one_place_not_said_to_be_out_of_reach_fails(wrong, reason):
    document = touches_document(stage(**wrong))
    assert document["status"] == "FAIL"
    assert any(reason in one for one in document["reasons"])


def test_a_place_that_was_touched_was_in_reach():
    assert replace(TOUCHED, way_exists=False).in_reach
    assert not replace(BEYOND, way_exists=False).in_reach


def test_a_mark_in_reach_that_is_said_to_be_beyond_counts_as_missed():
    shy = replace(BEYOND, way_exists=True)
    document = touches_document(TouchStage((shy,) * 4 + (TOUCHED,) * 26, stage().plans, 0))
    assert document["status"] == "FAIL"


def test_the_table_counts_places_and_says_how_far_off_they_are():
    text = touches_table(stage()).markdown
    assert "| marks found | 60 | 30 | 30 | 0 | 30 | 0 | 2.0, 2.0, 2.0 | 4.0 |" in text
    nothing = touches_table(TouchStage((), (), 0)).markdown
    assert "| marks found | 0 | 0 | 0 | 0 | 0 | 0 | - | - |" in nothing
    again = replace(TOUCHED, executed=replace(WENT, tries=2))
    assert "| marks found | 60 | 30 | 30 | 1 | 30 |" in touches_table(stage(first=again)).markdown


@pytest.fixture(scope="module")
def robot():
    """A robot of six joints that knows itself exactly, and its judge."""
    arm = touching_arm("fiducial")
    nico = RenderedNico("thesis", 3, ("fiducial",), arm=arm)
    truth = nico.ground_truth
    judge = TouchJudge(nico)
    planner = TouchPlanner(arm, truth.model(), FINGER, held=truth.held, limits=judge.stops)
    return planner, judge


def ways(planner, rng, postures=400):
    """Yield places in reach, their normals, and ways to them."""
    for link, p_FM in places_near(planner, postures, rng):
        normal = planner.posed.surfaces[link].normals(p_FM[None])[0]
        plan = planner.at_place(link, p_FM, normal, rng)
        if isinstance(plan, Touch):
            yield Mark(link, p_FM, 0.01, np.ones(3)), normal, plan


@pytest.mark.slow
def test_the_true_arm_comes_to_the_place_but_for_its_joints_and_what_is_asked_for(robot):
    planner, judge = robot
    rng = np.random.default_rng(5)
    mark, normal, plan = next(ways(planner, rng))
    went = judge.go(plan, mark, normal, rng)
    assert went.off < 0.012
    assert abs(went.gap) < 0.012
    aside = np.linalg.svd(normal[None])[2][1]
    beside = Mark(mark.link, mark.p_FM + 0.05 * aside, 0.01, np.ones(3))
    assert judge.go(plan, beside, normal, rng).off == pytest.approx(0.05, abs=0.012)
    above = Mark(mark.link, mark.p_FM - 0.05 * normal, 0.01, np.ones(3))
    assert judge.go(plan, above, normal, rng).gap == pytest.approx(0.05, abs=0.012)


@pytest.mark.slow
def test_places_near_the_finger_lie_on_the_surface(robot):
    planner, _ = robot
    found = places_near(planner, 200, np.random.default_rng(6))
    assert {link for link, _ in found} <= {"head", "chest"}
    for link, p_FM in found:
        assert abs(planner.posed.surfaces[link].distance(p_FM[None])[0]) < 1e-3


@pytest.mark.slow
def test_ways_of_a_body_that_knows_itself_touch_within_5_mm_and_nothing_else(robot):
    planner, judge = robot
    rng = np.random.default_rng(7)
    went = [
        judge.go(plan, m, n, rng)
        for _, (m, n, plan) in zip(range(15), ways(planner, rng, 4000), strict=False)
    ]
    assert sum(one.off <= 0.005 for one in went) >= 13
    assert min(one.clearance for one in went) >= 0.0


def place_in_reach(nico):
    """Return a place that the arm, known exactly, has a way to, and its normal."""
    truth, judge = nico.ground_truth, TouchJudge(nico)
    planner = TouchPlanner(nico.arm, truth.model(), FINGER, held=truth.held, limits=judge.stops)
    mark, normal, _ = next(ways(planner, np.random.default_rng(8), 400))
    return mark, normal


@pytest.mark.slow
def test_a_robot_goes_to_marks_it_has_found_and_says_which_are_out_of_reach(monkeypatch):
    known = knowing(2)
    mark, normal = place_in_reach(known.before.nico)
    back = Mark("head", np.array([-0.0715, 0.0, 0.076]), 0.01, np.ones(3))
    on_arm = Mark("right_forearm", np.array([0.02, 0.0, 0.05]), 0.01, np.ones(3))
    trials = [
        MarkTrial(2, Painted(MARK, one, n), (Finding(ON_ME, one.link, one.p_FM, None, ()),), None)
        for one, n in ((mark, normal), (back, np.array([-1.0, 0.0, 0.0])), (on_arm, np.eye(3)[0]))
    ]
    missed = MarkTrial(2, Painted(MARK, mark, normal), (), None)
    monkeypatch.setattr(touches, "PLANS", 1)
    found = run_touches([known], {}, MarkStage((*trials, missed), None))
    first, second, third = found.marks
    assert first.way_exists
    assert first.executed.off < 0.012
    assert second.executed is None
    assert not second.in_reach
    assert third.executed is None
    assert not third.in_reach
    assert "carries right_forearm" in third.plan.reason
    assert len(found.plans) == 1


def test_the_stage_is_in_the_report_and_its_verdict_counts(monkeypatch):
    monkeypatch.setattr(report, "encounters_document", lambda _: PASSED)
    monkeypatch.setattr(report, "encounters_table", lambda _: touches_table(stage()))
    monkeypatch.setattr(report, "encounters_chart", lambda _: None)
    met = type("Met", (), {"responses": {0: None}, "trials": ()})()
    told = report_of(MirrorTest(met, touches=stage(first=HIT)))
    assert told.document["status"] == "FAIL"
    assert told.document["stages"][-1]["stage"] == "7"
    assert "stage 7: 1 of 60 marks" in "".join(told.document["reasons"])


PASSED = {"stage": "1", "status": "PASS", "reasons": ["all is well"]}
