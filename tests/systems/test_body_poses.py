"""Poses of a whole body in which its own cameras would see what is wanted."""

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.tree.body_tree import WORLD, Attached
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.visible_workspace import RENDERED
from nico_selfmodel.sessions.whole_body import room_about_nico
from nico_selfmodel.systems.looking import looking_body


def room():
    out = []
    for name, p in room_about_nico().items():
        X = np.eye(4)
        X[:3, 3] = p
        out.append(Attached(name, WORLD, X, oriented=False))
    return out


def test_hands_and_room_are_seen_at_once_where_both_are_wanted():
    view = BodyView(looking_body(), room())
    names = [marker.name for marker in view.tree.markers]
    hand, walls = ["right_hand_fiducial"], [marker.name for marker in view.room]
    q = view.poses(hand, 1, 20, np.random.default_rng(0), also=(walls, 6))
    assert q.shape == (20, 18)
    assert ((q >= view.body.lower) & (q <= view.body.upper)).all()
    seen = view.seen(q)
    assert seen.shape == (20, 2, len(names))
    assert seen[:, :, names.index(hand[0])].all()
    assert (seen[:, :, [names.index(name) for name in walls]].sum(axis=2) >= 6).all()


def test_what_nobody_commands_stays_where_it_is_held():
    view = BodyView(looking_body("neck_yaw"), room())
    assert view.poses(["card0_0"], 1, 3, np.random.default_rng(0)).shape == (3, 1)


def test_what_no_pose_shows_is_said(monkeypatch):
    monkeypatch.setattr("nico_selfmodel.planning.body_poses._ROUNDS", 2)
    behind = np.eye(4)
    behind[:3, 3] = [-3.0, 0.0, 0.5]
    view = BodyView(looking_body("neck_roll"), [Attached("behind", WORLD, behind)])
    with pytest.raises(
        ModelError, match=r"hardly sees behind: 0 of .* show every camera 1 of them"
    ):
        view.poses(["behind"], 1, 2, np.random.default_rng(0))


@pytest.mark.slow
def test_cards_that_pictures_shall_show_face_the_cameras_near_enough_and_nothing_hides_them():
    body = looking_body()
    view = BodyView(body, room(), RENDERED)
    card = "right_hand_fiducial"
    q = view.poses([card], 1, 10, np.random.default_rng(0))
    motion = TreeMotion.at(view.tree, q)
    R, p = motion.pose_of(view.tree.markers[view.tree.marker_index(card)])
    for sensor in view.tree.sensors:
        way = motion.pose_of(sensor)[1].T - p.T
        distance = np.linalg.norm(way, axis=1)
        assert ((distance > RENDERED.near) & (distance < RENDERED.far)).all()
        assert (np.sum(way * R[:, 2].T, axis=1) > 0.5 * distance).all()
    assert not any(view.shapes.collides(pose) for pose in q)
    bent = q.copy()
    bent[:, body.joints.index("right_wrist")] = body.upper[body.joints.index("right_wrist")]
    eye = motion.pose_of(view.tree.sensors[0])[1].T
    hidden = []
    for pose, at in zip(bent, eye, strict=True):
        there = TreeMotion.at(view.tree, pose[None]).pose_of(
            view.tree.markers[view.tree.marker_index(card)]
        )[1]
        hidden.append(view.shapes.hides(pose, card, there.T, at, 0.011))
    assert np.mean(hidden) > 0.5
