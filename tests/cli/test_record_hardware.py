"""`record --port`: the same recording through the servo bus, as somebody types it."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nico_selfmodel.dataset.folder import content_hash, load_dataset
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config, save_servo_config
from nico_selfmodel.systems.hardware.motion_capture_stream import MotionCaptureServer
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.vision.images.image_file import write_image

CODE = "from nico_selfmodel.cli.main import main; main()"
SEED = 3


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Return the words that name a simulated Nico behind a bus, and the bus."""
    file = tmp_path_factory.mktemp("robot") / "servos.yaml"
    with MotionCaptureServer(("fiducial", "finger_tip", "hand")) as server:
        nico = NicoBehindBus(NicoStation("thesis", SEED, quality=ImageQuality(1)), server)
        save_servo_config(nico.configuration, file)
        with SimulatedBus(4, plant=nico) as bus:
            host, port = server.address
            words = ("--port", bus.name, "--config", str(file))
            tracker = ("--sensor", "motion-capture", "--motion-capture", f"{host}:{port}")
            yield words, tracker, bus


@pytest.fixture(scope="module")
def homed(robot, command):
    words, tracker, bus = robot
    refused = command(
        "record", "--out", "x", *words, *tracker, "--yes", "--random", 2, "--circle", 0
    )
    assert_one_clear_line(refused, "rezero is due", "right_elbow", "servo home")
    assert not any(module.amplifier for module in bus.modules)
    done = command("servo", "home", "--here", "--yes", *words)
    assert done.returncode == 0, done.stderr
    return words, tracker, bus


def assert_one_clear_line(done, *words):
    assert done.returncode == 2, done.stdout + done.stderr
    line = done.stderr.strip().splitlines()[-1]
    assert line.startswith("nico-selfmodel: ")
    assert all(word in line for word in words), line


@pytest.mark.slow
def test_a_recording_is_announced_made_and_resumed(homed, command, tmp_path):
    words, tracker, _ = homed
    poses = ("--circle", 0, "--random", 2, "--seed", 5)
    asked = command("record", "--out", tmp_path / "data", *words, *tracker, *poses, stdin="n\n")
    assert asked.returncode == 130
    assert "Move the arm through 2 poses?" in asked.stderr
    assert "limits (deg)" in asked.stdout
    assert not (tmp_path / "data").exists()

    made = command("record", "--out", tmp_path / "data", *words, *tracker, *poses, "--yes")
    assert made.returncode == 0, made.stderr
    data = load_dataset(tmp_path / "data")
    assert len(data.samples) == 2
    assert set(data.marker) == {"fiducial", "finger_tip", "hand"}
    assert np.isfinite(data.p_WH_measured).any(axis=1).sum() >= 4
    begin = time.monotonic()
    again = command("record", "--out", tmp_path / "data", *words, *tracker, *poses, "--yes")
    assert again.returncode == 0, again.stderr
    assert time.monotonic() - begin < 8.0
    assert content_hash(load_dataset(tmp_path / "data")) == content_hash(data)


@pytest.mark.slow
def test_real_cameras_may_be_folders_of_pictures(homed, command, tmp_path):
    station = NicoStation("thesis", SEED, quality=ImageQuality(1))
    simulator = Simulator(station)
    q = np.radians([-40.0, 15.0, -35.0, -55.0])
    there = commands_of_angles(station.joints, station.arm.lower, station.arm.upper, [q])[0]
    station.GetInputPort("encoders_commanded").FixValue(simulator.get_mutable_context(), there)
    simulator.AdvanceTo(1.5)
    (tmp_path / "seen").mkdir()
    for side in ("left", "right"):
        write_image(tmp_path / f"{side}.jpg", station.picture(simulator.get_context(), side))
        for k in range(900):  # half a minute
            (tmp_path / "seen" / f"{side}{k}.jpg").symlink_to(tmp_path / f"{side}.jpg")
    cameras = ("--left-camera", tmp_path / "seen", "--right-camera", tmp_path / "seen")
    few = ("--circle", 0, "--random", 1, "--yes", "--images")
    done = command("record", "--out", tmp_path / "data", *homed[0], *cameras, *few)
    assert done.returncode == 0, done.stderr
    data = load_dataset(tmp_path / "data")
    seen = station.GetOutputPort("pixels").Eval(simulator.get_context())[:4]
    assert data.marker.tolist() == ["fiducial"]
    assert data.pixels[0] == pytest.approx(seen, abs=1.0)
    assert data.image_size == (640, 480)
    assert len(list((tmp_path / "data" / "images").iterdir())) == 2


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--config", "x.yaml", "--tip", "a"), ("--config, --tip: for a real robot", "--port")),
        (("--yes",), ("--yes: for a real robot", "--port")),
        (("--port", "nowhere"), ("needs --config",)),
        (("--port", "nowhere", "--imperfections", "clean"), ("--imperfections", "leave it out")),
        (("--port", "nowhere", "--sensor", "chessboard"), ("calibrate stereo",)),
        (("--port", "nowhere", "--config", "nothing.yaml"), ("nothing.yaml",)),
    ],
)
def test_options_that_do_not_fit_are_explained(command, words, expected, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_one_clear_line(command("record", "--out", "out", *words), *expected)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--sensor", "motion-capture"), ("HOST:PORT",)),
        (("--sensor", "motion-capture", "--motion-capture", "here"), ("HOST:PORT", "'here'")),
        (("--motion-capture", "127.0.0.1:1"), ("needs --sensor motion-capture",)),
        ((), ("--left-camera",)),
        (("--speed-deg-s", "500"), ("--speed-deg-s must be above 0, at most 50", "got 500")),
        (("--speed-deg-s", "nan"), ("--speed-deg-s must be above 0",)),
        (("--sensor", "motion-capture", "--motion-capture", "here:70000"), ("'here:70000'",)),
        (("--left-camera", "77", "--right-camera", "78"), ("there is no camera /dev/video77",)),
        (("--left-camera", "no.avi", "--right-camera", "1"), ("no.avi", "no video")),
    ],
)
def test_sensors_that_are_missing_are_explained(robot, command, words, expected, tmp_path):
    few = ("--circle", 0, "--random", 1)
    done = command("record", "--out", tmp_path / "out", *robot[0], *words, *few)
    assert_one_clear_line(done, *expected)
    assert not (tmp_path / "out").exists()


def test_a_port_that_does_not_exist_is_named(robot, command, tmp_path):
    words, tracker, _ = robot
    words = ("--port", tmp_path / "ttyNothing", *words[2:])
    few = ("--circle", 0, "--random", 1, "--yes")
    done = command("record", "--out", tmp_path / "out", *words, *tracker, *few)
    assert_one_clear_line(done, "ttyNothing does not exist")


@pytest.mark.slow
def test_a_fault_keeps_what_was_recorded_and_says_how_to_go_on(homed, command, tmp_path):
    words, tracker, bus = homed
    few = ("--circle", 0, "--random", 1, "--seed", 7, "--yes")
    made = command("record", "--out", tmp_path / "data", *words, *tracker, *few)
    assert made.returncode == 0, made.stderr
    few = ("--circle", 0, "--random", 3, "--seed", 7, "--yes")

    def fail():
        while not any(module.profile.velocity for module in bus.modules):
            time.sleep(0.01)
        with bus.lock:
            bus.modules[2].overload()

    failing = threading.Thread(target=fail)
    failing.start()
    done = command("record", "--out", tmp_path / "data", *words, *tracker, *few)
    failing.join()
    assert_one_clear_line(done, "right_upper_arm_twist (module 3): over-current", "goes on from")
    assert 1 <= len(load_dataset(tmp_path / "data").samples) < 3
    again = command("record", "--out", tmp_path / "data", *words, *tracker, *few)
    assert again.returncode == 0, again.stderr
    assert len(load_dataset(tmp_path / "data").samples) == 3


@pytest.mark.slow
def test_ctrl_c_stops_the_arm_and_keeps_what_was_recorded(homed, tmp_path):
    words, tracker, bus = homed
    poses = ("--circle", "0", "--random", "20", "--speed-deg-s", "20", "--yes")
    recording = ("record", "--out", tmp_path / "data", *words, *tracker, *poses)
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, *recording],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "NO_COLOR": "1"},
    )
    before, until = bus.shafts(), time.monotonic() + 60.0
    while np.abs(np.subtract(bus.shafts(), before)).max() < 100 and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130, errors
    assert "stopped; the arm holds" in errors
    time.sleep(0.5)
    at = bus.shafts()
    time.sleep(0.1)
    assert bus.shafts() == at
    assert all(module.servo_on for module in bus.modules)


@pytest.mark.slow
def test_a_simulated_body_gets_a_configuration_of_its_own(command, tmp_path):
    file = tmp_path / "servos.yaml"
    done = command("servo", "simulate", "--body", "--out", file, "--seconds", 0.05)
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()] == [
        *("config", "motion-capture", "servos")
    ]
    assert len(load_servo_config(file).joints) == 4
    assert_one_clear_line(
        command("servo", "simulate", "--body", "--out", file), str(file), "exists"
    )
    both = command("servo", "simulate", "--body", "--out", tmp_path / "y", "--config", file)
    assert_one_clear_line(both, "leave --config out")


@pytest.mark.slow
def test_a_simulated_body_hangs_behind_a_bus_of_another_process(command, tmp_path):
    file = tmp_path / "servos.yaml"
    words = ("servo", "simulate", "--body", "--out", file, "--seconds", "60")
    with subprocess.Popen(
        [sys.executable, "-c", CODE, *words],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "200"},
    ) as simulation:
        lines = dict(simulation.stdout.readline().split() for _ in range(3))
        assert lines["config"] == str(file)
        scanned = command("servo", "scan", "--up-to", 4, "--port", lines["servos"], "--json")
        assert len(json.loads(scanned.stdout)["modules"]) == 4, scanned.stderr
        assert lines["motion-capture"].startswith("127.0.0.1:")
        simulation.send_signal(signal.SIGINT)
        assert simulation.wait(30.0) == 0
