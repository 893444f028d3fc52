"""What cannot be seen gives "not seen" and a reason, never a pixel."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.hand_tracker import HandTracker
from nico_selfmodel.systems.tracking.shared_search import fiducial_detectors

from .card_world import CardWorld

EYE = Camera(381.0, 381.0, 319.5, 239.5, (640, 480), k1=-0.25, k2=0.06)
RIG = StereoRig(EYE, replace(EYE, X_WC=transform(np.eye(3), [0.07, 0.0, 0.0])))
LOOKING_POSE = np.radians([-30.0, 50.0, 0.0, -70.0])


def track(images, detectors=None):
    """Run the tracker on a pair of pictures: pixels, seen, reasons."""
    from nico_selfmodel.systems.image_values import image_value, write_bgr

    tracker = HandTracker(detectors or fiducial_detectors({"fiducial": 7}))
    context = tracker.CreateDefaultContext()
    for camera, image in zip(("left", "right"), images, strict=True):
        value = image_value(*image.shape[1::-1])
        write_bgr(image, value.get_mutable_value())
        tracker.GetInputPort(f"{camera}_image").FixValue(context, value)
    return tuple(
        tracker.GetOutputPort(port).Eval(context) for port in ("pixels", "seen", "reasons")
    )


@pytest.fixture(scope="module")
def world():
    return CardWorld(RIG, ImageQuality(1, noise=1.0))


@pytest.fixture(scope="module")
def dazzled():
    return CardWorld(RIG, ImageQuality(1, noise=1.0, gain=60.0))


def at(x, y, z, turn=(0.0, 0.0, 0.0)):
    return transform(rotation_from_vector(np.array(turn)), [x, y, z])


def test_a_marker_in_plain_sight_is_seen_by_both_cameras(world):
    X = at(0.03, 0.0, 0.2, (0.2, 0.1, 0.3))
    pixels, seen, reasons = track(world.look(X))
    assert seen.tolist() == [1.0, 1.0]
    assert reasons == ("", "")
    assert pixels == pytest.approx(RIG.project(X[:3, 3]), abs=0.6)


@pytest.mark.parametrize(
    "X",
    [
        at(0.0, 0.0, -0.3),  # behind the cameras
        at(0.03, 0.0, 2.5),  # too far to be read
        at(0.03, 0.0, 0.2, (np.pi, 0.0, 0.0)),  # its back
        at(0.03, 0.0, 0.2, (0.0, 1.53, 0.0)),  # from its edge
    ],
)
def test_a_marker_that_does_not_show_is_not_seen(world, X):
    pixels, seen, reasons = track(world.look(X))
    assert np.isnan(pixels).all()
    assert seen.tolist() == [0.0, 0.0]
    assert all("no apriltag_36h11 marker 7" in reason for reason in reasons)


def test_a_marker_half_out_of_view_is_seen_by_one_camera_only(world):
    # The left edge of the right camera's image cuts it.
    depth = 0.2
    edge = EYE.undistort(np.array([3.0, 240.0]))[0] * depth + 0.07
    pixels, seen, reasons = track(world.look(at(edge, 0.0, depth)))
    assert seen.tolist() == [1.0, 0.0]
    assert np.isfinite(pixels[:2]).all()
    assert np.isnan(pixels[2:]).all()
    assert reasons[0] == ""
    assert reasons[1] != ""


def test_an_over_exposed_marker_is_not_seen(dazzled):
    # Ink is not quite black: it is as white as paper in the end.
    images = dazzled.look(at(0.03, 0.0, 0.2))
    assert all((image[100:380, 100:540] == 255).mean() > 0.95 for image in images)
    pixels, seen, reasons = track(images)
    assert np.isnan(pixels).all()
    assert not seen.any()
    assert all(reasons)


def test_a_patch_that_is_cut_by_the_border_is_not_seen():
    from nico_selfmodel.systems.tracking.hand_tracker import color_detector

    room = np.full((480, 640, 3), 100, np.uint8)
    whole, cut = room.copy(), room.copy()
    whole[100:120, 200:230] = (30, 20, 220)
    cut[100:120, 630:] = (30, 20, 220)
    pixels, seen, reasons = track([whole, cut], {"finger_tip": color_detector()})
    assert seen.tolist() == [1.0, 0.0]
    assert pixels[:2] == pytest.approx([214.5, 109.5], abs=0.6)
    assert np.isnan(pixels[2:]).all()
    assert "border" in reasons[1]


@pytest.fixture(scope="module")
def nico():
    station = NicoStation("clean", 1, quality=ImageQuality(1))
    return StationBody(station, station.joints, station.tracked), station


def visit(nico, q):
    body, station = nico
    arm = station.arm
    return body.move_and_measure(commands_of_angles(station.joints, arm.lower, arm.upper, [q])[0])


@pytest.mark.slow
def test_nico_sees_its_hand_before_its_cameras(nico):
    observation = visit(nico, LOOKING_POSE)
    for marker in ("fiducial", "finger_tip"):
        assert np.isfinite(observation.pixels[marker]).all(), observation.reasons
    assert observation.points == {"fiducial": None, "finger_tip": None}


@pytest.mark.slow
@pytest.mark.parametrize(
    "q_deg",
    [
        [50.0, 0.0, 0.0, -20.0],  # behind the body
        [0.0, 0.0, 0.0, 0.0],  # hanging at its side
        [-160.0, 10.0, 0.0, -10.0],  # up in the air
    ],
)
def test_nico_does_not_see_a_hand_that_is_elsewhere(nico, q_deg):
    observation = visit(nico, np.radians(q_deg))
    assert np.isnan(observation.pixels["fiducial"]).all()
    assert observation.reasons[0].startswith("no apriltag_36h11 marker 7")
