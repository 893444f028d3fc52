"""Through a pseudo-terminal: ports that cannot be opened, hosts that die, pulled cables."""

import os
import signal
import subprocess
import sys
import time

import pytest

from nico_selfmodel.servos import ArmController, SimulatedBus
from nico_selfmodel.servos.hand import Hand
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.ports import PortLostError, SerialPort
from nico_selfmodel.servos.simulated.hand import SimulatedHand

from .arms import JOINTS, addressed_modules, configuration

HOST = """
import sys
from tests.servos.arms import JOINTS, configuration
from nico_selfmodel.servos import ArmController
arm = ArmController.open(sys.argv[1], configuration(baud=int(sys.argv[2])), trust_zero=True)
arm.connect()
arm.enable()
arm.move(dict.fromkeys(JOINTS, 1.5))
while True:
    arm.heartbeat()
    arm.cycle()
    print("cycle", flush=True)
"""


def go_on(arm):
    """Cycle until something is raised."""
    while True:
        arm.heartbeat()
        arm.cycle()


@pytest.fixture
def bus():
    with SimulatedBus(addressed_modules(115200)) as simulated:
        yield simulated


@pytest.mark.parametrize("baud", [19200, pytest.param(115200, marks=pytest.mark.slow)])
def test_a_host_that_is_killed_leaves_an_arm_that_stops_in_time(bus, baud, project_root):
    with bus.lock:
        for module in bus.modules:
            module.baud = baud
    path = os.pathsep.join([str(project_root), os.environ.get("PYTHONPATH", "")])
    host = subprocess.Popen(
        [sys.executable, "-c", HOST, bus.name, str(baud)],
        stdout=subprocess.PIPE,
        cwd=project_root,
        env={**os.environ, "PYTHONPATH": path},
    )
    try:
        while max(map(abs, bus.shafts())) < 5000:
            assert host.stdout.readline() == b"cycle\n"
        # On the way now, and full speed is a quarter of a second from the start.
        for _ in range(4):
            assert host.stdout.readline() == b"cycle\n"
    finally:
        host.send_signal(signal.SIGKILL)
        host.wait()
        host.stdout.close()
    killed = last_motion = time.monotonic()
    before = bus.shafts()
    while time.monotonic() - last_motion < 0.4:
        time.sleep(0.002)
        if (after := bus.shafts()) != before:
            before, last_motion = after, time.monotonic()
    assert 0.05 < last_motion - killed <= 0.3 + 0.5
    assert all(5000 < abs(shaft) < 1.45 * 31831 for shaft in before)
    # What it leaves behind can be taken over: the port is free, the boards hold.
    with ArmController.open(bus.name, configuration(baud=baud), trust_zero=True) as arm:
        arm.connect()
        assert arm.cycle().enabled.all()


def test_a_cable_that_is_pulled_is_an_error_within_a_second(bus):
    arm = ArmController.open(bus.name, configuration(baud=115200), trust_zero=True)
    arm.connect()
    arm.enable()
    arm.move(dict.fromkeys(JOINTS, 1.5))
    arm.cycle()
    bus.unplug()
    begin = time.monotonic()
    with pytest.raises(PortLostError, match="plug the adapter in again"):
        go_on(arm)
    arm.close()
    assert time.monotonic() - begin < 1.0


def test_a_port_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(PortLostError, match=r"ttyNothing does not exist; (found|no serial port)"):
        SerialPort(str(tmp_path / "ttyNothing"))


@pytest.mark.parametrize("name", ["/dev/null", "."])
def test_what_is_no_serial_port_is_called_that(name):
    with pytest.raises(PortLostError, match="is not a serial port"):
        SerialPort(name)


def test_a_port_without_permission_says_which_group_to_join(monkeypatch):
    def refuse(*_, **__):
        import serial

        raise serial.SerialException(13, "could not open port: Permission denied")

    monkeypatch.setattr("serial.Serial", refuse)
    with pytest.raises(PortLostError, match="no permission for port /dev/ttyUSB9: join the group"):
        SerialPort("/dev/ttyUSB9")


def test_a_port_that_is_in_use_is_not_shared(bus):
    with (
        Bus.open(bus.name),
        pytest.raises(PortLostError, match="is in use: end the other program"),
    ):
        Bus.open(bus.name)
    Bus.open(bus.name).close()


def test_a_closed_port_says_so(bus):
    port = SerialPort(bus.name)
    port.close()
    with pytest.raises(PortLostError, match="closed: open it first"):
        port.write(b"x")
    assert not port.low_latency  # a pseudo-terminal has no such mode


def test_a_host_at_another_rate_is_not_heard(bus):
    with Bus.open(bus.name, 57600) as other:
        from nico_selfmodel.servos.pic_servo.line.chain import scan

        assert scan(other, [1]) == []


def test_an_arm_opened_with_a_self_model_of_another_leaves_the_port_alone(tmp_path):
    import numpy as np

    from nico_selfmodel.model.arm.servo_map import ServoMap

    one = np.ones(1)
    stranger = ServoMap(("neck",), 0 * one, one, ("rad",), np.nan * one, one)
    with pytest.raises(ValueError, match="other joints"):
        ArmController.open(str(tmp_path / "nothing"), configuration(), stranger)


def test_a_hand_behind_a_port_opens_and_what_is_none_is_refused(bus):
    with SimulatedHand() as simulated, Hand.open_port(simulated.name) as hand:
        assert hand.move("open", seconds=0.05, power=0.2) == {"index": "time", "fingers": "time"}
        states = hand.state()
        assert states["index"].motion == "idle"
    with pytest.raises(PortLostError):
        Hand.open_port("/dev/null")
