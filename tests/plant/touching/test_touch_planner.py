"""An arm finds ways of its finger to places of its own body, or says why there is none."""

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.touching import touch_planner
from nico_selfmodel.plant.touching.posed_arm import PosedArm
from nico_selfmodel.plant.touching.touch_planner import (
    APPROACH,
    CLEAR,
    LEAN,
    NARROW,
    WIDE,
    OutOfReach,
    Touch,
    TouchPlanner,
)
from nico_selfmodel.systems.looking import FINGER, MARKER_FRAMES, looking
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance

FRONT = np.array([0.077, 0.003, 0.021]), np.array([0.89, 0.0, -0.45])
"""A place of the head under its face, and the normal there."""
BACK = np.array([-0.071, 0.0, 0.076]), np.array([-1.0, 0.0, 0.0])
"""The back of the head."""


def arm_of_six():
    """Nico's right arm with all of its joints."""
    free = ("right_forearm_twist", "right_wrist")
    held = {name: angle for name, angle in looking().items() if name not in free}
    points = {"fiducial": MARKER_FRAMES["fiducial"]}
    return ArmDescription.from_urdf("nico", "chest", "right_hand", held, points)


@pytest.fixture(scope="module")
def nico():
    """A robot that knows itself exactly, and its joints that nobody commands."""
    arm = arm_of_six()
    instance = NicoInstance.build(arm, IMPERFECTIONS["thesis"], 1, NICO_CAMERAS)
    return arm, instance.ground_truth.model(), instance.held


@pytest.fixture(scope="module")
def planner(nico):
    arm, model, held = nico
    return TouchPlanner(arm, model, FINGER, held=held)


def planned(planner, place=FRONT, link="head"):
    return planner.at_place(link, *place, np.random.default_rng(3))


def on_the_head(planner, place):
    """Return a place and its normal in the world, as the robot stands."""
    X_WF = planner.posed.link_pose("head")
    p, n = place
    return X_WF[:3, :3] @ p + X_WF[:3, 3], X_WF[:3, :3] @ n / np.linalg.norm(n)


def test_the_finger_ends_at_the_place_by_the_models_own_prediction(nico, planner):
    touch = planned(planner)
    p_WM, n_W = on_the_head(planner, FRONT)
    arm, model, held = nico
    posed = PosedArm(arm, model, FINGER, held)
    posed.read(touch.readings[-1])
    p_WE, way = posed.finger_end()
    assert np.linalg.norm(p_WE - posed.finger.radius * n_W - p_WM) < 1e-4
    assert np.arccos(way @ -n_W) == pytest.approx(touch.lean, abs=1e-6)
    assert touch.lean <= LEAN + 1e-3


def test_the_way_comes_from_30_mm_along_the_normal(planner):
    touch = planned(planner)
    p_WM, n_W = on_the_head(planner, FRONT)
    away = touch.p_WT - p_WM
    np.testing.assert_allclose(away, (away @ n_W)[:, None] * n_W, atol=1e-4)
    assert away[0] @ n_W == pytest.approx(0.030, abs=1e-4)
    assert pytest.approx(0.030) == APPROACH
    assert (np.diff(away @ n_W) < 0.0).all()


def test_nothing_but_the_finger_comes_near_on_the_way(nico, planner):
    arm, model, held = nico
    posed, touch = PosedArm(arm, model, FINGER, held), planned(planner)
    for readings in touch.readings:
        posed.read(readings)
        assert posed.clearance()[0] >= CLEAR - 1e-3
    assert touch.clearance >= CLEAR


@pytest.mark.parametrize("away", [-1e-5, 1e-5])
def test_a_way_that_comes_too_near_to_what_is_drawn_is_none(planner, monkeypatch, away):
    near = CLEAR + away, "chest and right_hand"
    monkeypatch.setattr(planner._as_drawn, "clearance_on", lambda readings: near)
    found = planned(planner)
    assert isinstance(found, Touch) == (away > 0.0)
    if isinstance(found, OutOfReach):
        assert found.reason == "chest and right_hand come 5.0 mm near on the way"
    else:
        assert found.clearance == near[0]


def test_a_body_as_it_is_drawn_is_nearer_than_its_collision_shapes(nico):
    arm, model, held = nico
    posed = PosedArm(arm, model, FINGER, held)
    drawn, below = posed.as_drawn(), []
    for q in np.random.default_rng(0).uniform(arm.lower, arm.upper, (60, len(arm.joints))):
        for one in (posed, drawn):
            one.pose(q)
        assert drawn.clearance()[0] <= posed.clearance()[0]
        np.testing.assert_array_equal(drawn.finger_end(), posed.finger_end())
        if posed.clearance()[0] < 0.09:
            below.append(posed.clearance()[0] - drawn.clearance()[0])
    assert 1e-3 < np.median(below) < 0.03


@pytest.mark.slow
def test_the_joints_stay_within_their_limits_and_the_stops_that_are_told(nico, planner):
    arm, model, held = nico
    touch = planned(planner)
    assert (touch.q >= arm.lower - 1e-9).all()
    assert (touch.q <= arm.upper + 1e-9).all()
    stops = np.sort(np.stack([touch.readings[-1] + 1.0, touch.readings[-1] + 40.0]), axis=0)
    narrow = TouchPlanner(arm, model, FINGER, held=held, limits=stops)
    assert isinstance(planned(narrow), OutOfReach)


def test_stops_that_are_told_count_where_the_description_has_narrower_limits(nico):
    """Angles of a learned joint are about its own zero, and the description's about another."""
    arm, model, held = nico
    wider = np.stack([arm.lower - 0.15, arm.upper + 0.15])
    stops = np.sort(model.servos.to_encoder(wider), axis=0)
    planner = TouchPlanner(arm, model, FINGER, held=held, limits=stops)
    np.testing.assert_allclose(planner.reach, wider, atol=1e-9)
    without = TouchPlanner(arm, model, FINGER, held=held)
    np.testing.assert_array_equal(without.reach, [arm.lower, arm.upper])


def test_the_back_of_the_head_is_out_of_reach_and_the_reason_is_said(planner):
    found = planned(planner, BACK)
    assert isinstance(found, OutOfReach)
    assert "leaning" in found.reason


@pytest.mark.slow
def test_of_two_places_beyond_the_arm_the_farther_one_is_said_to_be_farther(planner):
    away = []
    for y in (0.5, 0.6):
        found = planned(planner, (np.array([0.0, y, 0.0]), np.array([0.0, -1.0, 0.0])))
        away.append(float(found.reason.removeprefix("the finger stays ").removesuffix(" mm away")))
    assert 80.0 < away[1] - away[0] <= 101.0


def test_a_place_that_the_finger_would_have_to_reach_through_the_head_is_out_of_reach(planner):
    p, n = FRONT
    found = planned(planner, (p - 0.02 * n, -n))
    assert isinstance(found, OutOfReach)


@pytest.mark.slow
def test_a_larger_distance_from_the_body_leaves_a_place_out_of_reach(nico, planner):
    assert isinstance(planned(planner), Touch)
    arm, model, held = nico
    found = planned(TouchPlanner(arm, model, FINGER, held=held, clear=[0.08]))
    assert isinstance(found, OutOfReach)
    assert "80 mm away from the rest" in found.reason


@pytest.mark.slow
def test_where_there_is_no_way_at_a_distance_the_next_one_counts(nico, planner):
    arm, model, held = nico
    known = planned(TouchPlanner(arm, model, FINGER, held=held, clear=[CLEAR]))
    found = planned(TouchPlanner(arm, model, FINGER, held=held, clear=[0.08, CLEAR]))
    np.testing.assert_array_equal(found.readings, known.readings)
    usual, wide = (
        planned(planner),
        planned(TouchPlanner(arm, model, FINGER, held=held, clear=[WIDE])),
    )
    np.testing.assert_array_equal(usual.readings, wide.readings)
    assert usual.clearance > WIDE - 1e-4
    near = planned(TouchPlanner(arm, model, FINGER, held=held, clear=[CLEAR, NARROW]))
    np.testing.assert_array_equal(near.readings, known.readings)


@pytest.mark.slow
def test_no_nearer_way_is_tried_where_the_finger_does_not_come_to_the_place(planner, monkeypatch):
    asked = []

    def tried(self, place, starts, clear):
        asked.append(clear)
        return touch_planner._Lacking(len(asked), 0.5, "a way")

    monkeypatch.setattr(TouchPlanner, "_tried", tried)
    monkeypatch.setattr(planner, "_clear", (0.3, 0.2, 0.1))
    assert planned(planner) == OutOfReach("a way")
    assert asked == [0.3]


@pytest.mark.slow
def test_a_finger_that_must_not_lean_leaves_a_place_out_of_reach(planner, monkeypatch):
    place = np.array([0.067, 0.057, 0.054]), np.array([0.0, 0.96, -0.27])
    assert isinstance(planned(planner, place), Touch)
    monkeypatch.setattr(touch_planner, "LEAN", np.radians(5.0))
    assert isinstance(planned(planner, place), OutOfReach)


@pytest.mark.slow
def test_one_seed_is_one_way_and_nothing_of_it_can_be_written(planner):
    first, again = planned(planner), planned(planner)
    np.testing.assert_array_equal(first.readings, again.readings)
    with pytest.raises(FrozenInstanceError):
        first.lean = 0.0
    with pytest.raises(ValueError, match="read-only"):
        first.q[0, 0] = 0.0


@pytest.mark.slow
def test_a_known_posture_is_where_the_way_is_looked_for_first(planner, monkeypatch):
    known = planned(planner)
    starts = []
    tried = TouchPlanner._from

    def from_(self, start, place, clear):
        starts.append(start)
        return tried(self, start, place, clear)

    monkeypatch.setattr(TouchPlanner, "_from", from_)
    again = planner.at_place("head", *FRONT, np.random.default_rng(9), near=known.readings[-1])
    np.testing.assert_allclose(starts[0], known.q[-1], atol=1e-6)
    np.testing.assert_allclose(again.p_WT[-1], known.p_WT[-1], atol=2e-4)
    with pytest.raises(ValueError, match="near must have shape"):
        planner.at_place("head", *FRONT, np.random.default_rng(9), near=[0.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "tried"), [(0, 8), (1, 32)])
def test_only_where_no_start_came_to_the_place_are_few_enough(planner, monkeypatch, asked, tried):
    """What a solver leaves of a way that it does not find may be anywhere, and tells nothing."""
    starts = []

    def from_(self, start, place, clear):
        starts.append(start)
        return touch_planner._Lacking(asked, 0.5, "a way")

    monkeypatch.setattr(TouchPlanner, "_from", from_)
    assert planned(planner) == OutOfReach("a way")
    assert len(starts) == tried


def test_starts_bring_the_finger_near_to_the_place_and_hardly_lean_too_far(planner, monkeypatch):
    starts = []

    def from_(self, start, place, clear):
        starts.append(start)
        return touch_planner._Lacking(1, 0.0, "a way")

    monkeypatch.setattr(TouchPlanner, "_from", from_)
    planned(planner)
    p_WM, n_W = on_the_head(planner, FRONT)
    away, lean = [], []
    for q in starts[1:]:
        planner.posed.pose(q)
        p_WE, pointing = planner.posed.finger_end()
        away.append(np.linalg.norm(p_WE - p_WM))
        lean.append(np.arccos(pointing @ -n_W))
    assert max(away) < 0.2
    assert max(lean) < LEAN + 1.5
    assert np.median(lean) < LEAN


@pytest.mark.slow
def test_places_move_with_a_body_that_stands_elsewhere(nico, planner):
    arm, model, held = nico
    X_WB = np.eye(4)
    X_WB[:3, 3] = [0.002, -0.003, 0.001]
    moved = planned(TouchPlanner(arm, model, FINGER, held=held, X_WB=X_WB))
    np.testing.assert_allclose(
        moved.p_WT - planned(planner).p_WT, np.tile(X_WB[:3, 3], (4, 1)), atol=3e-4
    )


@pytest.mark.parametrize(
    ("link", "place", "error", "said"),
    [
        ("right_hand", FRONT, ModelError, "moves with the arm"),
        ("nose", FRONT, ModelError, "no link 'nose'"),
        ("head", (FRONT[0], np.zeros(3)), ValueError, "must have a length"),
        ("head", (FRONT[0] * np.nan, FRONT[1]), ValueError, "p_FM must be finite"),
        ("head", (FRONT[0][:2], FRONT[1]), ValueError, "p_FM must have shape"),
    ],
)
def test_what_cannot_be_asked_for_is_refused(planner, link, place, error, said):
    with pytest.raises(error, match=said):
        planned(planner, place, link)


@pytest.mark.parametrize(
    ("finger", "said"),
    [("head", "no link that the arm moves"), ("right_three_fingers", "must be one capsule")],
)
def test_a_finger_that_is_none_is_refused(nico, finger, said):
    arm, model, _ = nico
    with pytest.raises(ModelError, match=said):
        TouchPlanner(arm, model, finger)
