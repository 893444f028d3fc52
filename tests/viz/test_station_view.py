"""The live scene: a robot that moves, images with marks, and a recording in one page."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.viz.live.hand_view import PREDICTED, TRACKED, marked
from nico_selfmodel.viz.live.screens import screens_beside
from nico_selfmodel.viz.live.station_mirror import StandingGlass
from nico_selfmodel.viz.live.station_view import StationView
from nico_selfmodel.viz.scene.scene import ROOT

ARM = looking_arm("fiducial")
JOINTS = tuple(
    JointInfo(name, "rad", None, float(low), float(high))
    for name, low, high in zip(ARM.joints, ARM.lower, ARM.upper, strict=True)
)


@cache
def guessed():
    return VisibleWorkspace.of(ARM).first_guess(JOINTS)


READINGS = np.radians([-40.0, 15.0, -35.0, -55.0])
IMAGES = [np.full((480, 640, 3), level, np.uint8) for level in (90, 120)]


def pixels():
    return guessed().rig.project(guessed().predict(READINGS).p_WH)[0]


def test_a_cross_marks_a_pixel_and_leaves_it_to_be_seen():
    image = np.zeros((100, 120, 3), np.uint8)
    drawn = marked(image, {(1.0, 0.0, 0.0, 1.0): (60.2, 50.4)})
    assert not image.any()
    red = np.argwhere(drawn[:, :, 0] == 255)
    assert red.mean(axis=0) == pytest.approx([50.0, 60.0])
    assert not drawn[50, 60].any()
    assert drawn[50, 85, 0] == drawn[25, 60, 0] == 255


def test_two_marks_at_one_place_both_show_and_none_is_drawn_where_nothing_was_seen():
    image = np.zeros((60, 80, 3), np.uint8)
    both = marked(image, {TRACKED: (40.0, 30.0), PREDICTED: (40.0, 30.0)})
    assert len(np.unique(both.reshape(-1, 3), axis=0)) == 3
    assert not marked(image, {TRACKED: (np.nan, np.nan)}).any()
    assert marked(image, {TRACKED: (500.0, -40.0)}).shape == image.shape


def test_the_robot_moves_and_its_hand_and_cameras_are_drawn():
    view = StationView(ARM, guessed())
    for q in (READINGS, np.zeros(4)):
        view.show(q, IMAGES, pixels())
    drawn = (
        "cameras/left/image",
        "screens/left/image",
        "screens/right/image",
        "screens/right/name",
    )
    for path in ("hand/tracked", "hand/predicted", "robot/right_hand", *drawn):
        assert view.meshcat.HasPath(f"{ROOT}/{path}"), path
    view.show(READINGS)
    assert view.html().lstrip().lower().startswith("<!doctype html>")


def test_the_predicted_hand_is_on_the_drawn_hand():
    """In the scene's frame the robot's own plant puts the marker where the chain does."""
    view = StationView(ARM, guessed())
    view._link_poses(READINGS)
    frame = view._built.tracked_point_frame("fiducial")
    on_robot = frame.CalcPoseInWorld(view._context).translation()
    assert view.model.chain.forward(READINGS) == pytest.approx(on_robot, abs=1e-9)
    # Upright: the head is above the hand, and the plinth at the origin.
    links = view._link_poses(READINGS)
    assert links["head"][2, 3] > on_robot[2] > 0.0
    assert links["base"] == pytest.approx(np.eye(4), abs=1e-9)


def test_the_screens_face_the_viewer_and_hide_nothing_of_the_robot():
    robot = np.random.default_rng(0).uniform([-0.2, -0.3, 0.0], [0.4, 0.3, 0.9], (50, 3))
    azimuth = np.radians(252.0)
    screens = screens_beside(robot, azimuth, {"left": (640, 480), "right": (640, 480)})
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    from_viewer = -np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    across = [(screen.corners @ right).min() for screen in screens.values()]
    assert (robot @ right).max() < across[0] < across[1]
    for screen in screens.values():
        assert screen.X_WI[:3, 2] == pytest.approx(from_viewer)
        assert screen.X_WI[:3, 0] == pytest.approx(right)
        assert screen.width / screen.height == pytest.approx(640 / 480)
        assert screen.corners[:, 2].max() < 0.9


@pytest.mark.slow
def test_a_recording_keeps_every_image():
    view = StationView(ARM, guessed(), recording=True)
    for k in range(3):
        view.show(READINGS + 0.1 * k, IMAGES, pixels() if k else None)
    paths = [f"{ROOT}/cameras/{camera}/frame_{k}" for camera in ("left", "right") for k in range(3)]
    assert all(view.meshcat.HasPath(path) for path in paths)
    assert len(view.html()) > 500_000


def before_glass():
    """Return a model that knows a mirror 0.3 m before its cameras, and the glass."""
    mirror = Mirror.from_values([0.0, np.radians(-20.0), 0.3])
    X_BL = guessed().rig.left.X_WC
    X_LM = transform(np.stack([[1.0, 0.0, 0.0], np.cross(-mirror.normal, [1.0, 0.0, 0.0]),
                               -mirror.normal], axis=1), -0.25 * mirror.normal)  # fmt: skip
    X_RM = inverse(ARM.links.X_BR) @ X_BL @ X_LM
    return replace(guessed(), mirrors={"glass": mirror}), StandingGlass("glass", X_RM, 0.4, 0.3)


@pytest.mark.slow
def test_a_glass_stands_in_the_learned_plane_and_carries_picture_reflection_and_rays():
    model, glass = before_glass()
    view = StationView(ARM, model, glass=glass)
    mirror = view._mirror
    assert mirror.plane.distance_to(mirror.corners) == pytest.approx(np.zeros(4), abs=1e-12)
    sides = np.linalg.norm(np.diff(mirror.corners, axis=0), axis=1)
    assert sides == pytest.approx([0.4, 0.3, 0.4], abs=1e-9)
    readings = np.radians([-100.0, 5.0, -50.0, -60.0])
    p = view.model.chain.forward(readings)
    reflected = mirror.project(view.model.rig, p)
    assert np.isfinite(reflected).all()
    view.show(readings, IMAGES, None, reflected)
    names = ("picture", "left_ray", "right_ray", "left_behind", "glass")
    for path in (*(f"mirror/{name}" for name in names), "reflection/tracked"):
        assert view.meshcat.HasPath(f"{ROOT}/{path}"), path
    # Light from the hand meets the glass under the angle at which it leaves to the camera.
    hand, on, camera = mirror.rays(view.model.rig, p)["mirror/left_ray"].points
    normal = mirror.plane.normal
    come, go = (hand - on) / np.linalg.norm(hand - on), (camera - on) / np.linalg.norm(camera - on)
    assert come @ normal == pytest.approx(go @ normal, abs=1e-9)
    assert abs(float(mirror.plane.distance_to(on))) < 1e-9


@pytest.mark.slow
def test_reflections_are_marked_by_rings_and_need_a_glass():
    image = np.zeros((100, 120, 3), np.uint8)
    drawn = marked(image, {}, {TRACKED: (60.0, 50.0), PREDICTED: (60.0, 50.0)})
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) == 3
    far = np.hypot(*(np.argwhere(drawn.any(axis=2)) - [50, 60]).T)
    assert 22.0 < far.min() < far.max() < 30.0
    with pytest.raises(ValueError, match="without a glass"):
        StationView(ARM, guessed()).show(READINGS, None, None, np.zeros(4))


def test_a_model_without_cameras_and_pixels_that_are_none_are_refused():
    with pytest.raises(ModelError, match="no pair of cameras"):
        StationView(ARM, replace(guessed(), cameras={}))
    with pytest.raises(ValueError, match=r"shape \(4,\)"):
        StationView(ARM, guessed()).show(READINGS, None, [1.0, 2.0])
