"""A tracker that is shown what is about its marks alone finds them as in the whole picture."""

from functools import cache

import numpy as np
import pytest
from pydrake.geometry import FrameId

from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.rendering.mounted_camera import MountedCamera, Sight
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality, StereoCameras
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody

from .test_stereo_cameras import SMALL

POSES = np.radians([[-30.0, 50.0, 0.0, -70.0], [-20.0, 30.0, 10.0, -60.0]])


@cache
def looked(pose):
    """Return whole pictures, sights and pixels of both cameras at a pose."""
    found, poses = [], POSES[pose : pose + 1]
    with NicoStation("thesis", 1) as nico:
        body = StationBody(nico, nico.joints, nico.tracked)
        cameras, tracker = (nico.GetSubsystemByName(name) for name in ("cameras", "tracker"))
        context = cameras.GetMyContextFromRoot(body.context)
        for command in commands_of_angles(nico.joints, nico.arm.lower, nico.arm.upper, poses):
            pixels = body.move_and_measure(command).pixels
            for k, side in enumerate(("left", "right")):
                whole, sight = (
                    bgr_of(cameras.GetOutputPort(f"{side}_{what}").Eval(context)).astype(int)
                    for what in ("image", "sight")
                )
                finders = {
                    m: d[k] for m, d in zip(tracker.markers, tracker._detectors, strict=True)
                }
                found.append(
                    (whole, sight, {m: p[2 * k : 2 * k + 2] for m, p in pixels.items()}, finders)
                )
    return found


@pytest.mark.slow
@pytest.mark.parametrize("pose", [0, 1])
def test_about_the_marks_both_pictures_are_the_same_to_the_last_bit(pose):
    for whole, sight, pixels, _ in looked(pose):
        for point, (u, v) in pixels.items():
            reach = {"fiducial": 30, "finger_tip": 14}[point]
            rows, columns = np.indices(whole.shape[:2])
            near = np.hypot(columns - u, rows - v) < reach
            assert np.array_equal(whole[near], sight[near])


@pytest.mark.slow
def test_the_rest_is_plain_and_of_the_rooms_colour():
    for whole, sight, _, _ in looked(0):
        differs = (whole != sight).any(axis=2)
        assert 0.01 < differs.mean() < 0.4  # the arm is missing
        plain = sight[differs].mean(axis=0)
        assert np.abs(plain - whole[:40, :40].reshape(-1, 3).mean(axis=0)).max() < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("pose", [0, 1])
def test_marks_are_found_where_the_whole_picture_shows_them(pose):
    for whole, _, pixels, finders in looked(pose):
        for point, find in finders.items():
            assert np.array_equal(find(whole.astype(np.uint8)), pixels[point])


@pytest.mark.slow
def test_a_whole_picture_shows_what_the_tracker_was_shown_without_rendering_it_again(monkeypatch):
    rendered = []
    look = MountedCamera.look
    monkeypatch.setattr(
        MountedCamera, "look", lambda eye, query: rendered.append(eye) or look(eye, query)
    )
    with NicoStation("thesis", 1) as nico:
        body = StationBody(nico, nico.joints, nico.tracked)
        cameras = nico.GetSubsystemByName("cameras")
        context = cameras.GetMyContextFromRoot(body.context)
        commands = commands_of_angles(nico.joints, nico.arm.lower, nico.arm.upper, POSES)
        for count, command in enumerate(commands, start=1):
            body.move_and_measure(command)
            for port in ("left_image", "left_sight", "right_image"):
                cameras.GetOutputPort(port).Eval(context)
            assert len(rendered) == 2 * count


@pytest.mark.slow
def test_what_could_be_taken_for_a_mark_is_looked_for_in_whole_pictures():
    with NicoStation("thesis", 1, other=True) as nico:
        assert not nico.GetSubsystemByName("cameras").HasOutputPort("left_sight")


def test_sights_and_motion_blur_are_refused_together():
    frames = (FrameId.get_new_id(), FrameId.get_new_id())
    sight = Sight(frames[0], np.zeros(3), 0.02)
    with pytest.raises(ValueError, match="without mirrors and motion blur"):
        StereoCameras(SMALL, frames, ImageQuality(exposures=2), sights=[sight])
