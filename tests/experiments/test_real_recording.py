"""Recording through the servo bus: plans that touch nothing, and the same data as without a bus."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.recording.session import record
from nico_selfmodel.servos import ArmController, SimulatedBus
from nico_selfmodel.servos.arm.zeroing import zero_here
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.sessions.hardware_recording import RealRecording
from nico_selfmodel.systems.hardware.motion_capture_stream import (
    MotionCaptureClient,
    MotionCaptureServer,
)
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody

SEED = 3
# What is left of its imperfections is the same each time, so that two recordings can be compared.
SAGGING = replace(
    IMPERFECTIONS["thesis"],
    play=0.0,
    wobble=0.0,
    marker_sigma=0.0,
    dropout_share=0.0,
    name="sagging",
)


@pytest.fixture(scope="module")
def joints():
    return NicoStation("thesis", SEED, quality=ImageQuality(1)).joints


def planned(sensor, joints, circle, free, seed=0):
    return RealRecording.planned(sensor, joints, circle, free, np.random.default_rng(seed))


def labels(plan):
    return [label for label, _ in plan]


def test_a_plan_has_circles_and_random_poses_between_the_limits(joints):
    chosen = planned("motion-capture", joints, 20, 15)
    assert labels(chosen.plan).count("") == 15
    assert labels(chosen.plan).count("home") == 4
    assert {joint.name for joint in joints} <= set(labels(chosen.plan))
    commands = np.array([command for _, command in chosen.plan])
    low, high = (np.array([getattr(j, end) for j in joints]) for end in ("lower", "upper"))
    assert ((commands >= low) & (commands <= high)).all()


@pytest.mark.slow
@pytest.mark.parametrize("sensor", ["motion-capture", "stereo-fiducial"])
def test_no_planned_pose_lets_the_arm_touch_its_body(sensor, joints):
    chosen = planned(sensor, joints, 12, 20)
    reach = VisibleWorkspace.of(chosen.arm)
    q = reach.first_guess(chosen.joints).servos.to_joint(np.array([c for _, c in chosen.plan]))
    assert not any(reach.body.collides(angles) for angles in q)


def test_other_joints_of_the_configuration_are_left_out(joints):
    more = (JointInfo("right_wrist", "counts", 16384.0, -100.0, 100.0), *joints[::-1])
    chosen = planned("motion-capture", more, 0, 3)
    assert chosen.joints == joints
    same = planned("motion-capture", joints, 0, 3)
    assert np.array_equal([c for _, c in chosen.plan], [c for _, c in same.plan])


def test_a_configuration_without_the_arm_is_refused(joints):
    with pytest.raises(DataError, match="has no right_elbow: this recording moves"):
        planned("motion-capture", joints[:3], 0, 3)


def through_the_bus(plans):
    with MotionCaptureServer(("fiducial", "finger_tip", "hand")) as server:
        station = NicoStation(SAGGING, SEED, quality=ImageQuality(1))
        nico = NicoBehindBus(station, server)
        config = nico.configuration
        with SimulatedBus(len(config.joints), plant=nico) as bus:
            with ArmController.open(bus.name, config) as arm:
                arm.connect()
                for name in arm.joints:
                    zero_here(arm, name)
            with (
                MotionCaptureClient(server.address) as tracker,
                NicoHardwareStation(
                    ServoDriver(bus.name, config, settings=BusSettings(5, 0.05)),
                    motion_capture=tracker,
                ) as real,
            ):
                real.enable()
                return [plan.run(real, "bus", source="through the bus") for plan in plans]


def directly(plans):
    station = NicoStation(SAGGING, SEED, quality=ImageQuality(1))
    body = StationBody(station, station.joints, station.arm.markers, sensor="motion-capture")
    return [record(body, plan.plan, "direct") for plan in plans]


def learned_error(train, test):
    train, test = (data.select(data.marker == "hand") for data in (train, test))
    return calibrate_kinematics(train, test=test, name="arm").test.statistics.rms


@pytest.mark.slow
def test_an_arm_is_learned_as_well_through_the_bus_as_without(joints):
    plans = [
        planned("motion-capture", joints, 24, 24, 1),
        planned("motion-capture", joints, 0, 24, 2),
    ]
    error = learned_error(*through_the_bus(plans))
    assert error == pytest.approx(learned_error(*directly(plans)), rel=0.1)
    assert error < 1e-4  # sag, which is all that the mechanics leave, is learned
