"""The shape of links that an arm moves, from a recording of one's own."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError, EstimationError
from nico_selfmodel.estimation.noise.joints_by_hand import joints_by_hand
from nico_selfmodel.estimation.shape.shape_views import ShapeView, sampled
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror_rig import projected
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.shape.shape_folder import load_shape
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.looks.card import Card, card_of
from nico_selfmodel.sessions.shapes.moving_shape import (
    _ABOUT,
    _cropped,
    _Seen,
    _ToldApart,
    of_pose,
    room_color,
    shape_of_arm,
)
from nico_selfmodel.sessions.shapes.rigid_body import RigidBody, all_move, moving_with
from nico_selfmodel.systems.looking import touching_arm

from ..cli.one_line import assert_one_clear_line
from .test_own_pictures import empty, kept, nico, poses, true_model

HAND = {"right_lower_forearm", "right_hand", "right_index_finger", "right_three_fingers"}


def seeing():
    """Return the true model, which knows its noise, without a mirror."""
    fit = {"joint_sigma_rad": 1e-3}
    return replace(true_model(), mirrors={}, fit=fit, pixel_sigma=0.1)


def test_links_between_joints_that_move_are_one_body():
    tree = KinematicTree.from_urdf(nico().arm.urdf)
    four, six = nico().arm.joints, touching_arm("fiducial").joints
    assert moving_with(tree, four, "right_hand") > {*HAND, "right_forearm"}
    assert moving_with(tree, four, "right_forearm") == moving_with(tree, four, "right_hand")
    assert "right_elbow_yoke" not in moving_with(tree, four, "right_forearm")
    assert moving_with(tree, six, "right_forearm") == {"right_forearm"}
    assert "right_lower_forearm" not in moving_with(tree, six, "right_hand")


def test_a_body_has_lines_to_the_joints_beyond_it_and_the_links_that_are_asked_for():
    tree = KinematicTree.from_urdf(nico().arm.urdf)
    at = {name: np.eye(4) for name in tree.links}
    for k, name in enumerate(tree.links):
        at[name][2, 3] = 0.01 * k
    joints = touching_arm("fiducial").joints
    forearm, hand = RigidBody.of(tree, joints, ("right_forearm", "right_hand"), at)
    assert (forearm.frame, forearm.wanted) == ("right_forearm", ("right_forearm",))
    assert forearm.skeleton.links == ("right_forearm",)
    assert set(hand.skeleton.links) == {"right_hand"}
    (both,) = RigidBody.of(tree, nico().arm.joints, ("right_forearm", "right_hand"), at)
    assert both.wanted == ("right_forearm", "right_hand")
    assert {"right_forearm", "right_hand"} <= set(both.skeleton.links)


def test_links_that_move_and_links_that_stand_are_learned_one_after_the_other():
    assert all_move(seeing(), ["right_forearm", "right_hand"])
    assert not all_move(seeing(), ["head", "chest"])
    with pytest.raises(ValueError, match="right_hand moves with the arm and head stands still"):
        all_move(seeing(), ["head", "right_hand"])
    with pytest.raises(ValueError, match="left_wing"):
        all_move(seeing(), ["left_wing"])


def test_the_hand_tells_what_joints_were_off_by_and_how_well():
    model, off = replace(seeing(), pixel_sigma=0.01), np.array([0.0, 1e-3, -1e-3, 5e-4])
    data = poses(mirror="")
    q = model.servos.to_joint(data.encoders)
    data = replace(data, pixels=projected(model.rig.cameras, model.points(q + off))[0])
    told = joints_by_hand(model, data)
    before, after = (np.linalg.norm(model.points(q + one) - model.points(q + off), axis=1)
                     for one in (0.0, told.off))  # fmt: skip
    assert (after < 0.2 * before).all()
    sigma = np.sqrt(np.diagonal(told.covariance, axis1=1, axis2=2))
    assert (sigma < 1.0001e-3).all()
    assert sigma.min() < 0.8e-3
    assert told.expected.all()
    assert not joints_by_hand(model, replace(data, pixels=data.pixels + 30.0)).expected.any()


def test_a_pose_is_known_to_what_joints_leave_open_and_hardly_more():
    J = np.zeros((6, 2))
    J[0, 0], J[5, 1] = 1.0, 0.2
    sigma = np.sqrt(np.diag(of_pose(J, np.diag([4e-6, 0.0]))))
    np.testing.assert_allclose(sigma[:3], [np.hypot(2e-3, 5e-4), 5e-4, 5e-4])
    np.testing.assert_allclose(sigma[3:], 1e-4)


def test_a_recording_that_tells_no_moving_link_says_why(tmp_path, command):
    model, rng = seeing(), np.random.default_rng(0)
    folder = kept(tmp_path / "own", poses(mirror=""), empty())
    with pytest.raises(EstimationError, match="a shape takes 15: record more"):
        shape_of_arm(model, poses(mirror=""), folder, ["right_forearm"], rng)
    with pytest.raises(DataError, match="seen in no pose without a mirror"):
        shape_of_arm(model, poses(), folder, ["right_forearm"], rng)
    with pytest.raises(DataError, match="no pictures were kept"):
        shape_of_arm(model, poses(mirror=""), tmp_path, ["right_forearm"], rng)
    save_model(model, tmp_path / "model.yaml")
    words = ("calibrate", "shape", folder, "--model", tmp_path / "model.yaml", "--out")
    done = command(*words, tmp_path / "out", "--link", "right_forearm")
    assert_one_clear_line(done, "a shape takes 15")
    assert not (tmp_path / "out").exists()


def square(half=0.015, tilt=0.0):
    """Return the corners of a marker in the order in which they are located. Shape (4, 3)."""
    flat = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return np.array([0.01, 0.02, 0.03]) + flat @ rotation_from_vector([tilt, 0.0, 0.0]).T


def test_a_card_is_wider_than_its_marker_and_has_a_rim():
    # Eight cells of 3 mm, and one of white on each side.
    card = Card.of_corners(square(half=0.012, tilt=0.6))
    assert card.half == pytest.approx(0.015)
    np.testing.assert_allclose(card.X_FC[:3, 3], [0.01, 0.02, 0.03], atol=1e-12)
    at = np.array([0.0, 0.0105, 0.0115, 0.0185, 0.0195])
    beside = np.stack([at, np.zeros(5), np.zeros(5)], axis=1)
    asked = [beside, beside[:, [1, 0, 2]], beside - [0, 0, 9e-3], beside - [0, 0, 11e-3]]
    found = [card.at_rim(apply(card.X_FC, p)).tolist() for p in asked]
    rim = [False, False, True, True, False]
    assert found == [rim, rim, rim, [False] * 5]


def test_the_card_is_where_the_arm_has_the_corners_of_its_marker():
    model, readings = seeing(), poses(mirror="").encoders[1]
    q = model.servos.to_joint(readings)
    assert card_of(model, readings, np.eye(4)) is None
    names = ("fiducial", *(f"fiducial_{k}" for k in range(4)))
    table = replace(model.dh, markers=names, p_NH=np.vstack([model.dh.p_NH[:1], square(0.012)]))
    found = card_of(replace(model, table=table), readings, np.eye(4))
    four = np.array([replace(model, table=table).points(q, k) for k in range(1, 5)])
    np.testing.assert_allclose(found.X_FC[:3, 3], four.mean(axis=0), atol=1e-12)
    assert found.half == pytest.approx(0.015)


def test_of_a_picture_that_part_is_kept_in_which_a_body_may_be():
    whole = np.arange(480.0 * 640).reshape(480, 640)
    view = ShapeView(0, 1, np.repeat(whole[:, :, None], 3, axis=2), whole)
    at = np.array([[200.4, 100.2], [np.nan, np.nan], [260.9, 131.0]])
    part = _cropped(view, at)
    assert part.corner == (200 - _ABOUT, 100 - _ABOUT)
    assert part.beyond.shape == (31 + 2 * _ABOUT, 60 + 2 * _ABOUT)
    assert part.picture.shape == (*part.beyond.shape, 3)
    np.testing.assert_allclose(sampled(part.beyond, at[::2] - part.corner), sampled(whole, at[::2]))
    assert part.beyond.base is None  # the whole picture is not kept with it
    edge = _cropped(view, np.array([[0.0, 470.0], [5.0, 479.0]]))
    assert (edge.corner, edge.beyond.shape) == ((0, 470 - _ABOUT), (10 + _ABOUT, 5 + _ABOUT))


def test_a_look_whose_pictures_show_the_room_alone_tells_of_no_body_and_does_not_count():
    room = np.full((60, 80, 3), 100, np.uint8)
    arm = room.copy()
    arm[20:50, 20:50] = 30
    shown, hidden = (
        _ToldApart(SimpleNamespace(pictures=(arm, other)), (1.0, 1.0), None)
        for other in (arm, room)
    )
    assert (shown.beyond[0] < 0.0).sum() == pytest.approx(900, abs=60)
    assert hidden.beyond is None
    number = {1: "right_hand"}
    labels = np.full((60, 80), 1)
    hidden.look.labels = labels, labels
    rigid = SimpleNamespace(links={"right_hand"})
    body = _Seen(rigid, None, None)
    body.take(hidden, SimpleNamespace(links=number))
    assert body.standpoints == body.views == []


@pytest.mark.parametrize(("rows", "plain"), [(31, True), (29, False)])
def test_a_plain_room_covers_three_tenths_of_a_picture(rows, plain):
    picture = np.random.default_rng(0).integers(0, 255, (100, 100, 3)).astype(np.uint8)
    picture[:rows] = [92, 102, 110]
    if plain:
        np.testing.assert_allclose(room_color(picture), [92.0, 102.0, 110.0], atol=0.5)
    else:
        with pytest.raises(EstimationError, match=r"29 % of a picture .* must be plain"):
            room_color(picture)


@pytest.mark.slow
def test_a_forearm_has_its_shape_by_the_commands_of_the_guide(tmp_path, command):
    model, looks, out = tmp_path / "model.yaml", tmp_path / "looks", tmp_path / "shaped"
    save_model(seeing(), model)
    recorded = command(
        *("record", "--cameras", model, "--seed", 2, "--imperfections", "clean", "--circle", 0),
        *("--random", 24, "--images", "--out", looks),
    )
    assert recorded.returncode == 0, recorded.stderr
    words = ("calibrate", "shape", looks, "--model", model, "--link", "right_forearm")
    done = command(*words, "--test-fraction", 0.1, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "shape of right_forearm, in " in done.stdout
    assert json.loads((out / "result.json").read_text())["shape"]["poses"] > 15
    forearm = load_shape(out / "body").links["right_forearm"]
    assert forearm.seen.sum() > 200
    with nico().station(0) as station:
        true = station.surfaces_true(station.CreateDefaultContext())
    arm = {name: one for name, one in true.items() if name in {*HAND, "right_forearm"}}
    X_FL = np.linalg.inv(true["right_forearm"][1])
    p_LQ = forearm.mesh.vertices[forearm.seen] @ np.linalg.inv(X_FL)[:3, :3].T
    p_LQ = p_LQ + np.linalg.inv(X_FL)[:3, 3]
    off = np.min(
        [surface.distance((p_LQ - X[:3, 3]) @ X[:3, :3]) for surface, X in arm.values()],
        axis=0,
    )
    assert np.median(np.abs(off)) < 2e-3
