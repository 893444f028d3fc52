"""A head that follows a hand, by what a body knows of itself so far."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.planning.known_head import with_known_head
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.sessions.rendered_body import RenderedBody
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.looking import HEAD_JOINTS

from ..true_nico import true_body

HAND = "right_hand_fiducial"
WHOLE = WholeRecording(("right",))
SEED = 4


def pixels_of(tree, q, name):
    """Where each camera has a marker in its image. Shape (cameras, N, 2)."""
    motion = TreeMotion.at(tree, q)
    p_WM = motion.pose_of(tree.markers[tree.marker_index(name)])[1]
    out = []
    for sensor in tree.sensors:
        R, p = motion.pose_of(sensor)
        p_CM = np.einsum("jin,jn->ni", R, p_WM - p)
        out.append(tree.lenses[sensor.name].at(np.eye(4)).project(p_CM))
    return np.array(out)


def off_middle(tree, q):
    """How far the hand is from the middle of the images, in the cameras' mean [px]. Shape (N,)."""
    return np.linalg.norm(pixels_of(tree, q, HAND).mean(axis=0) - [319.5, 239.5], axis=1)


@pytest.fixture(scope="module")
def planned():
    return WHOLE.plan(0, 30, np.random.default_rng(0))


@pytest.mark.slow
def test_the_hand_is_near_the_middle_of_the_images_with_some_of_the_room_beside_it(planned):
    view = WHOLE.view
    posture = view.posture(planned)
    off = off_middle(view.tree, posture)
    assert off.max() < 200.0
    # Drawn heads have it as far off as the images allow.
    drawn = view.poses([HAND], 1, 30, np.random.default_rng(0), also=(list(WHOLE.room), 6))
    assert np.median(off) < 0.75 * np.median(off_middle(view.tree, view.posture(drawn)))
    assert off.min() < 60.0 < off.max()
    seen = view.seen(planned)
    names = [marker.name for marker in view.tree.markers]
    assert seen[:, :, names.index(HAND)].all()
    room = [names.index(name) for name in WHOLE.room]
    assert (seen[:, :, room].sum(axis=2) >= 6).all()
    assert all(view.free(q, [HAND]) for q in planned)


@pytest.mark.slow
def test_joints_that_gaze_leaves_over_stand_in_many_ways(planned):
    body = WHOLE.body
    share = (planned - body.lower) / (body.upper - body.lower)
    roll, tilt = (list(body.joints).index(name) for name in ("neck_roll", "eyes_tilt"))
    # 0.29 is that of a draw over the whole range.
    assert share[:, roll].std() > 0.2
    assert share[:, tilt].std() > 0.15


def test_a_learned_head_has_its_cameras_where_the_robots_are():
    robot = RenderedBody("thesis", SEED, WholeRecording())
    mechanics = robot.ground_truth.mechanics
    joints = mechanics.joints
    known = with_known_head(robot.whole.body, true_body("thesis", SEED), joints)
    described, rng = robot.whole.body, np.random.default_rng(1)
    q = rng.uniform(described.lower, described.upper, (10, len(described.joints)))
    commands = commands_of_angles(joints, described.lower, described.upper, q)
    true = TreeMotion.at(mechanics.tree, mechanics.servos.to_joint(commands))
    found, nominal = (TreeMotion.at(body.tree, q) for body in (known, described))
    for one, other in zip(known.tree.sensors, mechanics.tree.sensors, strict=True):
        np.testing.assert_allclose(found.pose_of(one)[1], true.pose_of(other)[1], atol=1e-9)
        np.testing.assert_allclose(found.pose_of(one)[0], true.pose_of(other)[0], atol=1e-9)
    for i, name in enumerate(described.tree.joints):
        if name not in HEAD_JOINTS:
            assert np.array_equal(found.p_WL[i], nominal.p_WL[i])


@pytest.mark.slow
def test_poses_planned_by_a_learned_head_have_the_hand_nearer_to_where_it_is_wanted():
    robot = RenderedBody("thesis", SEED, WHOLE)
    mechanics = robot.ground_truth.mechanics
    joints = mechanics.joints
    learned = true_body("thesis", SEED)
    off = {}
    for name, known in (("described", None), ("learned", learned)):
        body = WHOLE.known(known, joints)
        q = WHOLE.plan(0, 12, np.random.default_rng(3), body)
        commands = WHOLE.commands(joints, q)
        true = np.array([mechanics.posture(a) for a in mechanics.servos.to_joint(commands)])
        wanted = pixels_of(body.tree, WHOLE.view.posture(q), HAND)
        off[name] = np.nanmedian(
            np.linalg.norm(pixels_of(mechanics.tree, true, HAND) - wanted, axis=2)
        )
    assert off["learned"] < off["described"]


def test_a_body_that_did_not_learn_its_head_is_refused():
    learned = true_body("clean", 0)
    tree = learned.tree
    renamed = tuple("tail" if name == "neck_roll" else name for name in tree.joints)
    other = BodyModel("other", replace(tree, joints=renamed), learned.si_per_unit)
    joints = RenderedBody("clean", 0, WHOLE).ground_truth.mechanics.joints
    with pytest.raises(ModelError, match="body 'other' lacks neck_roll: learn it with"):
        WHOLE.known(other, joints)
    with pytest.raises(ValueError, match="does not command neck_yaw"):
        WHOLE.known(learned, joints[1:])
