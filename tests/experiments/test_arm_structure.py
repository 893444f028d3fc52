"""The third stage of the mirror test, for links that the arm moves: looks, learning, judging."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.experiments.mirror_test import link_structure, structure
from nico_selfmodel.experiments.mirror_test.link_structure import judged_link, meant, with_card
from nico_selfmodel.experiments.mirror_test.structure_report import (
    structure_charts,
    structure_document,
    structure_table,
)
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids
from nico_selfmodel.geometry.surface_nets import surface_nets
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.geometry.voxel_grid import VoxelGrid
from nico_selfmodel.model.shape.link_shape import BodyShape, LinkShape
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.rendered_nico import FIDUCIAL, RenderedNico
from nico_selfmodel.sessions.shapes import own_arm
from nico_selfmodel.sessions.shapes.moving_shape import MovingShape
from nico_selfmodel.sessions.shapes.own_arm import (
    ArmStructure,
    learn_arm_structure,
    look_at_arm,
    spread,
)
from nico_selfmodel.systems.looking import touching_arm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.systems.simulated.imperfections import imperfections_named

BALL = Solid("ellipsoid", (0.03,) * 3, transform(np.eye(3), [0.0, 0.0, -0.05]))
GRID = VoxelGrid.about(BALL.X_FS[None, :3, 3], 0.04, 4e-3)
MESH = surface_nets(GRID, BALL.distance(GRID.points).reshape(GRID.shape))
AWAY = Solid("ellipsoid", (0.01,) * 3, transform(np.eye(3), [0.5, 0.0, 0.0]))


@pytest.fixture(autouse=True)
def _one_look_is_looked_into(monkeypatch):
    monkeypatch.setattr(link_structure, "_LOOKED", 1)


@cache
def robot():
    return Acquainted(2, imperfections_named("clean"), None, np.zeros((0, 6)))


def surface(*solids):
    return LinkSurface(None, solids, np.full((len(solids), 3), 0.5))


def arm(*, outward=0.0, learned=None, loose=0.0):
    """Return a forearm that is a ball before the cameras, learned in frames that differ by chance.

    Args:
        learned: Pose of the frame in which it is learned in the true one.
        loose: By how much that differs in each look [m].
    """
    rng, looks = np.random.default_rng(5), 12
    learned = np.eye(4) if learned is None else learned
    turned = rotation_from_vector(rng.uniform(-3.0, 3.0, (looks, 3)))
    X_LF = np.array([transform(R, [0.0, 0.0, 0.4]) for R in turned])
    shifts = rng.standard_normal((looks, 3))
    shifts = loose * (shifts - shifts.mean(axis=0))
    X_LG = X_LF @ np.array([transform(np.eye(3), p) for p in shifts]) @ learned
    mesh = MESH.moved(apply(inverse(learned), MESH.vertices + outward * MESH.normals))
    size = len(mesh.vertices)
    shape = LinkShape("right_forearm", mesh, np.full(size, 1e-3), np.full((size, 3), 0.5),
                      np.full(size, 20), np.ones(size, dtype=bool))  # fmt: skip
    body = BodyShape({"right_forearm": shape}, {"right_forearm": X_LG[0]})
    surfaces = tuple(
        {"right_forearm": (surface(BALL), X), "right_hand": (surface(AWAY), X)} for X in X_LF
    )
    errors = SimpleNamespace(expected=np.ones(looks, dtype=bool))
    return ArmStructure(MovingShape(body, errors, {"right_forearm": X_LG}), surfaces)


def judged(**how):
    return judged_link(2, "right_forearm", frozenset({"right_forearm"}), arm(**how), NICO_CAMERAS)


def test_readings_are_taken_that_are_far_from_each_other():
    grid = np.stack(np.meshgrid(np.arange(9.0), 1e3 * np.arange(9.0)), axis=-1).reshape(-1, 2)
    found = spread(np.concatenate([grid, grid]), 5)
    assert found.tolist()[0] == [4.0, 4e3]
    assert sorted(map(tuple, found[1:])) == [(0.0, 0.0), (0.0, 8e3), (8.0, 0.0), (8.0, 8e3)]
    assert len(spread(np.concatenate([grid, grid]), 100)) == len(grid)


def test_a_shape_is_judged_where_the_learned_arm_has_its_link_in_the_mean():
    turn = transform(rotation_from_vector([0.1, 0.4, -0.2]), [0.02, -0.01, 0.03])
    exact, elsewhere = (
        judged(learned=pose, loose=loose) for pose, loose in ((np.eye(4), 0.0), (turn, 2e-3))
    )
    rounded = BALL.distance(MESH.vertices)
    np.testing.assert_allclose(exact.off, rounded, atol=1e-12)
    np.testing.assert_allclose(elsewhere.off, rounded, atol=1e-9)
    np.testing.assert_allclose(elsewhere.mesh.vertices, exact.mesh.vertices, atol=1e-9)
    large = judged(outward=1e-3)
    np.testing.assert_allclose(large.off - rounded, 1e-3, atol=2e-5)
    assert np.abs(exact.mesh.vertices[:, 2] - 0.4).max() < 0.09


def test_what_no_camera_saw_and_what_cameras_saw_are_told_of_a_link_of_the_arm():
    ball = judged()
    assert (ball.robot, ball.link, ball.strange) == (2, "right_forearm", 0.0)
    assert ball.unseen < 0.02
    assert ball.covered == 1.0
    large = judged(outward=6e-3)
    assert large.covered == 0.0
    still = arm()
    poses = {"right_forearm": np.repeat(still.shape.poses["right_forearm"][:1], 12, axis=0)}
    shape = replace(still.shape, poses=poses)
    one_side = replace(still, surfaces=still.surfaces[:1] * 12, shape=shape)
    half = judged_link(2, "right_forearm", frozenset({"right_forearm"}), one_side, NICO_CAMERAS)
    assert 0.4 < half.unseen < 0.6


def test_frames_that_are_turned_by_chance_are_taken_in_the_mean():
    rng = np.random.default_rng(1)
    X = np.array([transform(rotation_from_vector(v), p) for v, p in rng.uniform(-1, 1, (6, 2, 3))])
    G = transform(rotation_from_vector([0.3, 0.0, 0.1]), [0.1, 0.2, 0.3])
    off = [transform(rotation_from_vector([0.0, 0.0, a]), [a, 0.0, 0.0]) for a in (0.2, -0.2) * 3]
    found = meant(np.array([inverse(one) for one in X]), X @ np.array(off) @ G)
    np.testing.assert_allclose(found[:3, :3], G[:3, :3], atol=1e-12)
    assert np.linalg.norm(found[:3, 3] - G[:3, 3]) < 0.02


def test_the_printed_card_counts_to_the_hand():
    tree = KinematicTree.from_urdf(rendered(robot()).arm.urdf)
    hand = {"right_hand": (surface(AWAY), np.eye(4))}
    above = np.array([[0.0, -0.0135, -0.015], [0.017, -0.0125, 0.002], [0.0, -0.0119, -0.015]])
    own, _ = with_card(tree, hand)["right_hand"]
    np.testing.assert_allclose(own.distance(above), [1e-3, 0.0, -6e-4], atol=1e-12)
    assert len(own.colors) == len(own.solids) == 2
    assert distance_to_solids(hand["right_hand"][0].solids, above)[0].min() > 0.4


def test_each_link_of_the_arm_has_its_rows_and_its_place_in_the_verdict():
    good, bad = (judged(outward=by) for by in (0.5e-3, 3e-3))
    stage = structure.StructureStage((good, replace(good, link="right_hand")), 14, (), {}, 38)
    assert [row[1] for row in structure_table(stage).rows] == ["right_forearm", "right_hand"] * 2
    assert "38 poses" in structure_table(stage).title
    assert list(structure_charts(stage)) == ["arm"]
    assert list(structure_charts(replace(stage, links=(replace(good, link="head"),)))) == [
        "structure"
    ]
    document = structure_document(replace(stage, links=(good, replace(bad, link="right_hand"))))
    assert document["status"] == "FAIL"
    assert any(one.startswith("right_hand is ") and "bound 2" in one for one in document["reasons"])
    assert not any(one.startswith("right_forearm is ") and "bound 2" in one
                   for one in document["reasons"])  # fmt: skip
    assert document["poses"] == 38


def test_a_robot_without_a_shape_of_its_arm_fails_and_keeps_head_and_chest(monkeypatch):
    head = judged()

    def nothing(*_):
        raise EstimationError("12 poses show the hand")

    learned = SimpleNamespace(body="body", all=SimpleNamespace(standpoints=(1, 2)))
    monkeypatch.setattr(structure, "learn_structure", lambda *_: (learned, {}))
    monkeypatch.setattr(structure, "judged", lambda *_: [replace(head, link="head")])
    monkeypatch.setattr(structure, "learn_arm_structure", nothing)
    monkeypatch.setattr(structure, "free_memory", lambda: None)
    found = structure.run_structure([SimpleNamespace(robot=robot())])
    assert [one.link for one in found.links] == ["head"]
    assert (dict(found.shapes), found.mirrors, found.poses) == ({2: "body"}, 2, 0)
    assert structure_document(found)["status"] == "FAIL"
    assert structure_document(found)["reasons"][0] == (
        "robot 2 learned no shape of its arm: 12 poses show the hand"
    )


def described(world):
    """Return a robot that knows arm and cameras as they are, and poses to look at its hand in."""
    nico = RenderedNico(world, 2, (FIDUCIAL,), None, touching_arm(FIDUCIAL))
    with nico.station(0) as station:
        plan = nico.plan(station, 0, 80, np.random.default_rng(0))
    model = nico.ground_truth.model(
        robot=nico.arm.source, fit={"joint_sigma_rad": 1e-3}, pixel_sigma=0.1
    )
    return Acquainted(2, world, model, np.array([command for _, command in plan]))


@pytest.mark.slow
def test_a_robot_looks_at_its_arm_twice_alike_and_is_the_one_it_was(tmp_path):
    own, seen = described(imperfections_named("thesis")), []
    for name in ("first", "second"):
        data, surfaces = look_at_arm(own, tmp_path / name, 8, lambda *_: None)
        pictures = sorted((tmp_path / name / "images").iterdir())
        seen.append([data.pixels.tobytes(), *(one.read_bytes() for one in pictures)])
        assert len(pictures) == 2 * len(surfaces) > 2
    assert seen[0] == seen[1]
    # Where the arm is is told by the model of the robot that the other stages have.
    with BodyImage(rendered(own).arm, own.model) as image:
        for sample, true in surfaces.items():
            expected = image.poses(data.encoders[data.sample == sample][0])
            off = expected["right_hand"][:3, 3] - true["right_hand"][1][:3, 3]
            assert np.linalg.norm(off) < 0.01  # by play; another robot's hand is centimetres off


@pytest.mark.parametrize("enough", [40, 80, 81])
def test_a_robot_looks_at_its_arm_in_more_poses_where_some_show_too_little(monkeypatch, enough):
    asked = []

    def looked(own, folder, poses, stage):
        asked.append(poses)
        return None, {3: "as it stood"}

    def learned(*_):
        if asked[-1] < enough:
            raise EstimationError("13 poses show the forearm")
        errors = SimpleNamespace(sample=np.array([3, 4]), expected=np.array([True, False]))
        return SimpleNamespace(errors=errors)

    monkeypatch.setattr(own_arm, "look_at_arm", looked)
    monkeypatch.setattr(own_arm, "shape_of_arm", learned)
    robot = SimpleNamespace(seed=1, model=None)
    if enough > 80:
        with pytest.raises(EstimationError, match="13 poses"):
            learn_arm_structure(robot, lambda *_: None)
    else:
        assert learn_arm_structure(robot, lambda *_: None).surfaces == ("as it stood",)
    assert asked == ([40] if enough == 40 else [40, 80])


@pytest.mark.slow
def test_a_robot_learns_the_shape_of_its_forearm_and_hand():
    own = described(imperfections_named("clean"))
    found = learn_arm_structure(own, lambda *_: None)
    forearm, hand = link_structure.judged_arm(own, found)
    for one, most in ((forearm, 0.3e-3), (hand, 0.6e-3)):
        assert len(one.off) > 100
        assert np.median(np.abs(one.off)) < most
        assert one.unseen < 0.02
    assert len(found.surfaces) == found.shape.looks > 15
