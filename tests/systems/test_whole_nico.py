"""The whole simulated Nico: head and both arms are commanded, and one seed is one robot."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.plant.body_description import BodyDescription, built_frame_name
from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS, looking_body
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.stations.whole_nico import WholeNico

BEFORE_THE_FACE = {"neck_yaw": -10.0, "neck_pitch": 25.0, "eyes_tilt": 20.0} | {
    f"{side}_{joint}": angle
    for side in ARM_JOINTS
    for joint, angle in (
        ("shoulder_pitch", -40.0),
        ("shoulder_roll", 15.0),
        ("upper_arm_twist", -35.0),
        ("elbow", -55.0),
        ("forearm_twist", -90.0),
    )
}


def whole(world="thesis", seed=3, joints=()):
    flaws = IMPERFECTIONS[world] if isinstance(world, str) else world
    return WholeNico.build(looking_body(*joints), flaws, seed, NICO_CAMERAS)


def commands(nico, degrees):
    q = np.radians([degrees.get(name, 0.0) for name in nico.body.joints])
    return nico.mechanics.servos.to_encoder(q)


def test_head_and_arms_have_all_their_joints():
    body = looking_body()
    assert len(body.joints) == 18
    parent = dict(zip(body.tree.joints, body.tree.parent.tolist(), strict=True))
    assert parent["right_eye_pan"] == parent["left_eye_pan"] == body.tree.joints.index("eyes_tilt")
    assert parent["neck_yaw"] == parent["right_shoulder_pitch"] == -1


@pytest.mark.parametrize("seed", [0, 7])
def test_the_plant_that_is_drawn_is_the_tree_that_is_measured(seed):
    nico = whole(seed=seed)
    rng = np.random.default_rng(seed)
    built = nico.body.built(nico.mechanics.tree)
    context = built.plant.CreateDefaultContext()
    for q in rng.uniform(nico.body.lower, nico.body.upper, (5, 18)):
        built.move_joints(context, nico.body.joints, q)
        frames = [
            built.plant.GetFrameByName(built_frame_name(marker), built.instance)
            for marker in nico.body.markers
        ]
        drawn = [frame.CalcPoseInWorld(context).translation() for frame in frames]
        assert nico.mechanics.points(q) == pytest.approx(np.array(drawn), abs=1e-12)
        X_BL, rig = nico.mechanics.cameras(q)
        for X_BC, side, camera in (
            (X_BL, "left", nico.rig.left),
            (X_BL @ rig.right.X_WC, "right", nico.rig.right),
        ):
            mount = built.plant.GetFrameByName(f"{side}_wide_camera", built.instance)
            drawn_at = mount.CalcPoseInWorld(context).GetAsMatrix4() @ camera.X_WC
            assert pytest.approx(drawn_at, abs=1e-12) == X_BC


def test_one_seed_is_one_robot_whatever_is_commanded():
    everything, head = whole(), whole(joints=HEAD_JOINTS)
    assert np.array_equal(everything.mechanics.tree.X_PJ, head.mechanics.tree.X_PJ)
    assert everything.mechanics.largest_torque == head.mechanics.largest_torque
    own = [everything.body.joints.index(name) for name in head.body.joints]
    for key in ("gear", "offset"):
        of_all = getattr(everything.mechanics.servos, key)[own]
        assert np.array_equal(of_all, getattr(head.mechanics.servos, key))
    assert np.array_equal(everything.mechanics.lower[own], head.mechanics.lower)
    assert np.array_equal(everything.X_TB, head.X_TB)
    other = whole(seed=4)
    assert not np.array_equal(everything.mechanics.tree.X_PJ, other.mechanics.tree.X_PJ)


def test_what_nobody_commands_stands_nearly_where_it_is_held():
    head = whole(joints=HEAD_JOINTS)
    twist = head.held["right_forearm_twist"]
    assert twist != np.radians(-90.0)
    assert twist == pytest.approx(np.radians(-90.0), abs=np.radians(5.0))
    assert set(head.held) == {*ARM_JOINTS["right"], *ARM_JOINTS["left"]}


@pytest.mark.slow
def test_every_joint_has_play_and_what_weighs_on_it_sags_and_only_shoulders_are_loose():
    nico = whole()
    rng, q = np.random.default_rng(0), np.full(18, 0.3)
    stands = np.array([nico.mechanics.angles(q, rng) for _ in range(400)]) - q
    flaws = IMPERFECTIONS["thesis"]
    sag = flaws.sag * nico.mechanics.torques(q) / nico.mechanics.largest_torque
    assert stands.mean(axis=0) == pytest.approx(sag, abs=np.radians(0.1))
    names = list(nico.body.joints)
    pitches = [names.index(name) for name in ("neck_pitch", "right_shoulder_pitch")]
    assert (np.abs(sag[pitches]) > np.radians(0.05)).all()
    off = np.abs(stands - sag)
    loose = np.array(["shoulder" in name for name in names])
    assert (off[:, ~loose].max(axis=0) <= flaws.play).all()
    assert (off[:, ~loose].max(axis=0) > 0.95 * flaws.play).all()
    assert (off[:, loose].max(axis=0) > 1.5 * flaws.play).all()


def test_gravity_turns_a_stretched_arm_by_all_that_it_carries():
    nico = whole(replace(IMPERFECTIONS["clean"], axis_sigma=0.0, link_sigma=0.0))
    forward = nico.body.joints.index("right_shoulder_pitch")
    hanging, stretched = np.zeros(18), np.zeros(18)
    stretched[forward] = -np.pi / 2
    hand = np.mean(nico.mechanics.points(stretched)[:3], axis=0)
    # Elbow, its twin joint, forearm and wrist stand 130 to 257 mm away, the hand's points behind.
    shoulder_x = 0.0
    expected = 2 * 0.13 + 0.22 + 0.257 + hand[0] - shoulder_x
    assert abs(nico.mechanics.torques(hanging)[forward]) < 0.03
    assert abs(nico.mechanics.torques(stretched)[forward]) == pytest.approx(expected, abs=0.02)


def test_a_joint_that_does_not_exist_is_named_with_those_that_do():
    with pytest.raises(ModelError, match=r"right_shoulder_pitch.*got tail"):
        looking_body("neck_yaw", "tail")
    with pytest.raises(ModelError, match=r"right_wide_camera_mount.*only revolute"):
        BodyDescription.from_urdf("nico", ["right_wide_camera_mount"], {}, {})


@pytest.mark.slow
def test_a_station_commands_the_joints_it_names_and_sees_both_hands_where_they_are():
    nico = whole("clean")
    with NicoStation("clean", 3, arm=looking_body(), quality=ImageQuality(noise=0.0)) as station:
        assert tuple(joint.name for joint in station.joints) == nico.body.joints
        assert station.GetInputPort("encoders_commanded").size() == 18
        body = StationBody(station, station.joints, station.tracked)
        seen = body.move_and_measure(commands(nico, BEFORE_THE_FACE))
    robot = nico.at(seen.encoders)
    p_BH = nico.mechanics.points(nico.mechanics.servos.to_joint(seen.encoders))
    expected = robot.rig.project(apply(inverse(robot.X_BL), p_BH))
    for marker in ("right_hand_fiducial", "left_hand_fiducial"):
        at = nico.mechanics.markers.index(marker)
        assert seen.pixels[marker] == pytest.approx(expected[at], abs=0.8)


@pytest.mark.slow
def test_a_head_that_turns_sees_a_hand_that_stands_still_elsewhere():
    nico = whole("clean", joints=HEAD_JOINTS)
    with NicoStation("clean", 3, arm=looking_body(*HEAD_JOINTS)) as station:
        assert station.GetInputPort("encoders_commanded").size() == 6
        body = StationBody(station, station.joints, station.tracked)
        pictures = []
        for yaw in (-40.0, 0.0):
            body.move_and_measure(commands(nico, {"neck_yaw": yaw}))
            pictures.append(station.picture(body.context, "left"))
    assert not np.array_equal(*pictures)
