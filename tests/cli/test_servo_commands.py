"""`servo` and `hand` on a simulated bus, as somebody types them."""

import json
import math
import os
import signal
import subprocess
import sys
import time

import pytest

from nico_selfmodel.servos import ArmController, SimulatedBus
from nico_selfmodel.servos.arm.servo_config_file import load_servo_config
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.hand import SimulatedHand

from ..servos.motor_client import MotorClient
from .one_line import assert_one_clear_line

JOINT = """
  - name: {name}
    address: {address}
    counts_per_turn: 200000
    output: three_phase
    lower_deg: -90
    upper_deg: 90
    max_velocity_deg_s: 60
    max_acceleration_deg_s2: 240
"""
CODE = "from nico_selfmodel.cli.main import main; main()"
COUNTS_PER_DEGREE = 200_000 / 360


@pytest.fixture
def bus():
    modules = [SimulatedModule(), SimulatedModule()]
    for address, module in enumerate(modules, 1):
        module.address, module.was_addressed = address, True
    with SimulatedBus(modules) as simulated:
        yield simulated


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "servos.yaml"
    joints = "".join(
        JOINT.format(name=name, address=k) for k, name in enumerate(("elbow", "wrist"), 1)
    )
    path.write_text(f"format: nico-servos/1\nname: arm\njoints:{joints}")
    return path


def test_an_arm_is_scanned_homed_moved_and_stopped(servo, command, bus):
    scanned = command("servo", "scan", "--up-to", 2, "--port", bus.name, "--json")
    document = json.loads(scanned.stdout)
    assert [m["address"] for m in document["modules"]] == [1, 2]
    assert document["modules"][0]["device"] == "PIC-SERVO version 10"
    assert "PIC-SERVO" in command("servo", "scan", "--up-to", 2, "--port", bus.name).stdout

    before = servo("status")
    assert "rezero is due: elbow, wrist" in before.stdout
    assert "not homed" in before.stdout
    assert_one_clear_line(servo("move", "elbow", 10, "--yes"), "rezero is due", "elbow")
    assert bus.shafts() == [0, 0]

    homed = servo("home", stdin="y\ny\n")
    assert homed.returncode == 0, homed.stderr
    assert "Does elbow stand at its home, 0 deg?" in homed.stderr

    moved = servo("move", "elbow", -20, "--yes")
    assert moved.returncode == 0, moved.stderr
    assert "limits -90.0 to 90.0 deg, 60 deg/s" in moved.stdout
    assert "elbow at -20.00 deg" in moved.stdout
    assert bus.shafts() == [pytest.approx(-20 * COUNTS_PER_DEGREE, abs=1), 0]

    state = json.loads(servo("status", "--json").stdout)
    assert state["rezero_due"] == []
    assert state["joints"]["elbow"]["q_rad"] == pytest.approx(math.radians(-20), abs=1e-4)
    assert state["joints"]["elbow"]["enabled"]
    assert "holding: elbow" in servo("stop").stdout
    assert "holding: none" in servo("stop", "--release", "--yes").stdout
    assert not any(module.amplifier for module in bus.modules)


def test_nothing_moves_without_a_yes(servo, bus):
    asked = servo("move", "elbow", 10, "--trust-zero", stdin="n\n")
    assert asked.returncode == 130
    assert "Move elbow to 10 deg?" in asked.stderr
    assert "limits" in asked.stdout
    assert servo("move", "elbow", 10, "--trust-zero").returncode == 130  # nobody answers
    assert servo("home").returncode == 130
    assert servo("stop", "--release").returncode == 130
    assert bus.shafts() == [0, 0]
    assert not any(module.amplifier for module in bus.modules)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("elbow", 120), ("elbow cannot go to 120.0 deg", "-90.0 to 90.0 deg")),
        (("elbow", "nan"), ("elbow", "finite")),
        (("knee", 10), ("'knee'", "elbow, wrist")),
        (("elbow", 10, "--speed-deg-s", 500), ("--speed-deg-s", "at most 60", "got 500")),
        (("elbow", 10, "--speed-deg-s", "nan"), ("--speed-deg-s", "above 0")),
        (("elbow", 10, "--speed-deg-s", -3), ("--speed-deg-s", "above 0")),
    ],
)
def test_a_bad_move_is_explained_and_nothing_moves(servo, bus, words, expected):
    done = servo("move", *words, "--trust-zero", "--yes")
    assert_one_clear_line(done, *expected)
    assert done.stdout == ""
    assert bus.shafts() == [0, 0]
    assert not any(module.amplifier for module in bus.modules)


def test_a_joint_without_a_zero_is_refused_before_anything_is_asked_or_switched_on(servo, bus):
    done = servo("move", "elbow", 10)
    assert_one_clear_line(done, "rezero is due", "elbow")
    assert not any(module.amplifier for module in bus.modules)


def test_a_name_that_does_not_exist_is_told_before_any_joint_is_homed(servo):
    assert_one_clear_line(servo("home", "elbow", "knee", "--yes"), "'knee'", "elbow, wrist")
    assert json.loads(servo("status", "--json").stdout)["rezero_due"] == ["elbow", "wrist"]


@pytest.mark.slow
@pytest.mark.parametrize("stop", [5, 19])
def test_a_joint_that_is_blocked_on_its_way_or_near_its_goal_is_told(servo, bus, stop):
    bus.modules[0].mechanics.upper_stop = stop * COUNTS_PER_DEGREE
    moved = servo("move", "elbow", 20, "--speed-deg-s", 20, "--trust-zero", "--yes", "--json")
    assert_one_clear_line(moved, "elbow (module 1): blocked", "free it, then enable it again")
    assert not bus.modules[0].servo_on


@pytest.mark.slow
def test_where_a_board_is_missing_the_others_can_still_be_let_go(servo, bus, config):
    with ArmController.open(bus.name, load_servo_config(config)) as arm:
        arm.connect()
        arm.enable(["elbow"])
    with bus.lock:
        bus.modules[1].silent = True
    stopped = servo("stop")
    assert_one_clear_line(stopped, "missing: wrist (module 2)", "Stopped all the same: elbow")
    assert bus.modules[0].servo_on
    released = servo("stop", "--release", "--yes")
    assert_one_clear_line(released, "missing: wrist", "Switched off all the same: elbow")
    assert not bus.modules[0].amplifier


def test_a_search_for_a_mark_says_how_far_it_goes_before_it_asks(servo, config, bus):
    mark = "{method: limit_1, speed_deg_s: 5, travel_deg: 40}"
    config.write_text(
        config.read_text().replace(
            "output: three_phase", f"output: three_phase\n    home: {mark}", 1
        )
    )
    done = servo("home", "elbow", stdin="n\n")
    assert done.returncode == 130
    assert "looks for limit_1 at 5 deg/s for at most 40 deg" in done.stdout
    assert "Move elbow at 5 deg/s until limit_1" in done.stderr
    assert bus.shafts() == [0, 0]


def test_a_bad_bus_is_explained(command, bus, config, tmp_path):
    nothing = tmp_path / "ttyNothing"
    words = ("status", "--config", config, "--port")
    assert_one_clear_line(command("servo", *words, nothing), str(nothing), "does not exist")
    assert_one_clear_line(command("servo", *words, "/dev/null"), "not a serial port")
    assert_one_clear_line(command("servo", "scan", "--port", bus.name, "--baud", 7), "115200")
    with bus.lock:
        bus.modules[1].silent = True
    assert_one_clear_line(command("servo", *words, bus.name), "wrist (module 2)", "1 of 2")
    with bus.lock:
        bus.line.broken_after = 0
    assert_one_clear_line(
        command("servo", "scan", "--up-to", 2, "--port", bus.name), "no module answers"
    )


def test_a_bad_configuration_is_explained(servo, config):
    config.write_text(config.read_text().replace("address: 2", "adress: 2"))
    assert_one_clear_line(servo("status"), str(config), "wrist", "'adress'", "did you mean")


def test_ctrl_c_stops_the_arm(bus, config):
    words = ("servo", "move", "elbow", "80", "--speed-deg-s", "20", "--trust-zero", "--yes")
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, *words, "--port", bus.name, "--config", str(config)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    until = time.monotonic() + 30.0
    while bus.shafts()[0] < 5 * COUNTS_PER_DEGREE and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30.0)
    assert process.returncode == 130, errors
    assert errors.startswith("stopped; the arm holds\n")
    time.sleep(0.3)  # it brakes for a tenth of a second
    at = bus.shafts()[0]
    assert 5 < at / COUNTS_PER_DEGREE < 60
    assert bus.modules[0].servo_on  # it holds
    time.sleep(0.1)
    assert bus.shafts()[0] == at


@pytest.mark.slow
def test_a_simulated_bus_can_be_used_from_elsewhere_and_a_server_lends_it_out(command, config):
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    options = {"stdout": subprocess.PIPE, "text": True, "env": environment}
    words = [sys.executable, "-c", CODE, "servo"]
    with subprocess.Popen(
        [*words, "simulate", "--config", str(config), "--hand", "--seconds", "60"], **options
    ) as simulation:
        lines = [simulation.stdout.readline().split() for _ in range(2)]
        ports = dict(lines)
        with subprocess.Popen(
            [
                *(*words, "serve", "--port", ports["servos"], "--config", str(config)),
                *("--tcp-port", "0", "--trust-zero"),
            ],
            **options,
        ) as server:
            said = server.stdout.readline() + server.stdout.readline()
            assert "rezero is due" in said
            with MotorClient(int(said.split("127.0.0.1:")[1].split(",")[0])) as client:
                client.take_lease(5.0)
                client.ask("enable")
                client.move({"wrist": 0.1})
                assert client.state()["joints"]["wrist"]["enabled"]
            server.send_signal(signal.SIGINT)
            assert server.wait(30.0) == 130
        done = command("hand", "open", "--port", ports["hand"], "--seconds", 0.1, "--yes")
        assert "index: stopped by" in done.stdout
        simulation.send_signal(signal.SIGINT)
        assert simulation.wait(30.0) == 0


def test_the_hand_opens_and_closes(command):
    with SimulatedHand() as hand:
        words = ("--port", hand.name, "--seconds", 0.1, "--power", 0.3)
        refused = command("hand", "close", *words)
        assert refused.returncode == 130
        assert "current limit 500" in refused.stdout
        done = command("hand", "close", *words, "--finger", "index", "--yes", "--json")
        assert json.loads(done.stdout) == {"stopped_by": {"index": "time"}}
        for wrong in (("--finger", "thumb"), ("--power", "nan"), ("--current-limit", 5000)):
            asked = command("hand", "open", *words, *wrong)
            assert_one_clear_line(asked, wrong[0].strip("-").split("-")[0])
            assert asked.stdout == ""
    assert_one_clear_line(command("hand", "open", "--port", "/dev/null", "--yes"), "/dev/null")


@pytest.mark.slow
def test_steps_are_recorded_and_tell_how_a_joint_follows_its_commands(
    servo, command, bus, tmp_path
):
    out, learned = tmp_path / "steps", tmp_path / "learned"
    made = servo(
        *("steps", "elbow", "--steps", 5, "--largest-deg", 20, "--rest-s", 0.25),
        *("--out", out, "--trust-zero", "--yes"),
    )
    assert made.returncode == 0, made.stderr
    assert f"nico-selfmodel calibrate servos {out}" in made.stdout
    assert bus.shafts() == [pytest.approx(0, abs=1), 0]
    done = command("calibrate", "servos", out, "--out", learned)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "NOT_EVALUATED" in done.stdout
    assert "nico-selfmodel view" not in done.stdout
    document = json.loads((learned / "result.json").read_text())
    speed = document["parameters"]["elbow.speed"]
    assert speed["value"] == pytest.approx(math.radians(60), rel=0.05)
    assert set(document["responses"]) == {"elbow"}
    names = {path.name for path in learned.iterdir()}
    assert names == {"servo_response.yaml", "result.json", "report.html", "residuals.csv"}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("knee",), ("'knee'", "elbow, wrist")),
        (("--speed-deg-s", 500), ("--speed-deg-s", "at most 60")),
        (("--steps", 2), ("--steps", "4")),
    ],
)
def test_steps_that_cannot_be_are_explained_and_nothing_moves(
    servo, bus, tmp_path, words, expected
):
    out = tmp_path / "steps"
    done = servo("steps", "--out", out, "--trust-zero", "--yes", *words)
    assert_one_clear_line(done, *expected)
    assert bus.shafts() == [0, 0]
    assert not out.exists()
    asked = servo("steps", "--out", out, "--trust-zero", stdin="n\n")
    assert asked.returncode == 130
    assert not any(module.amplifier for module in bus.modules)


def test_a_recording_of_something_else_tells_no_response(command, recorded, tmp_path):
    done = command("calibrate", "servos", recorded[0], "--out", tmp_path / "out")
    assert_one_clear_line(done, "motion.csv", "servo steps")
    assert not (tmp_path / "out").exists()
