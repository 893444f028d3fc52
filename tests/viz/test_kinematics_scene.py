import re

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.viz.scene.arm_scene import calibration_scene, shown_pose
from nico_selfmodel.viz.scene.arm_shape import arm_length, joint_points
from nico_selfmodel.viz.scene.robot.robot_items import robot_items, robot_legend
from nico_selfmodel.viz.scene.scene import FIELD_OF_VIEW
from nico_selfmodel.viz.scene.scene_items import Markers

from .conftest import JOINTS, OUTLIERS, true_arm


@pytest.fixture(scope="module")
def scene(calibration):
    return calibration_scene(calibration)


def at(scene, path):
    (item,) = [item for item in scene.items if item.path == path]
    return item


def rows_of(points):
    return sorted(map(tuple, np.asarray(points).tolist()))


def factor_of(path):
    return float(re.search(r"_x([\d.e+]+)$", path).group(1))


def magnified(scene, folder):
    (item,) = [i for i in scene.under(folder) if re.search(r"/residuals_x", i.path)]
    return item


def distance_to_wire(points, corners):
    return np.linalg.norm(points[:, None] - corners, axis=2).min(axis=1)


def test_every_training_point_is_drawn_exactly_once(scene, calibration):
    drawn = [i for i in scene.under("circles") + scene.under("training") if isinstance(i, Markers)]
    drawn += [at(scene, "outliers/points")]
    points = np.concatenate([item.centers for item in drawn])
    assert rows_of(points) == rows_of(calibration.train.observations.p_WH)


def test_every_circle_sample_is_drawn_in_the_colour_of_its_joint(scene, calibration, training):
    colors = set()
    for joint in JOINTS:
        samples = at(scene, f"circles/{joint}/samples")
        inliers = ~calibration.outliers & (training.sweep == joint)
        # The middle of a sweep is another measurement of the home pose, but of this sweep alone.
        assert rows_of(samples.centers) == rows_of(training.p_WH_measured[inliers])
        (circle,) = [i for i in scene.under(f"circles/{joint}") if i is not samples]
        assert circle.color[:3] == samples.color[:3]
        assert at(scene, f"arm/joint_{joint}").color[:3] == samples.color[:3]
        colors.add(samples.color)
    assert len(colors) == len(JOINTS)
    home = training.p_WH_measured[training.sweep == "home"]
    assert rows_of(at(scene, "circles/shared_samples").centers) == rows_of(home)


def test_every_circle_passes_through_its_samples(scene):
    for joint in JOINTS:
        samples = at(scene, f"circles/{joint}/samples").centers
        (circle,) = [i for i in scene.under(f"circles/{joint}") if "circle_" in i.path]
        spacing = np.linalg.norm(circle.points[1] - circle.points[0])
        off = distance_to_wire(samples, circle.points)
        assert off.max() < 0.5 * spacing + 2e-3, joint
        assert circle.closed


def test_circles_are_drawn_at_the_posture_of_their_sweep(grid):
    scene = calibration_scene(grid)
    circles = [item for item in scene.under("circles") if "circle_" in item.path]
    assert len(circles) == 11
    measured = grid.train.observations.p_WH
    assert rows_of(at(scene, "circles/shared_samples").centers) == rows_of(measured)
    for fit, item in zip(grid.circles.circles, circles, strict=True):
        spacing = np.linalg.norm(item.points[1] - item.points[0])
        off = distance_to_wire(measured[fit.rows], item.points)
        assert off.max() < 0.5 * spacing + 1e-3


def test_every_held_out_point_is_drawn(scene, calibration):
    points = at(scene, "held_out/points").centers
    assert rows_of(points) == rows_of(calibration.test.observations.p_WH)


def test_outliers_are_marked_with_their_true_residual(scene, calibration):
    assert calibration.train.observations.sample[calibration.outliers].tolist() == list(OUTLIERS)
    marks, misses = at(scene, "outliers/points"), at(scene, "outliers/residuals_x1")
    assert marks.shape == "diamond"
    np.testing.assert_array_equal(misses.ends, marks.centers)
    length = np.linalg.norm(misses.ends - misses.starts, axis=1)
    np.testing.assert_allclose(length, calibration.train.distances[calibration.outliers])


@pytest.mark.parametrize("folder", ["training", "held_out"])
def test_residuals_are_drawn_from_predicted_by_the_factor_in_path_and_legend(
    scene, calibration, folder
):
    item = magnified(scene, folder)
    factor = factor_of(item.path)
    assert factor in (5.0, 10.0, 20.0, 50.0)
    evaluation, rows = calibration.test, slice(None)
    if folder == "training":
        evaluation, rows = calibration.train, ~calibration.outliers
    np.testing.assert_array_equal(item.starts, evaluation.p_WH_predicted[rows])
    drawn = (item.ends - item.starts) / factor
    np.testing.assert_allclose(drawn, evaluation.residuals[rows], atol=1e-12)
    assert any(f"×{factor:g}" in entry.label and entry.colors for entry in scene.legend)


def test_longer_residuals_are_darker(scene, calibration):
    item = magnified(scene, "held_out")
    order = np.argsort(calibration.test.distances)
    brightness = item.colors[order].sum(axis=1)
    assert np.all(np.diff(brightness) <= 1e-9)
    assert brightness[0] > brightness[-1] + 0.5


def test_huge_residuals_are_not_magnified_and_the_legend_says_so(circles_alone):
    scene = calibration_scene(circles_alone)
    large = at(scene, "training/large_residuals_x1")
    length = np.linalg.norm(large.ends - large.starts, axis=1)
    np.testing.assert_allclose(np.sort(length), np.sort(circles_alone.train.distances)[-2:])
    assert len(magnified(scene, "training").starts) == len(circles_alone.train.distances) - 2
    assert any("drawn ×1 (2)" in entry.label for entry in scene.legend)


def test_the_arm_stands_in_the_home_pose_with_joints_on_the_learned_axes(
    scene, calibration, training
):
    home = training.p_WH_measured[training.sweep == "home"][0]
    hand = at(scene, "arm/hand_hand").X_WI[:3, 3]
    assert np.linalg.norm(hand - home) < 3e-3
    chain = calibration.model.chain.rezeroed(shown_pose(calibration))
    for i, joint in enumerate(JOINTS):
        pose = at(scene, f"arm/joint_{joint}").X_WI
        np.testing.assert_allclose(pose[:3, 2], chain.directions[i], atol=1e-12)
        offset = pose[:3, 3] - chain.points[i]
        np.testing.assert_allclose(np.cross(offset, chain.directions[i]), 0.0, atol=1e-9)
        np.testing.assert_array_equal(at(scene, f"joint_axes/{joint}/line").X_WI, pose)
        tip = at(scene, f"joint_axes/{joint}/positive_end")
        assert tip.ends[0, 2] > tip.starts[0, 2] > 0.0


def test_links_join_the_joints_and_end_at_the_hand(scene):
    def end(item, sign):
        return item.X_WI[:3, 3] + sign * 0.5 * item.length * item.X_WI[:3, 2]

    last = at(scene, "arm/link_of_elbow")
    np.testing.assert_allclose(end(last, -1.0), at(scene, "arm/joint_elbow").X_WI[:3, 3])
    np.testing.assert_allclose(end(last, 1.0), at(scene, "arm/hand_hand").X_WI[:3, 3])


def test_the_denavit_hartenberg_frames_are_those_of_the_model(scene, calibration):
    frames = calibration.model.dh.frames(shown_pose(calibration))
    drawn = scene.under("dh_frames")
    assert [item.path for item in drawn][:2] == ["dh_frames/frame_0", "dh_frames/frame_1_pitch"]
    np.testing.assert_array_equal(np.stack([item.X_WI for item in drawn]), frames)


def test_the_ellipsoid_is_the_predicted_covariance_by_its_factor(scene, calibration):
    (item,) = scene.under("uncertainty")
    model = calibration.model
    prediction = model.predict(model.servos.to_encoder(shown_pose(calibration)))
    axes = item.X_WI[:3, :3]
    covariance = axes @ np.diag((item.radii / factor_of(item.path)) ** 2) @ axes.T
    np.testing.assert_allclose(covariance, prediction.covariance[0], atol=1e-12)
    np.testing.assert_allclose(item.X_WI[:3, 3], prediction.p_WH[0])
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert any(f"×{factor_of(item.path):g}" in entry.label for entry in scene.legend)


def test_no_ellipsoid_pretends_to_know_what_the_data_leave_open(failed):
    assert failed.uncertainty.unobservable
    scene = calibration_scene(failed)
    assert scene.under("uncertainty") == ()
    assert any("no ellipsoid" in entry.label for entry in scene.legend)


def test_circle_points_alone_give_a_scene_without_uncertainty(circles_alone):
    scene = calibration_scene(circles_alone)
    assert scene.under("uncertainty") == ()
    assert scene.under("held_out") == ()
    assert len([item for item in scene.under("circles") if "circle_" in item.path]) == 4


def test_the_floor_has_lines_at_round_coordinates_of_the_measuring_frame(scene):
    (grid,) = [item for item in scene.under("floor") if item.path.startswith("floor/grid")]
    spacing = 1e-3 * float(re.search(r"grid_([\d.]+)_mm", grid.path).group(1))
    steps = np.concatenate([grid.starts, grid.ends]) / spacing
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert (grid.starts[:, 2] == 0.0).all()
    np.testing.assert_array_equal(at(scene, "floor/measuring_frame").X_WI, np.eye(4))


def test_the_camera_sees_all_data_and_the_hand(scene, calibration):
    away = scene.camera.p_WC - scene.camera.p_WT
    away /= np.linalg.norm(away)
    right = np.cross([0.0, 0.0, 1.0], away)
    right /= np.linalg.norm(right)
    points = [calibration.train.observations.p_WH[~calibration.outliers]]
    points += [calibration.test.observations.p_WH, [at(scene, "arm/hand_hand").X_WI[:3, 3]]]
    seen = (np.concatenate(points) - scene.camera.p_WC) @ np.stack(
        [right, np.cross(away, right), -away], axis=1
    )
    up = np.tan(0.5 * FIELD_OF_VIEW)
    assert np.all(seen[:, 2] > 0.0)
    assert np.all(np.abs(seen[:, 1] / seen[:, 2]) < up)
    assert np.all(np.abs(seen[:, 0] / seen[:, 2]) < 1.5 * up)
    # And they fill the picture.
    assert np.ptp(seen[:, 1] / seen[:, 2]) > 0.5 * up


def test_names_that_look_alike_in_a_path_stay_apart(renamed):
    scene = calibration_scene(renamed)
    joints = [item for item in scene.items if item.path.startswith("arm/joint_")]
    assert len(joints) == 4
    assert {entry.label for entry in scene.legend} >= {"joint a/b", "joint a b"}


def test_joint_points_lie_on_their_axes_and_make_the_shortest_path():
    chain = true_arm()
    points = joint_points(chain)
    along = points - chain.points
    np.testing.assert_allclose(np.cross(along, chain.directions), 0.0, atol=1e-12)
    shortest = arm_length(chain)
    rng = np.random.default_rng(0)
    for _ in range(50):
        moved = points + rng.normal(0.0, 0.01, (4, 1)) * chain.directions
        steps = np.diff(np.concatenate([moved, chain.p_WH_zero]), axis=0)
        assert np.linalg.norm(steps, axis=1).sum() >= shortest - 1e-5


def test_the_length_of_an_arm_does_not_depend_on_its_pose():
    chain, q = true_arm(), np.array([0.4, -0.7, 1.1, 0.9])
    assert arm_length(chain.rezeroed(q)) == pytest.approx(arm_length(chain), abs=1e-5)


def test_nicos_arm_is_as_long_as_its_two_links():
    # 130 mm to the elbow; 115.66 mm from there to the marker, of which the axes cut a corner.
    assert arm_length(ArmDescription.named().chain) == pytest.approx(0.2457, abs=2e-3)


@pytest.fixture(scope="module")
def nico():
    arm = ArmDescription.named()
    ones = np.ones(len(arm.joints))
    units = ("rad",) * len(arm.joints)
    servos = ServoMap(arm.joints, 0.0 * ones, ones, units, np.nan * ones, ones)
    return arm, SelfModel("nico", DhTable.from_chain(arm.chain), servos)


def test_the_robots_body_moves_with_the_learned_arm(nico):
    arm, model = nico
    q = np.array([-0.4, 0.3, 0.2, -0.8])
    still, moved = (robot_items(arm, model, angles) for angles in (np.zeros(4), q))
    motion = model.chain.link_motions(q)[-1]
    hand = [(a, b) for a, b in zip(still, moved, strict=True) if "/right_hand/" in a.path]
    assert len(hand) > 3
    for before, after in hand:
        np.testing.assert_allclose(after.X_WI, motion @ before.X_WI, atol=1e-9)
    head = [(a, b) for a, b in zip(still, moved, strict=True) if "/head/" in a.path]
    assert head
    for before, after in head:
        np.testing.assert_allclose(after.X_WI, before.X_WI, atol=1e-12)


def test_the_robots_body_is_translucent_and_complete(nico, project_root):
    arm, model = nico
    items = robot_items(arm, model, np.zeros(4))
    text = (project_root / "urdf" / "nico.urdf").read_text(encoding="utf-8")
    assert len(items) == text.count("<visual")
    assert all(0.0 < item.color[3] < 0.5 for item in items)
    assert "not drawn" not in robot_legend(arm)[0].label


def test_a_robot_with_another_arm_is_refused(calibration, nico):
    with pytest.raises(ModelError, match="joints"):
        calibration_scene(calibration, robot=nico[0])


def test_meshes_are_left_out_and_the_legend_says_so(tmp_path):
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        '<robot name="arm"><link name="base"><visual><geometry><mesh filename="base.obj"/>'
        '</geometry></visual></link><link name="tip"><visual><geometry><sphere radius="0.1"/>'
        '</geometry></visual></link><joint name="turn" type="revolute"><parent link="base"/>'
        '<child link="tip"/><origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    arm = ArmDescription.from_urdf(urdf)
    servos = ServoMap(("turn",), [0.0], [1.0], ("rad",), [np.nan], [1.0])
    model = SelfModel("arm", DhTable.from_chain(arm.chain), servos)
    items = robot_items(arm, model, np.zeros(1))
    assert [item.path for item in items] == ["robot/tip/0"]
    assert "1 meshes not drawn" in robot_legend(arm)[0].label
