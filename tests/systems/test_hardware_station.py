"""Real cameras and the whole real robot as systems: the ports of the simulated ones, and faults."""

import time
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import PortDataType

from nico_selfmodel.errors import RobotError
from nico_selfmodel.servos import ArmController, JointServo, ServoConfig, SimulatedBus
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config, save_servo_config
from nico_selfmodel.servos.arm.zeroing import zero_here
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.systems.hardware.camera_driver import CameraDriver
from nico_selfmodel.systems.hardware.motion_capture_stream import (
    MarkerFrame,
    MotionCaptureClient,
    MotionCaptureServer,
)
from nico_selfmodel.systems.hardware.servo_driver import ServoDriver
from nico_selfmodel.systems.image_values import bgr_of
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.vision.images.picture_sources import CameraLostError
from nico_selfmodel.vision.images.stereo_capture import StereoCapture

from ..servos.arms import addressed_modules, configuration

MARKERS = ("fiducial", "finger_tip", "hand")
SIZE = (640, 480)


class Repeating:
    """A camera that shows one picture for ever, until it is unplugged."""

    def __init__(self, picture):
        self.name, self.picture, self.lost = "repeating", picture, False

    def __call__(self, begin):
        return self

    def read(self):
        time.sleep(0.01)
        if self.lost:
            raise CameraLostError("camera repeating gives no more pictures: check its cable")
        return time.monotonic(), self.picture

    def close(self):
        pass


@pytest.fixture(scope="module")
def pose():
    """Return what a simulated Nico sees of its hand: both pictures, and its own detections."""
    station = NicoStation("thesis", 3, quality=ImageQuality(1))
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    q = np.radians([-40.0, 15.0, -35.0, -55.0])
    share = (q - station.arm.lower) / (station.arm.upper - station.arm.lower)
    low, high = (np.array([getattr(j, e) for j in station.joints]) for e in ("lower", "upper"))
    station.GetInputPort("encoders_commanded").FixValue(context, low + share * (high - low))
    simulator.AdvanceTo(1.5)
    pictures = [station.picture(context, camera) for camera in ("left", "right")]
    return pictures, np.array(station.GetOutputPort("pixels").Eval(context))


@pytest.fixture
def cameras(pose):
    sources = [Repeating(picture) for picture in pose[0]]
    return CameraDriver(StereoCapture(*sources, SIZE, tolerance=0.02)), sources


def ports(system):
    """Return name -> kind and size of every port; for abstract ones the type that they carry."""
    context = system.CreateDefaultContext()
    found = {}
    for kind, count, get in (
        ("in", system.num_input_ports(), system.get_input_port),
        ("out", system.num_output_ports(), system.get_output_port),
    ):
        for port in map(get, range(count)):
            vector = port.get_data_type() == PortDataType.kVectorValued
            what = port.size() if vector else None
            if not vector and kind == "out":
                what = type(port.Allocate().get_value())
            found[port.get_name()] = (kind, what)
    del context
    return found


def of_the_thesis(names):
    joints = [
        JointServo(name, k, 2e5, -1.5, 1.5, 1.0, 4.0) for k, name in enumerate(names, start=1)
    ]
    return ServoConfig("arm", tuple(joints), baud=115200)


@pytest.mark.slow
def test_the_real_station_has_exactly_the_ports_of_the_simulated_one():
    arm = looking_arm()
    servos = ServoDriver("nowhere", of_the_thesis((*arm.joints, "right_wrist")))
    real = NicoHardwareStation(servos, joints=arm.joints)
    assert ports(real) == ports(NicoStation("thesis", 0, quality=ImageQuality(1)))
    assert all(f"`{name}`" in NicoHardwareStation.__doc__ for name in ports(real))


@pytest.mark.slow
def test_the_real_cameras_have_the_output_ports_of_the_rendered_ones(cameras):
    driver, _ = cameras
    simulated = NicoStation("thesis", 0, quality=ImageQuality(1)).GetSubsystemByName("cameras")
    # Sights show the same pictures about the marks alone, to save what nobody looks at.
    saved = {f"{side}_sight" for side in ("left", "right")}
    outputs = {name: what for name, what in ports(simulated).items() if what[0] == "out"}
    assert saved < set(outputs)
    assert ports(driver) == {name: outputs[name] for name in outputs if name not in saved}


def test_the_cameras_show_the_newest_pictures_and_the_tracker_finds_the_hand(cameras, pose):
    driver, _ = cameras
    names = ("elbow",)
    station = NicoHardwareStation(ServoDriver("nowhere", of_the_thesis(names)), driver)
    with driver:
        simulator = Simulator(driver)
        simulator.Initialize()
        context = simulator.get_context()
        for camera, picture in zip(("left", "right"), pose[0], strict=True):
            shown = bgr_of(driver.GetOutputPort(f"{camera}_image").Eval(context))
            assert np.array_equal(shown, picture)
        first = driver.pair_of(context).time
        time.sleep(0.05)
        simulator.AdvanceTo(0.1)
        assert driver.pair_of(simulator.get_context()).time > first
        root = station.CreateDefaultContext()
        cameras_context = driver.GetMyMutableContextFromRoot(root)
        cameras_context.SetAbstractState(0, [driver.capture.latest()])
        pixels = np.array(station.GetOutputPort("pixels").Eval(root))
    assert np.isfinite(pixels).sum() >= 4
    assert np.array_equal(pixels, pose[1], equal_nan=True)
    assert not driver.capture.is_open


def test_a_lost_camera_is_raised_from_the_diagram_with_its_cause(cameras):
    driver, sources = cameras
    with driver:
        simulator = Simulator(driver)
        simulator.set_target_realtime_rate(1.0)
        simulator.AdvanceTo(0.1)
        sources[1].lost = True
        with pytest.raises(CameraLostError, match="right camera") as caught:
            simulator.AdvanceTo(2.0)
        assert simulator.get_context().get_time() < 1.0
        assert isinstance(caught.value.__cause__, CameraLostError)
    with pytest.raises(RobotError, match="not open"):
        simulator.AdvanceTo(3.0)


def test_instruments_that_are_not_there_say_so_when_they_are_asked():
    station = NicoHardwareStation(ServoDriver("nowhere", of_the_thesis(("elbow",))))
    context = station.CreateDefaultContext()
    for name in ("left_image", "pixels", "reasons"):
        with pytest.raises(RobotError, match="has no cameras"):
            station.GetOutputPort(name).Eval(context)
    for name in ("p_WH_measured", "frame_number"):
        with pytest.raises(RobotError, match="has no motion capture"):
            station.GetOutputPort(name).Eval(context)
    with pytest.raises(RobotError, match="has no cameras"):
        station.body()
    with pytest.raises(ValueError, match="no servo drives knee; the servos are elbow"):
        NicoHardwareStation(ServoDriver("nowhere", of_the_thesis(("elbow",))), joints=["knee"])


def test_a_station_whose_servos_cannot_be_opened_leaves_no_camera_open(cameras, tmp_path):
    driver, _ = cameras
    servos = ServoDriver(str(tmp_path / "ttyNothing"), configuration())
    with pytest.raises(RobotError, match="does not exist"):
        NicoHardwareStation(servos, driver).open()
    assert not driver.capture.is_open


@pytest.fixture(scope="module")
def robot():
    """Return a simulated Nico behind a bus, homed, with its motion capture."""
    with MotionCaptureServer(MARKERS) as server:
        nico = NicoBehindBus(NicoStation("thesis", 3, quality=ImageQuality(1)), server)
        config = nico.configuration
        with SimulatedBus(len(config.joints), plant=nico) as bus:
            with ArmController.open(bus.name, config) as arm:
                assert arm.connect() == config.joint_names
                for name in config.joint_names:
                    zero_here(arm, name)
            yield bus, config, server.address


def patient(bus, config, **options):
    """Return a driver that does not mind when the simulation is late on a busy machine."""
    return ServoDriver(bus.name, config, settings=BusSettings(5, 0.05), **options)


def homes(config):
    return np.array([j.home.at * j.counts_per_radian for j in config.joints])


@pytest.mark.slow
def test_a_body_of_real_servos_goes_where_it_is_sent_and_looks(robot):
    bus, config, address = robot
    with (
        MotionCaptureClient(address) as tracker,
        NicoHardwareStation(patient(bus, config), motion_capture=tracker) as station,
    ):
        station.enable()
        body = station.body("motion-capture")
        assert body.markers == MARKERS
        target = np.round(homes(config)) + np.array([-300.0, 200.0, 150.0, -400.0])
        visits = [body.move_and_measure(target) for _ in range(3)]  # it leaves and comes back
        for seen in visits:
            assert seen.encoders == pytest.approx(target, abs=2)
        # Motion capture of this world loses a marker now and then.
        p, other, *_ = [seen.points["hand"] for seen in visits if seen.points["hand"] is not None]
        assert 0.0 < np.linalg.norm(p - other) < 0.03
        far = body.move_and_measure(target - np.array([0.0, 0.0, 0.0, 1800.0])).points["hand"]
        assert far is None or np.linalg.norm(far - p) > 0.03


@pytest.mark.slow
def test_a_body_with_real_cameras_keeps_pixels_and_pictures(robot, cameras, pose):
    bus, config, _ = robot
    driver, _ = cameras
    with NicoHardwareStation(patient(bus, config), driver) as station:
        station.enable()
        body = station.body(keep_images=True)
        seen = body.move_and_measure(np.round(homes(config)) + np.array([-50.0, 50.0, 50.0, -50.0]))
    assert body.markers == ("fiducial", "finger_tip")
    pixels = np.concatenate([seen.pixels[marker] for marker in body.markers])
    assert np.array_equal(pixels, pose[1], equal_nan=True)
    assert seen.images is not None
    assert np.array_equal(seen.images[0], pose[0][0])


@pytest.mark.slow
def test_an_individual_keeps_its_zero_and_its_stops_through_the_configuration(robot, tmp_path):
    _, config, _ = robot
    save_servo_config(config, tmp_path / "servos.yaml")
    again = load_servo_config(tmp_path / "servos.yaml")
    for one, other in zip(config.joints, again.joints, strict=True):
        assert other.name == one.name
        assert other.home.at == pytest.approx(one.home.at, rel=1e-12)
        assert other.lower_reading == pytest.approx(round(other.lower_reading), abs=1e-6)
    assert again.baud == 115200


def test_encoders_finer_than_boards_can_follow_are_refused():
    with pytest.raises(ValueError, match="at most 200000"):
        NicoBehindBus(NicoStation("clean", 3, quality=ImageQuality(1)))


class Lame(NicoBehindBus):
    """A robot whose elbow is stuck, and whose board does not mind."""

    def __call__(self, time, commanded):
        commanded = np.array(commanded)
        commanded[3] = np.nan
        return super().__call__(time, commanded)


@pytest.mark.slow
def test_a_joint_that_stays_behind_is_named():
    with MotionCaptureServer(MARKERS) as server:
        nico = Lame(NicoStation("thesis", 3, quality=ImageQuality(1)), server)
        config = nico.configuration
        lax = replace(config.joints[3].gains, error_limit=16383)
        joints = (*config.joints[:3], replace(config.joints[3], gains=lax))
        config = replace(config, joints=joints)
        with (
            SimulatedBus(4, plant=nico) as bus,
            MotionCaptureClient(server.address) as tracker,
            NicoHardwareStation(
                patient(bus, config, trust_zero=True), motion_capture=tracker
            ) as station,
        ):
            station.enable()
            with pytest.raises(RobotError, match="came to rest elsewhere: right_elbow reads"):
                station.body("motion-capture").move_and_measure([0.0, 0.0, 0.0, -600.0])


def test_a_tracker_that_goes_away_is_an_error_of_the_station():
    with (
        SimulatedBus(addressed_modules(115200)) as bus,
        MotionCaptureServer(["hand"]) as server,
        MotionCaptureClient(server.address, timeout=0.5) as tracker,
        NicoHardwareStation(
            ServoDriver(bus.name, configuration(baud=115200)), motion_capture=tracker
        ) as station,
    ):
        while server.clients == 0:
            time.sleep(0.01)
        server.send(MarkerFrame(1, 0.0, {"hand": None}))
        simulator = Simulator(station)
        simulator.Initialize()
        measured = station.GetOutputPort("p_WH_measured").Eval(simulator.get_context())
        assert np.isnan(measured).all()
        server.close()
        with pytest.raises(RobotError, match="has ended"):
            simulator.AdvanceTo(1.0)
