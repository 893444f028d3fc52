"""What was seen of the body is kept off where it was learned to be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.solids.solid import distance_to_solids
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.plant.touching.learned_body import seen_balls
from nico_selfmodel.plant.touching.posed_arm import PosedArm
from nico_selfmodel.plant.touching.touch_planner import OutOfReach, Touch, TouchPlanner
from nico_selfmodel.systems.looking import FINGER, touching_arm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance
from tests.learned_ball import ball_shape

FRONT = np.array([0.077, 0.003, 0.021]), np.array([0.89, 0.0, -0.45])
"""A place of the head under its face, and the normal there."""
BALL = ball_shape("head", 0.06)
"""Seen where x > 0."""


@pytest.fixture(scope="module")
def nico():
    """A robot that knows itself exactly, and its joints that nobody commands."""
    arm = touching_arm("fiducial")
    instance = NicoInstance.build(arm, IMPERFECTIONS["thesis"], 1, NICO_CAMERAS)
    return arm, instance.ground_truth.model(), instance.held


def body(own):
    """Return a shape of one link."""
    return BodyShape({own.link: own}, {own.link: np.eye(4)})


def planner(nico, shape=None, X_WB=None):
    arm, model, held = nico
    return TouchPlanner(arm, model, FINGER, held=held, shape=shape, X_WB=X_WB)


def planned(one, place=FRONT):
    return one.at_place("head", *place, np.random.default_rng(3))


def test_balls_touch_what_was_seen_from_within_and_nothing_stands_for_the_rest():
    balls = seen_balls(BALL)
    off = distance_to_solids(balls, BALL.mesh.vertices[BALL.seen])[0]
    assert np.abs(off).max() < 2.1e-3
    behind = BALL.mesh.vertices[:, 0] < -0.03
    assert distance_to_solids(balls, BALL.mesh.vertices[behind])[0].min() > 0.005
    nothing = replace(BALL, seen=np.zeros_like(BALL.seen))
    assert seen_balls(nothing) == ()


@pytest.mark.slow
def test_an_arm_keeps_off_what_it_has_learned_that_the_description_lacks(nico):
    arm, model, held = nico
    touch = planned(planner(nico))
    assert isinstance(touch, Touch)
    posed = PosedArm(arm, model, FINGER, held)
    posed.read(touch.readings[-1])
    p_FH = apply(inverse(posed.link_pose("head")), posed.link_pose("right_hand")[None, :3, 3])[0]
    bump = body(ball_shape("head", 0.02, p_FH - [0.01, 0.0, 0.0]))
    hit = PosedArm(arm, model, FINGER, held, bump)
    hit.read(touch.readings[-1])
    clearance, links = hit.clearance()
    assert clearance < 0.0
    assert links == "head and right_hand"
    again = planned(planner(nico, bump))
    assert isinstance(again, OutOfReach) or not np.allclose(again.readings, touch.readings)


def test_what_was_seen_stands_where_the_body_does(nico):
    arm, model, held = nico
    X_WB = np.eye(4)
    X_WB[:3, 3] = [0.0, 0.0, 5.0]
    here, gone = (PosedArm(arm, model, FINGER, held, body(BALL), X) for X in (None, X_WB))
    inside = PosedArm(arm, model, FINGER, held)
    p_WH = here.link_pose("head")[:3, 3]
    q = min(
        np.random.default_rng(0).uniform(arm.lower, arm.upper, (100, len(arm.joints))),
        key=lambda q: (here.pose(q), np.linalg.norm(here.link_pose("right_hand")[:3, 3] - p_WH))[1],
    )
    for posed in (here, gone, inside):
        posed.pose(q)
    assert gone.clearance() == inside.clearance()
    assert here.clearance()[0] <= inside.clearance()[0]


class Undecided:
    """A query to which FCL tells no distances, as of some shapes that lie one inside the other."""

    def __init__(self, query):
        self.query = query

    def __getattr__(self, name):
        return getattr(self.query, name)

    def ComputeSignedDistancePairwiseClosestPoints(self, _):
        raise RuntimeError("The origin is outside of the polytope")


def test_a_distance_that_cannot_be_told_is_how_deep_shapes_lie_in_each_other(nico, monkeypatch):
    arm, model, held = nico
    posed = PosedArm(arm, model, FINGER, held, body(ball_shape("head", 0.3, np.zeros(3))))
    posed.pose(0.5 * (arm.lower + arm.upper))
    told = posed.clearance()
    assert told[0] < 0.0
    port = posed._scene.get_query_output_port()
    scene = SimpleNamespace(
        get_query_output_port=lambda: SimpleNamespace(Eval=lambda at: Undecided(port.Eval(at))),
        GetMyContextFromRoot=posed._scene.GetMyContextFromRoot,
    )
    monkeypatch.setattr(posed, "_scene", scene)
    assert posed.clearance() == (pytest.approx(told[0], abs=1e-4), told[1])


def test_a_shape_of_another_robot_is_refused_in_one_line(nico):
    with pytest.raises(ModelError, match="the learned shape is of tail, the robot has the links"):
        planner(nico, body(ball_shape("tail")))
