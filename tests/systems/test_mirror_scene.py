"""A mirror in the rendered world shows what a mirror would."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.geometry import SceneGraph

from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.image_values import image_value, write_bgr
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate, MirrorScene
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.tracking.hand_tracker import HandTracker
from nico_selfmodel.systems.tracking.reflection_detectors import (
    color_in_mirror,
    default_mirror_detectors,
)
from nico_selfmodel.systems.tracking.shared_search import fiducials_in_mirror
from nico_selfmodel.vision.images.not_seen import NotSeen

from .mirror_world import BLOCK, MirrorWorld, facing, plate_pose


def camera(dx=0.0):
    pose = transform(rotation_from_vector([0.01, dx, -0.01]), [0.7 * dx, 0.0, 0.0])
    return Camera(382.0, 380.0, 324.0, 236.0, (640, 480), k1=-0.27, k2=0.085, k3=-0.011, X_WC=pose)


# Ahead, where the room's lights fall on both sides of a card.
AHEAD = transform(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
RIG = StereoRig(camera(), camera(0.1)).moved(AHEAD)
MIRROR = Mirror.from_values([*np.radians([8.0, -12.0]), 0.32])
HAND = np.array([-0.07, 0.06, 0.19])
SHARP, NOISY = ImageQuality(noise=0.0), ImageQuality(noise=2.0)


@pytest.fixture(scope="module")
def world():
    return MirrorWorld(RIG, SHARP)


@pytest.fixture(scope="module")
def without():
    return MirrorWorld(RIG, SHARP, mirror=False)


def in_world(p_L):
    return apply(RIG.left.X_WC, p_L)


def card(p, mirror=MIRROR, turn=None):
    """Return the pose of a card that faces the mirror."""
    X = facing(p, mirror.reflect(np.zeros(3)))
    return X if turn is None else X @ transform(rotation_from_vector(turn), np.zeros(3))


@pytest.mark.slow
def test_reflected_markers_are_where_the_mirror_projects_them():
    world, rng, errors = MirrorWorld(RIG, NOISY), np.random.default_rng(0), []
    find = default_mirror_detectors(RIG)["fiducial"]
    for _ in range(60):
        if len(errors) >= 16:
            break
        tilt, distance = np.radians(rng.uniform(-25.0, 25.0, 2)), rng.uniform(0.25, 0.4)
        mirror = Mirror.from_values([*tilt, distance])
        p = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.4, 0.7) * distance])
        direct, expected = RIG.project(in_world(p)), MirrorRig(RIG, mirror).project(in_world(p))
        apart = np.linalg.norm((direct - expected).reshape(2, 2), axis=1)
        if apart.min() < 90.0:
            continue  # the card's own back would hide its reflection
        X_LC = card(p, mirror, rng.normal(0.0, 0.3, 3))
        for k, image in enumerate(world.look(plate_pose(mirror), X_LC)):
            direct, reflected = find[k](image, np.full(2, np.nan))
            assert isinstance(direct, NotSeen)
            if not isinstance(reflected, NotSeen):  # else it is beside the glass
                errors.append(reflected - expected[2 * k : 2 * k + 2])
    assert len(errors) >= 15
    errors = np.array(errors)
    assert np.abs(errors.mean(axis=0)).max() < 0.03
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) < 0.15


def test_what_stands_before_the_plate_hides_it_and_is_reflected(world, without):
    X_LM, X_LB = plate_pose(MIRROR), transform(np.eye(3), [0.0, 0.0, 0.2])
    alone, mirrored = without.look(X_LB=X_LB), world.look(X_LM, X_LB=X_LB)
    front = X_LB[:3, 3] - [0.0, 0.0, 0.5 * BLOCK]
    direct = RIG.project(in_world(front))
    behind = X_LB[:3, 3] + 0.5 * BLOCK * -MIRROR.normal
    reflected = MirrorRig(RIG, MIRROR).project(in_world(behind))
    for k in range(2):
        u, v = np.rint(direct[2 * k : 2 * k + 2]).astype(int)
        patch = slice(v - 20, v + 21), slice(u - 20, u + 21)
        assert np.array_equal(alone[k][patch], mirrored[k][patch])
        u, v = np.rint(reflected[2 * k : 2 * k + 2]).astype(int)
        # Red before blue: the block, not the room.
        hidden = np.abs(reflected[2 * k : 2 * k + 2] - direct[2 * k : 2 * k + 2]).max() < 45.0
        assert hidden or mirrored[k][v, u, 2] > 1.5 * mirrored[k][v, u, 0]


def test_what_stands_behind_the_plate_is_invisible_even_to_the_reflected_cameras(world):
    X_LM = plate_pose(MIRROR)
    empty = world.look(X_LM)
    # Between the glass and the reflected cameras, where it would hide what they see.
    X_LB = X_LM @ transform(rotation_from_vector([0.2, 0.3, 0.1]), [0.01, 0.02, 0.08])
    for image, plain in zip(world.look(X_LM, X_LB=X_LB), empty, strict=True):
        assert np.array_equal(image, plain)


def test_a_block_through_the_glass_shows_its_front_and_the_reflection_of_its_front(world, without):
    X_LM = plate_pose(MIRROR)
    half = X_LM @ transform(np.eye(3), [0.0, 0.0, 0.0])
    block = [(image[:, :, 2] > 1.5 * image[:, :, 0]).sum() for image in world.look(X_LM, X_LB=half)]
    whole = X_LM @ transform(np.eye(3), [0.0, 0.0, -0.5 * BLOCK])
    twice = [
        (image[:, :, 2] > 1.5 * image[:, :, 0]).sum() for image in world.look(X_LM, X_LB=whole)
    ]
    assert all(0 < one < other for one, other in zip(block, twice, strict=True))


@pytest.mark.slow
def test_a_plate_seen_edge_on_shows_nothing_and_from_behind_only_its_back(world, without):
    plain = without.look(X_LC=card(HAND))
    X_LM = plate_pose(MIRROR)
    sideways = transform(rotation_from_vector([0.0, np.pi / 2, 0.0]), [0.0, 0.0, 0.3])
    # The left camera lies in the plane of the glass, the right one sees it at a grazing angle.
    left, right = world.look(sideways, card(HAND))
    assert np.array_equal(left, plain[0])
    assert (right != plain[1]).any()
    turned = X_LM @ transform(rotation_from_vector([0.0, np.pi, 0.0]), np.zeros(3))
    find, _ = default_mirror_detectors()["fiducial"]
    for image in world.look(turned, card(HAND)):
        direct, reflected = find(image, np.full(2, np.nan))
        assert isinstance(direct, NotSeen)
        assert isinstance(reflected, NotSeen)


@pytest.mark.slow
def test_a_mirror_that_is_moved_through_its_port_shows_the_marker_elsewhere(world, without):
    found = []
    for tilt in (-12.0, -6.0):
        mirror = Mirror.from_values([*np.radians([8.0, tilt]), 0.32])
        images = world.look(plate_pose(mirror), card(HAND))
        find, _ = default_mirror_detectors(RIG)["fiducial"]
        _, reflected = find(images[0], np.full(2, np.nan))
        assert reflected == pytest.approx(
            MirrorRig(RIG, mirror).project(in_world(HAND))[:2], abs=0.5
        )
        found.append(reflected)
    assert np.linalg.norm(found[0] - found[1]) > 20.0
    away, never = world.look(X_LC=card(HAND)), without.look(X_LC=card(HAND))
    assert all(np.array_equal(a, b) for a, b in zip(away, never, strict=True))


def tracked(tracker, images, expected=None):
    """Return the values of all outputs, as numpy arrays or tuples."""
    context = tracker.CreateDefaultContext()
    for name, image in zip(("left", "right"), images, strict=True):
        value = image_value(image.shape[1], image.shape[0])
        write_bgr(image, value.get_mutable_value())
        tracker.GetInputPort(f"{name}_image").FixValue(context, value)
    if expected is not None:
        tracker.GetInputPort("pixels_predicted").FixValue(context, expected)
    ports = [tracker.get_output_port(i) for i in range(tracker.num_output_ports())]
    return {port.get_name(): port.Eval(context) for port in ports}


def test_a_tracker_tells_the_marker_from_its_reflection(world):
    found = default_mirror_detectors(RIG)
    tracker = HandTracker({"fiducial": found["fiducial"]}, before_mirror=True)
    # Turned to the cameras, then to the mirror.
    direct = tracked(tracker, world.look(plate_pose(MIRROR), facing(HAND, np.zeros(3))))
    assert direct["pixels"] == pytest.approx(RIG.project(in_world(HAND)), abs=0.5)
    assert np.isnan(direct["reflected_pixels"]).all()
    assert list(direct["reflected_seen"]) == [0.0, 0.0]
    assert all("in a mirror" in reason for reason in direct["reflected_reasons"])
    mirrored = tracked(tracker, world.look(plate_pose(MIRROR), card(HAND)))
    expected = MirrorRig(RIG, MIRROR).project(in_world(HAND))
    assert mirrored["reflected_pixels"] == pytest.approx(expected, abs=0.5)
    assert np.isnan(mirrored["pixels"]).all()
    assert list(mirrored["seen"]) == [0.0, 0.0]


def test_a_marker_that_is_out_of_sight_gets_no_pixel(world):
    tracker = HandTracker(default_mirror_detectors(), before_mirror=True)
    values = tracked(tracker, world.look(plate_pose(MIRROR)))
    for kind in ("", "reflected_"):
        assert np.isnan(values[f"{kind}pixels"]).all()
        assert not np.any(values[f"{kind}seen"])
        assert all(values[f"{kind}reasons"])
    assert all(
        f"`{port}`" in HandTracker.__doc__ for port in [*values, "pixels_predicted", "left_image"]
    )


def patches(*places):
    """Return a grey picture with red squares."""
    image = np.full((480, 640, 3), 90, np.uint8)
    for u, v, half in places:
        image[v - half : v + half + 1, u - half : u + half + 1] = (20, 20, 220)
    return image


def test_a_reflected_patch_of_colour_is_the_one_where_the_hand_is_not():
    find = color_in_mirror()
    image = patches((200, 300, 9), (420, 180, 6))
    direct, reflected = find(image, np.array([206.0, 295.0]))
    assert direct == pytest.approx([200.0, 300.0], abs=0.6)
    assert reflected == pytest.approx([420.0, 180.0], abs=0.6)
    # The larger patch may as well be the reflection.
    direct, reflected = find(image, np.array([415.0, 185.0]))
    assert direct == pytest.approx([420.0, 180.0], abs=0.6)
    assert reflected == pytest.approx([200.0, 300.0], abs=0.6)


def test_colour_is_not_guessed_where_the_hand_is_not_where_it_should_be():
    find = color_in_mirror()
    one = patches((420, 180, 6))
    direct, reflected = find(one, np.array([100.0, 100.0]))
    assert isinstance(direct, NotSeen)
    assert isinstance(reflected, NotSeen)
    assert "which is the hand" in reflected.reason
    direct, reflected = find(one, np.array([-300.0, 100.0]))
    assert "out of view" in direct.reason
    assert reflected == pytest.approx([420.0, 180.0], abs=0.6)
    direct, reflected = find(one, np.array([421.0, 181.0]))
    assert direct == pytest.approx([420.0, 180.0], abs=0.6)
    assert isinstance(reflected, NotSeen)
    vague = find(patches((200, 200, 6), (225, 200, 6)), np.array([212.0, 200.0]))
    assert all("2 patches" in found.reason for found in vague)
    three = find(patches((200, 200, 6), (400, 200, 6), (500, 90, 6)), np.array([200.0, 200.0]))
    assert "which is meant" in three[1].reason


def test_mirrors_that_make_no_sense_are_refused():
    with pytest.raises(ValueError, match="positive"):
        MirrorPlate(width=0.0)
    with pytest.raises(ValueError, match="different names"):
        MirrorScene(SceneGraph(), [MirrorPlate("a"), MirrorPlate("a")])
    with pytest.raises(ValueError, match="at least one marker"):
        HandTracker({}, before_mirror=True)
    with pytest.raises(ValueError, match="take another"):
        fiducials_in_mirror({"twin": 17}, {}, family="aruco_4x4_1000")


def test_two_mirrors_have_a_port_each_and_the_ports_are_documented():
    scene = MirrorScene(SceneGraph(), [MirrorPlate("left"), MirrorPlate("right")])
    names = [scene.get_input_port(i).get_name() for i in range(2)]
    assert names == ["left_pose", "right_pose"]
    assert "`<name>_pose`" in MirrorScene.__doc__
    poses = scene.get_output_port().Eval(scene.CreateDefaultContext())
    assert poses.size() == 2
    assert AbstractValue.Make(poses) is not None
