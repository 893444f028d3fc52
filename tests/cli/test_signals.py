"""What stops a command while something moves: SIGTERM and SIGHUP as Ctrl-C, and a second one."""

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from contextlib import contextmanager

import pytest

from nico_selfmodel.cli import interruption
from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.servos.arm.servo_config_file import save_servo_config
from nico_selfmodel.servos.ports import SerialPort
from nico_selfmodel.servos.simulated.hand import SimulatedHand

from ..servos.arms import addressed_modules, configuration
from ..servos.motor_client import MotorClient
from ..slow_rest import slow_rest

CODE = "from nico_selfmodel.cli.main import main; main()"
LIKE_CTRL_C = [signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def bus():
    with SimulatedBus(addressed_modules(115200)) as simulated:
        yield simulated


@pytest.fixture
def arm(bus, tmp_path):
    """Return the options that name an arm of six joints."""
    path = tmp_path / "servos.yaml"
    save_servo_config(configuration(baud=115200), path)
    return ("--port", bus.name, "--config", str(path), "--trust-zero")


@contextmanager
def start(*words, **options):
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1"}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
    command = [sys.executable, "-c", CODE, *map(str, words)]
    with subprocess.Popen(command, env=environment, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def moving(arm, **options):
    """Start a motion that takes long."""
    slowly = ("--speed-deg-s", "10", "--yes")
    return start("servo", "move", "right_wrist", "80", *slowly, *arm, **options)


def wait_until(holds):
    until = time.monotonic() + 60.0
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.01)


def under_way(bus):
    wait_until(lambda: any(abs(shaft) > 1000 for shaft in bus.shafts()))


def assert_free(bus):
    """See that all stand, and that the port can be opened by others."""
    SerialPort(bus.name).close()
    time.sleep(0.3)  # it brakes for a tenth of a second
    at = bus.shafts()
    time.sleep(0.1)
    assert bus.shafts() == at


@pytest.mark.parametrize("number", slow_rest(LIKE_CTRL_C, 1))
def test_a_motion_is_stopped_by_every_signal_that_ends_programs(bus, arm, number):
    with moving(arm) as process:
        under_way(bus)
        process.send_signal(number)
        _, errors = process.communicate(timeout=60.0)
    assert errors == "stopped; the arm holds\nnico-selfmodel: stopped\n"
    assert process.returncode == 128 + number
    assert_free(bus)


@pytest.mark.slow
def test_a_motion_is_stopped_when_its_terminal_closes(bus, arm):
    terminal, inner = pty.openpty()
    take = {"preexec_fn": lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0), "start_new_session": True}
    with moving(arm, stdin=inner, stdout=inner, stderr=inner, **take) as process:
        os.close(inner)
        under_way(bus)
        os.close(terminal)
        assert process.wait(60.0) == 128 + signal.SIGHUP
    assert_free(bus)


@pytest.mark.slow
def test_who_is_told_to_ignore_the_end_of_its_terminal_does(bus, arm):
    ignoring = {"preexec_fn": lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN)}
    with moving(arm, **ignoring) as process:
        under_way(bus)
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60.0)
    assert process.returncode == 130


@pytest.mark.parametrize("number", slow_rest(LIKE_CTRL_C, 1))
def test_a_hand_is_stopped_by_every_signal_that_ends_programs(number):
    words = ("hand", "close", "--seconds", 5, "--power", 0.05, "--yes", "--port")
    with SimulatedHand() as hand, start(*words, hand.name) as process:
        fingers = hand.device.fingers.values()
        wait_until(lambda: all(finger.motion == "close" for finger in fingers))
        process.send_signal(number)
        _, errors = process.communicate(timeout=60.0)
        assert [finger.cause for finger in fingers] == ["stop", "stop"]
    assert (process.returncode, errors) == (128 + number, "nico-selfmodel: stopped\n")


@pytest.mark.slow
def test_a_server_that_is_told_to_end_stops_the_arm(bus, arm):
    with start("servo", "serve", "--tcp-port", "0", *arm) as process:
        said = ""
        while "127.0.0.1:" not in said:
            said = process.stdout.readline()
        with MotorClient(int(said.split("127.0.0.1:")[1].split(",")[0])) as client:
            client.take_lease(10.0)
            client.ask("enable")
            client.move({"right_wrist": 1.4}, speed=0.2)
            under_way(bus)
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=60.0)
    assert process.returncode == 128 + signal.SIGTERM
    assert_free(bus)


def test_a_second_signal_does_not_break_off_the_stop():
    done = []

    def stop():
        with interruption.undisturbed():
            signal.raise_signal(signal.SIGINT)
            done.append("stopped")

    with pytest.raises(KeyboardInterrupt):
        stop()
    assert done == ["stopped"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_signals_that_come_together_are_one(monkeypatch):
    monkeypatch.setattr(interruption._Heard, "at", float("-inf"))
    monkeypatch.setattr(interruption._Heard, "number", signal.SIGINT)
    before = [signal.getsignal(number) for number in LIKE_CTRL_C]
    try:
        for number in LIKE_CTRL_C:  # `nohup`, under which tests may run, ignores one
            signal.signal(number, signal.SIG_DFL)
        interruption.hear_signals()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGTERM)
        assert interruption.say_stopped() == 128 + signal.SIGHUP
    finally:
        for number, handler in zip(LIKE_CTRL_C, before, strict=True):
            signal.signal(number, handler)
