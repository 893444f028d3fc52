"""Through a pseudo-terminal: ports that cannot be opened, hosts that die, pulled cables."""

import math
import os
import signal
import subprocess
import sys
import termios
import time

import numpy as np
import pytest

from nico_selfmodel.errors import BusError
from nico_selfmodel.servos import ArmController, ArmLoop, SimulatedBus
from nico_selfmodel.servos.hand import Hand
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.ports import PortLostError, SerialPort
from nico_selfmodel.servos.simulated.hand import SimulatedHand

from ..slow_rest import slow_rest
from .arms import JOINTS, MAKES, addressed_modules, configuration, stopped, wait_for

HOST = """
import sys
from tests.servos.arms import JOINTS, configuration
from nico_selfmodel.servos import ArmController
config = configuration(make=sys.argv[2], baud=int(sys.argv[3]))
arm = ArmController.open(sys.argv[1], config, trust_zero=True)
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


@pytest.fixture(params=slow_rest(MAKES))
def any_bus(request):
    """Return a bus of each make, and the configuration of its motors."""
    baud = 115200 if request.param == "pic-servo" else 1_000_000
    with wired(request.param, baud) as simulated:
        yield simulated, configuration(make=request.param, baud=baud)


def wired(make, baud):
    """Return a bus of six motors that listen at a rate."""
    if make == "pic-servo":
        return SimulatedBus(addressed_modules(baud))
    pytest.importorskip("dynamixel_sdk" if make == "dynamixel" else "scservo_sdk")
    bus = SimulatedBus(6, make=make)
    for module in bus.modules:
        module.baud = baud
    return bus


def turned(bus, config, start):
    """Return how far the shafts are from where they were [rad]."""
    return np.abs(np.subtract(bus.shafts(), start)) / config.joints[0].counts_per_radian


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "baud"),
    [
        ("pic-servo", 19200),
        pytest.param("pic-servo", 115200, marks=pytest.mark.slow),
        pytest.param("dynamixel", 1_000_000, marks=pytest.mark.slow),
        pytest.param("dynamixel", 57600, marks=pytest.mark.slow),
        pytest.param("feetech", 1_000_000, marks=pytest.mark.slow),
    ],
)
def test_a_host_that_is_killed_leaves_an_arm_that_stops_in_time(make, baud, project_root):
    with wired(make, baud) as bus:
        check_killed(bus, configuration(make=make, baud=baud), project_root)


def check_killed(bus, config, project_root):
    start = bus.shafts()
    path = os.pathsep.join([str(project_root), os.environ.get("PYTHONPATH", "")])
    host = subprocess.Popen(
        [sys.executable, "-c", HOST, bus.name, config.make.name, str(config.baud)],
        stdout=subprocess.PIPE,
        cwd=project_root,
        env={**os.environ, "PYTHONPATH": path},
    )
    try:
        while turned(bus, config, start).max() < 0.16:
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
    reached = turned(bus, config, start)
    assert reached.min() > 0.15
    assert reached.max() < 1.45
    # What it leaves behind can be taken over: the port is free, the boards hold.
    with ArmController.open(bus.name, config, trust_zero=True) as arm:
        arm.connect()
        assert arm.cycle().enabled.all()


def test_a_cable_that_is_pulled_is_an_error_within_a_second(any_bus):
    bus, config = any_bus
    arm = ArmController.open(bus.name, config, trust_zero=True)
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


@pytest.mark.benchmark
@pytest.mark.parametrize("make", MAKES[1:])
def test_six_servos_are_read_and_moved_fifty_times_a_second(make):
    """Through a line that paces its bytes at 1 Mbaud."""
    config = configuration(make=make)
    with (
        wired(make, 1_000_000) as bus,
        ArmController.open(bus.name, config, trust_zero=True) as arm,
    ):
        arm.connect()
        arm.enable()
        arm.move(dict.fromkeys(JOINTS, 0.8))
        cycles, begin = 0, time.monotonic()
        while arm.moving:
            arm.heartbeat()
            arm.cycle()
            cycles += 1
        rate = cycles / (time.monotonic() - begin)
        state = arm.cycle()
    assert state.q == pytest.approx(np.full(6, 0.8), abs=2 * math.pi / 4096)
    assert state.age.max() < 0.1
    assert rate > 50.0


def test_an_arm_of_any_make_is_kept_going_by_a_loop_and_stopped_when_its_program_hangs(any_bus):
    bus, config = any_bus
    start = bus.shafts()
    arm = ArmController.open(bus.name, config, trust_zero=True)
    arm.connect()
    arm.enable()
    with ArmLoop(arm, period=0.02) as loop:
        loop.move({"right_elbow": 1.4})
        begin = time.monotonic()
        stopped(bus)
        assert time.monotonic() - begin < 0.3 + 0.5 + 1.0
        assert 0.05 < turned(bus, config, start)[3] < 1.2
        loop.command(np.zeros(6))
        loop.stop()  # always heard
        assert stopped(bus) < 0.4


def test_a_motor_that_falls_silent_is_named_and_all_others_stop(any_bus):
    bus, config = any_bus
    arm = ArmController.open(bus.name, config, trust_zero=True)
    arm.connect()
    arm.enable()
    with ArmLoop(arm, period=0.02) as loop:
        loop.move(dict.fromkeys(JOINTS, 1.4))
        with bus.lock:
            bus.modules[2].silent = True
        with pytest.raises(BusError, match=r"right_upper_arm_twist \((module|id) 3\) is lost"):
            wait_for(lambda: loop.heartbeat() or loop.state() is None)
        assert stopped(bus) < 0.8


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


@pytest.mark.parametrize(("device", "locked"), [("/dev/ttyUSB0", True), ("/dev/pts/7", False)])
def test_a_device_is_locked_against_programs_that_ask_for_no_lock(bus, monkeypatch, device, locked):
    asked = []
    monkeypatch.setattr("os.path.realpath", lambda name: device)
    monkeypatch.setattr("fcntl.ioctl", lambda handle, request, *rest: asked.append(request))
    SerialPort(bus.name).close()
    assert (termios.TIOCEXCL in asked) == locked


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
