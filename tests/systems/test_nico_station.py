"""The station: its ports, its seed, its secrets, and what it leaves behind."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from nico_selfmodel.planning.board_poses import board_poses
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_instance import NicoInstance
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.tracking.hand_tracker import HandTracker
from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor
from nico_selfmodel.systems.tracking.shared_search import fiducial_detectors

from ..true_nico import true_rig

ROUGH = ImageQuality(1)
POSE = np.radians([-40.0, 15.0, -35.0, -55.0])
PORTS = {
    "encoders",
    "left_image",
    "right_image",
    "pixels",
    "seen",
    "reasons",
    "p_WH_measured",
    "frame_number",
}


@pytest.fixture(scope="module")
def station():
    return NicoStation("thesis", 3, quality=ROUGH)


def command(station, q=POSE):
    arm = station.arm
    return commands_of_angles(station.joints, arm.lower, arm.upper, [q])[0]


def sensed(station, seconds=1.5):
    """Send the arm to the looking pose; return everything that the ports then carry."""
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    station.GetInputPort("encoders_commanded").FixValue(context, command(station))
    simulator.AdvanceTo(seconds)
    values = {}
    for port in sorted(PORTS - {"reasons"}):
        value = station.GetOutputPort(port).Eval(context)
        values[port] = np.array(getattr(value, "data", value))
    return values


def test_the_ports_are_those_that_real_hardware_could_have(station):
    inputs = [station.get_input_port(i).get_name() for i in range(station.num_input_ports())]
    outputs = [station.get_output_port(i).get_name() for i in range(station.num_output_ports())]
    assert inputs == ["encoders_commanded"]
    assert set(outputs) == PORTS
    assert all(f"`{port}`" in NicoStation.__doc__ for port in [*inputs, *outputs])


@pytest.mark.slow
def test_the_same_seed_twice_is_the_same_to_the_last_byte(station):
    first, second = sensed(station), sensed(NicoStation("thesis", 3, quality=ROUGH))
    for port, value in first.items():
        assert value.tobytes() == second[port].tobytes(), port


@pytest.mark.slow
def test_another_individual_and_another_day_are_others(station):
    here = sensed(station)
    other = sensed(NicoStation("thesis", 4, quality=ROUGH))
    assert not np.array_equal(here["encoders"], other["encoders"])
    day = sensed(NicoStation("thesis", 3, 1, quality=ROUGH))
    assert np.array_equal(here["encoders"], day["encoders"])
    assert not np.array_equal(here["left_image"], day["left_image"])
    assert not np.array_equal(here["p_WH_measured"], day["p_WH_measured"])


def test_no_port_and_no_public_attribute_shows_the_truth(station):
    body = NicoInstance.build(station.arm, IMPERFECTIONS["thesis"], 3, NICO_CAMERAS)
    values = sensed(station)
    shown = np.concatenate(
        [np.ravel(values[port]).astype(float) for port in values if "image" not in port]
        + [[joint.lower, joint.upper, joint.counts_per_turn] for joint in station.joints]
    )
    shown = shown[np.isfinite(shown)]
    chain, servos = body.mechanics.chain, body.mechanics.servos
    truth = [chain.directions, chain.points, chain.p_WH_zero, servos.gear, servos.offset]
    truth += [camera.values for camera in body.rig.cameras]
    truth = np.concatenate([np.ravel(part) for part in truth])
    truth = truth[np.abs(truth - np.round(truth)) > 1e-6]
    assert np.abs(shown[:, None] - truth).min() > 1e-7
    public = {name for name in vars(station) if not name.startswith("_")}
    assert public == {"arm", "world", "seed", "session", "tracked", "image_size", "board"}
    assert isinstance(station.arm, ArmDescription)


def test_true_cameras_are_not_those_that_were_designed():
    body = NicoInstance.build(looking_arm(), IMPERFECTIONS["thesis"], 3, NICO_CAMERAS)
    for true, designed in zip(body.rig.cameras, NICO_CAMERAS.cameras, strict=True):
        assert abs(true.cx - designed.cx) + abs(true.cy - designed.cy) > 0.5
        assert abs(true.k1 - designed.k1) > 1e-4
        assert not np.allclose(true.X_WC, np.eye(4), atol=1e-4)
    assert any(body.held[joint] != value for joint, value in looking_arm().held.items())


@pytest.mark.slow
def test_motion_capture_sees_the_hand_where_the_true_arm_has_it_up_to_its_frame(station):
    clean = NicoStation("clean", 3, quality=ROUGH)
    body = NicoInstance.build(clean.arm, IMPERFECTIONS["clean"], 3, NICO_CAMERAS)
    values = sensed(clean)
    q = body.mechanics.servos.to_joint(values["encoders"])
    p = body.mechanics.chain.forward(np.tile(q, (3, 1)), np.arange(3))
    measured = values["p_WH_measured"].reshape(3, 3)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        expected = np.linalg.norm(p[i] - p[j])
        assert np.linalg.norm(measured[i] - measured[j]) == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
def test_pixels_are_where_the_true_cameras_project_the_true_hand():
    station = NicoStation("clean", 3, quality=ImageQuality(noise=0.0))
    body = NicoInstance.build(station.arm, IMPERFECTIONS["clean"], 3, NICO_CAMERAS)
    values = sensed(station)
    q = body.mechanics.servos.to_joint(values["encoders"])
    p_BH = body.mechanics.chain.forward(q, station.arm.markers.index("fiducial"))
    plant_rig = true_rig(station.arm, body)
    found = values["pixels"][:4]
    assert found == pytest.approx(plant_rig.project(p_BH), abs=0.6)


def test_a_board_that_is_held_up_is_in_the_pictures_until_it_is_put_away(station):
    context = station.CreateDefaultContext()
    before = station.picture(context, "left").astype(int)
    reach = VisibleWorkspace.of(station.arm)
    (X_BG,) = board_poses(reach, station.board, 1, np.random.default_rng(0))
    station.hold_board(context, X_BG)
    held = station.picture(context, "left").astype(int)
    station.hold_board(context, None)
    after = station.picture(context, "left").astype(int)
    assert (np.abs(held - before) > 40).any(axis=2).mean() > 0.03
    assert np.array_equal(before, after)


@pytest.mark.slow
def test_a_users_own_diagram_predicts_and_logs_and_leaves_no_thread(station):
    threads = threading.active_count()
    builder = DiagramBuilder()
    nico = builder.AddSystem(NicoStation("thesis", 3, 7, quality=ROUGH))
    guess = VisibleWorkspace.of(nico.arm).first_guess(nico.joints)
    predictor = builder.AddSystem(SelfModelPredictor(guess, "fiducial"))
    tracker = builder.AddSystem(HandTracker(fiducial_detectors({"fiducial": 7})))
    builder.Connect(nico.GetOutputPort("encoders"), predictor.GetInputPort("encoders"))
    for camera in ("left_image", "right_image"):
        builder.Connect(nico.GetOutputPort(camera), tracker.GetInputPort(camera))
    seen = LogVectorOutput(tracker.GetOutputPort("pixels"), builder, 1.0)
    expected = LogVectorOutput(predictor.GetOutputPort("pixels_predicted"), builder, 1.0)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    own = nico.GetMyMutableContextFromRoot(context)
    nico.GetInputPort("encoders_commanded").FixValue(own, command(nico))
    simulator.AdvanceTo(2.0)
    tracked = seen.FindLog(context).data()[:, -1]
    predicted = expected.FindLog(context).data()[:, -1]
    assert np.isfinite(tracked).all()
    # The description is a few millimetres and degrees off.
    assert np.abs(tracked - predicted).max() < 60.0
    assert threading.active_count() == threads


@pytest.mark.slow
def test_papered_walls_stand_still_in_pictures_while_the_arm_moves():
    world = replace(IMPERFECTIONS["clean"], papered=True)
    quality, rng = ImageQuality(1, noise=0.0), np.random.default_rng(0)
    with NicoStation(world, 2, mirror=MirrorPlate(), quality=quality) as station:
        context, arm = station.CreateDefaultContext(), station.arm
        q = VisibleWorkspace.of(arm).random_poses(6, rng)
        seen = []
        for goal in commands_of_angles(station.joints, arm.lower, arm.upper, q):
            station.GetInputPort("encoders_commanded").FixValue(context, goal)
            Simulator(station, context).AdvanceTo(context.get_time() + 1.5)
            seen.append(station.picture(context, "right").astype(float))
    wall = seen[0].std(axis=2) > 8.0  # of all that is there only paper has colours
    wall[:, :560] = wall[:260] = False
    assert wall.sum() > 300
    # The arm may cover a part of it in some of these poses.
    changed = [np.abs(one - seen[0])[wall].max(axis=1) > 2.0 for one in seen[1:]]
    assert np.median(np.mean(changed, axis=1)) < 0.03
