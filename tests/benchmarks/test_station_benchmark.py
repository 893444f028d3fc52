"""How many pairs of pictures a second a whole station renders, and what it leaves behind."""

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.stations.nico_detectors import default_detectors
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.self_model_predictor import SelfModelPredictor

from .timing import best_ratio

FIDUCIAL = {"fiducial": default_detectors()["fiducial"]}
FPS = 30.0
SECONDS = float(os.environ.get("NICO_STATION_SECONDS", "2"))
"""Simulated; 10 for the figure that the documentation gives."""


@pytest.mark.benchmark
def test_a_station_with_tracker_predictor_and_logger_renders_three_pairs_a_second():
    threads, files = threading.active_count(), open_sockets()
    builder = DiagramBuilder()
    nico = builder.AddSystem(NicoStation("thesis", 1))
    guess = VisibleWorkspace.of(nico.arm).first_guess(nico.joints)
    predictor = builder.AddSystem(SelfModelPredictor(guess, "fiducial"))
    builder.Connect(nico.GetOutputPort("encoders"), predictor.GetInputPort("encoders"))
    log = LogVectorOutput(nico.GetOutputPort("pixels"), builder, 1.0 / FPS)
    LogVectorOutput(predictor.GetOutputPort("pixels_predicted"), builder, 1.0 / FPS)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    arm, pose = nico.arm, np.radians([[-30.0, 50.0, 0.0, -70.0]])
    command = commands_of_angles(nico.joints, arm.lower, arm.upper, pose)[0]
    nico.GetInputPort("encoders_commanded").FixValue(
        nico.GetMyMutableContextFromRoot(context), command
    )
    simulator.Initialize()
    began, used = time.perf_counter(), time.process_time()
    simulator.AdvanceTo(SECONDS)
    wall, cpu = time.perf_counter() - began, time.process_time() - used
    pairs = log.FindLog(context).num_samples()
    print(f"{pairs} pairs, {pairs / wall:.2f} a second, {cpu / pairs:.3f} CPU seconds each")
    assert pairs >= FPS * SECONDS
    assert np.isfinite(log.FindLog(context).data()[:, -1]).all()
    assert pairs / wall >= 3.0
    assert threading.active_count() == threads
    assert open_sockets() == files


@pytest.mark.benchmark
def test_a_picture_takes_little_more_than_rendering_what_is_in_it():
    with NicoStation("thesis", 1) as nico:
        body = StationBody(nico, nico.joints, nico.tracked)
        arm, pose = nico.arm, np.radians([[-30.0, 50.0, 0.0, -70.0]])
        body.move_and_measure(commands_of_angles(nico.joints, arm.lower, arm.upper, pose)[0])
        cameras = nico.GetSubsystemByName("cameras")
        own = cameras.GetMyContextFromRoot(body.context)
        query = cameras.get_input_port().Eval(own)
        eye = cameras._StereoCameras__cameras[0]
        window = eye._pinhole._window(query)
        assert window[2] - window[0] > 200  # the arm is in view
        assert len(eye.look(query)) == 2
        cones = [
            eye._pinhole.cone_about(query, sight.frame, sight.p_FS, sight.radius)
            for sight in eye._sights
        ]
        near = [eye._warp.rays_of(*eye._warp.region_in(*cone)) for cone in cones]

        def rendering():
            eye._pinhole._render(query, window)
            for rays in near:
                eye._pinhole.turned_to(query, rays)

        ratio = best_ratio(
            lambda: cameras._develop(eye.render(query, eye.look(query)), 0.0, 0),
            rendering,
            rounds=5,
        )
    print(f"{ratio:.2f} times the rendering of {window} and its two marks")
    assert ratio <= 1.2


@pytest.mark.benchmark
def test_a_tracker_is_shown_its_mark_in_half_the_time_of_the_window_around_the_arm():
    """The peer is an upright camera, which renders all between the arm and its axis."""
    arm = looking_arm("fiducial")
    with NicoStation("thesis", 1, arm=arm, detectors=FIDUCIAL, near_marks=True) as nico:
        body = StationBody(nico, nico.joints, nico.tracked)
        pose = np.radians([[-30.0, 50.0, 0.0, -70.0]])
        body.move_and_measure(commands_of_angles(nico.joints, arm.lower, arm.upper, pose)[0])
        cameras = nico.GetSubsystemByName("cameras")
        query = cameras.get_input_port().Eval(cameras.GetMyContextFromRoot(body.context))
        camera = cameras._StereoCameras__cameras[0]
        window = camera._pinhole._window(query)
        ratio = best_ratio(
            lambda: cameras._develop(camera.only(camera.look(query)), 0.0, 0),
            lambda: camera._pinhole._upright(query, window),
            rounds=5,
        )
    print(f"{ratio:.2f} times the rendering of {window}")
    assert ratio <= 0.5


def open_sockets():
    folder = Path("/proc/self/fd")
    links = [str(path.readlink()) for path in folder.iterdir() if path.is_symlink()]
    return sum(link.startswith("socket:") for link in links)
