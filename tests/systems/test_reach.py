"""Planned poses are in view, face the cameras and touch nothing; so are boards."""

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.planning.board_poses import board_poses
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.systems.looking import looking_arm, touching_arm
from nico_selfmodel.systems.stations.nico_station import BOARD

LOOKING_POSE = np.radians([[-30.0, 50.0, 0.0, -70.0]])


@pytest.fixture(scope="module")
def workspace():
    return VisibleWorkspace.of(looking_arm("fiducial", "finger_tip"))


def test_the_pose_that_the_robots_description_names_is_in_view(workspace):
    assert workspace.usable(LOOKING_POSE).tolist() == [True]


@pytest.mark.parametrize(
    "q_deg", [[50.0, 0.0, 0.0, -20.0], [0.0, 0.0, 0.0, 0.0], [-40.0, 15.0, 90.0, -55.0]]
)
def test_poses_out_of_view_or_with_the_palm_to_the_cameras_are_not(workspace, q_deg):
    assert not workspace.in_view(np.radians([q_deg])).any()


def test_an_arm_in_the_body_collides_and_one_before_it_does_not(workspace):
    assert workspace.body.collides(np.radians([0.0, -15.0, -80.0, -125.0]))
    assert not workspace.body.collides(LOOKING_POSE[0])
    assert not workspace.body.collides(np.zeros(4))


def test_the_head_looks_at_where_the_hand_works(workspace):
    q = np.random.default_rng(0).uniform(workspace.arm.lower, workspace.arm.upper, (4000, 4))
    assert workspace.in_view(q).mean() > 0.045


def test_the_vertical_is_where_head_and_cameras_are_described_to_lean(workspace):
    lean = np.radians(30.0)  # the cameras look down, and the head is turned about the vertical
    assert workspace.up_C == pytest.approx([0.0, -np.cos(lean), -np.sin(lean)], abs=1e-9)


def test_random_poses_are_usable_within_limits_and_come_from_the_seed(workspace):
    a, b = (workspace.random_poses(20, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(a, b)
    assert workspace.usable(a).all()
    assert ((a >= workspace.arm.lower) & (a <= workspace.arm.upper)).all()


@pytest.mark.slow
def test_sweeps_about_home_are_in_view_and_wide(workspace):
    home, arcs = workspace.home_and_arcs(40)
    assert (np.ptp(arcs, axis=1) > np.radians(35.0)).all()
    assert np.degrees(home[3]) < -20.0  # the elbow is bent
    for i, (low, high) in enumerate(arcs):
        poses = np.tile(home, (9, 1))
        poses[:, i] = np.linspace(low, high, 9)
        assert workspace.in_view(poses).all()


def test_boards_are_whole_in_both_images_and_before_the_body(workspace):
    for X_BG in board_poses(workspace, BOARD, 8, np.random.default_rng(0)):
        corners = apply(X_BG, BOARD.points)
        pixels = workspace.rig.project(corners)
        assert ((pixels > 0.0) & (pixels < [640.0, 480.0, 640.0, 480.0])).all()
        assert corners[:, 0].min() > 0.05
        # Seen from the front: x of the board runs to the right in the image, y down.
        along, down = pixels[8, :2] - pixels[0, :2], pixels[45, :2] - pixels[0, :2]
        assert along[0] * down[1] - along[1] * down[0] > 0.0


def test_the_arm_that_touches_is_the_one_that_looks_with_two_joints_more():
    four, six = looking_arm("fiducial"), touching_arm("fiducial")
    assert six.joints == (*four.joints, "right_forearm_twist", "right_wrist")
    assert set(six.held) == set(four.held) - set(six.joints)
    q = np.random.default_rng(1).uniform(four.lower, four.upper, (5, 4))
    turned = [[four.held[joint] for joint in six.joints[4:]]] * 5
    whole = six.chain.forward(np.hstack([q, turned]), 0)
    assert whole == pytest.approx(four.chain.forward(q, 0), abs=1e-9)


def test_points_that_are_not_there_are_refused():
    with pytest.raises(ModelError, match="has the points fiducial"):
        VisibleWorkspace.of(looking_arm("fiducial"), ("nose",))
    with pytest.raises(ValueError, match="no point"):
        looking_arm("nose")
