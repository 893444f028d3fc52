"""`servo` and `import lerobot` with Dynamixel and Feetech servos, as somebody types them."""

import json
import math
import os
import signal
import subprocess
import sys

import pytest

from nico_selfmodel.servos import SimulatedBus

from ..servos.motor_client import MotorClient
from ..slow_rest import slow_rest
from .one_line import assert_one_clear_line

SDKS = {"dynamixel": "dynamixel_sdk", "feetech": "scservo_sdk"}
JOINT = """
  - {{name: {name}, address: {address}, lower_deg: -90, upper_deg: 90, max_velocity_deg_s: 60,
     max_acceleration_deg_s2: 240}}"""
CODE = "from nico_selfmodel.cli.main import main; main()"


@pytest.fixture(params=slow_rest(SDKS))
def make(request):
    pytest.importorskip(SDKS[request.param])
    return request.param


@pytest.fixture
def bus(make):
    with SimulatedBus(6, make=make) as simulated:
        yield simulated


@pytest.fixture
def config(make, tmp_path):
    path = tmp_path / "servos.yaml"
    joints = "".join(JOINT.format(name=f"joint_{k}", address=k) for k in range(1, 7))
    head = f"format: nico-servos/1\nname: arm\nmake: {make}\nbaud: 1000000\n"
    path.write_text(f"{head}joints:{joints}\n")
    return path


@pytest.mark.slow
def test_six_servos_are_scanned_at_the_rate_that_they_have(command, bus, make):
    words = ("servo", "scan", "--make", make, "--port", bus.name, "--up-to", 7)
    with bus.lock:
        for module in bus.modules:
            module.baud = 115200
    found = json.loads(command(*words, "--json").stdout)
    assert found["baud"] == 115200
    assert [motor["address"] for motor in found["modules"]] == [1, 2, 3, 4, 5, 6]
    device = {"dynamixel": "XM430-W350", "feetech": "STS3215"}[make]
    assert {motor["device"] for motor in found["modules"]} == {device}
    assert {motor["position_counts"] for motor in found["modules"]} == {2048}
    assert not any(motor["servo_on"] for motor in found["modules"])
    assert device in command(*words, "--baud", 115200).stdout
    assert_one_clear_line(command(*words, "--baud", 1_000_000), "no servo answers", "1000000 baud")
    assert_one_clear_line(command(*words, "--baud", 7), "--baud must be one of")


def test_ids_that_are_given_twice_are_told_by_scan_and_by_the_configuration(
    command, servo, bus, make, config
):
    with bus.lock:
        bus.modules[4].address = 2
    scan = ("servo", "scan", "--make", make, "--port", bus.name, "--baud", 1_000_000)
    assert_one_clear_line(command(*scan, "--up-to", 3), "id 2 answers", "two servos have this id")
    assert_one_clear_line(servo("status"), "id 2 answers", "two servos have this id")
    config.write_text(config.read_text().replace("address: 5", "address: 2"))
    assert_one_clear_line(servo("status"), "address 2 is given to two joints", str(config))


def test_an_arm_is_moved_stopped_and_released(servo, bus):
    before = servo("status")
    assert "rezero" not in before.stdout  # the encoders are absolute
    moved = servo("move", "joint_2", -20, "--yes")
    assert moved.returncode == 0, moved.stderr
    assert "limits -90.0 to 90.0 deg" in moved.stdout
    shafts = bus.shafts()
    assert shafts[1] == pytest.approx(2048 - 20 * 4096 / 360, abs=1)
    assert shafts[0] == shafts[2] == 2048
    state = json.loads(servo("status", "--json").stdout)
    assert state["rezero_due"] == []
    assert state["joints"]["joint_2"]["q_rad"] == pytest.approx(math.radians(-20), abs=2e-3)
    assert "holding: joint_2" in servo("stop").stdout
    assert "holding: none" in servo("stop", "--release", "--yes").stdout
    assert not any(module.servo_on for module in bus.modules)
    homed = servo("home", "joint_2", "--here", "--yes")
    assert homed.returncode == 0, homed.stderr
    state = json.loads(servo("status", "--json").stdout)
    assert state["joints"]["joint_2"]["q_rad"] == pytest.approx(0.0, abs=1e-9)


def test_where_a_servo_is_missing_the_others_are_stopped(servo, bus):
    assert servo("move", "joint_2", 5, "--yes").returncode == 0
    with bus.lock:
        bus.modules[3].silent = True
    done = servo("stop", "--release", "--yes")
    assert_one_clear_line(done, "missing: joint_4 (id 4)", "Switched off all the same: joint_1")
    assert not any(module.servo_on for module in bus.modules)


@pytest.mark.parametrize("make", ["dynamixel"], indirect=True)
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("make: dynamixel", "make: lynxmotion", ("'make' must be one of", "'lynxmotion'")),
        ("baud: 1000000", "baud: 1000001", ("'baud' must be one of", "1000001")),
        ("name: joint_1,", "name: joint_1, gains: {kp: 1},", ("'gains' is for PIC-SERVO",)),
        ("name: joint_1,", "name: joint_1, zero_counts: 9,", ("position register", "0 to 4095")),
        ("address: 1,", "address: 253,", ("'address' must be 0 to 252",)),
        ("name: joint_1,", "name: joint_1, home: {method: index},", ("must be 'here'",)),
        (
            "max_velocity_deg_s: 60",
            "max_velocity_deg_s: 1",
            ("'max_velocity_deg_s' must be at least 15.6",),
        ),
    ],
)
def test_a_configuration_that_does_not_fit_its_make_is_explained(old, new, words, command, config):
    config.write_text(config.read_text().replace(old, new, 1))
    done = command("servo", "status", "--port", "/dev/null", "--config", config)
    assert_one_clear_line(done, str(config), *words)


@pytest.mark.parametrize("make", slow_rest(SDKS), indirect=True)
def test_a_package_that_is_missing_is_one_clear_line(config, make, tmp_path):
    """The package is hidden by one of its name that cannot be imported."""
    (tmp_path / f"{SDKS[make]}.py").write_text("raise ImportError('hidden')\n")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    for words in (
        ("status", "--config", str(config)),
        ("scan", "--make", make),
    ):
        done = subprocess.run(
            [sys.executable, "-c", CODE, "servo", *words, "--port", "/dev/null"],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
            timeout=60,
            check=False,
        )
        assert_one_clear_line(done, "servos need the package", f"nico-selfmodel[{make}]")


@pytest.mark.slow
@pytest.mark.parametrize("make", slow_rest(SDKS), indirect=True)
def test_a_simulated_bus_takes_ids_and_rate_of_its_configuration_and_a_server_lends_it_out(config):
    config.write_text(
        config.read_text().replace("address: 6", "address: 42").replace("1000000", "115200")
    )
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    options = {"stdout": subprocess.PIPE, "text": True, "env": environment}
    words = [sys.executable, "-c", CODE, "servo"]
    simulate = [*words, "simulate", "--config", str(config), "--seconds", "60"]
    with subprocess.Popen(simulate, **options) as simulation:
        port = simulation.stdout.readline().split()[1]
        serve = [*words, "serve", "--port", port, "--config", str(config), "--tcp-port", "0"]
        with subprocess.Popen(serve, **options) as server:
            said = server.stdout.readline()
            with MotorClient(int(said.split("127.0.0.1:")[1].split(",")[0])) as client:
                client.take_lease(5.0)
                client.ask("enable")
                client.move({"joint_6": 0.1})
                assert client.state()["joints"]["joint_6"]["enabled"]
                client.stop()
            server.send_signal(signal.SIGINT)
            assert server.wait(30.0) == 130
        simulation.send_signal(signal.SIGINT)
        assert simulation.wait(30.0) == 0


def test_a_lerobot_calibration_becomes_a_configuration_that_a_bus_accepts(
    command, bus, make, tmp_path
):
    motor = {"drive_mode": 0, "homing_offset": 0, "range_min": 1000, "range_max": 3200}
    arm = {f"joint_{k}": {"id": k, **motor} for k in range(1, 7)}
    (tmp_path / "follower.json").write_text(json.dumps(arm))
    words = ("import", "lerobot", tmp_path / "follower.json", "--make", make)
    made = command(*words, "--out", tmp_path / "arm.yaml")
    assert made.returncode == 0, made.stderr
    assert "-96.7 to 96.7" in made.stdout
    again = command(*words, "--out", tmp_path / "arm.yaml")
    assert_one_clear_line(again, "arm.yaml")
    status = ("servo", "status", "--port", bus.name, "--config", tmp_path / "arm.yaml", "--json")
    state = json.loads(command(*status).stdout)
    assert state["rezero_due"] == []
    assert state["joints"]["joint_1"]["reading_counts"] == 2048 - 2100
    arm["joint_3"]["homing_offset"] = 12
    (tmp_path / "follower.json").write_text(json.dumps(arm))
    assert command(*words, "--out", tmp_path / "arm.yaml", "--force").returncode == 0
    assert json.loads(command(*status).stdout)["rezero_due"] == ["joint_3"]
