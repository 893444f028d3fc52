"""The thread that keeps an arm going, and the server that lends it out."""

import json
import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, RobotError, ServoFault
from nico_selfmodel.servos import (
    ArmController,
    ArmLoop,
    MotorClient,
    MotorServer,
    PortLostError,
    SimulatedBus,
)

from .arms import JOINTS, addressed_modules, configuration

SOON = 5.0


def wait_for(condition, seconds=SOON):
    """Wait until a condition holds; fail if it never does."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.005)


def stopped(bus):
    """Wait until the simulated arm stands, and return how long that took [s]."""
    begin = last = time.monotonic()
    before = bus.shafts()
    while time.monotonic() - last < 0.15:
        time.sleep(0.005)
        if (after := bus.shafts()) != before:
            before, last = after, time.monotonic()
        assert last - begin < SOON
    return last - begin


@contextmanager
def loop_on(bus):
    """Give a loop of an arm that is connected and enabled."""
    arm = ArmController.open(bus.name, configuration(baud=115200), trust_zero=True)
    arm.connect()
    arm.enable()
    with ArmLoop(arm, period=0.02) as running:
        yield running


@pytest.fixture
def bus():
    with SimulatedBus(addressed_modules(115200)) as simulated:
        yield simulated


@pytest.fixture
def loop(bus):
    with loop_on(bus) as running:
        yield running


@pytest.fixture
def server(loop):
    with MotorServer(loop, 0) as running:
        yield running


@pytest.fixture(scope="module")
def patient_server():
    """Return a server for requests that it refuses."""
    with (
        SimulatedBus(addressed_modules(115200)) as bus,
        loop_on(bus) as loop,
        MotorServer(loop, 0) as running,
    ):
        yield running


def test_a_loop_reads_and_moves_while_others_do_something_else(loop):
    first = loop.state()
    assert first.valid.all()
    target = np.array([0.1, -0.1, 0.05, 0.2, 0.0, -0.05])
    wait_for(lambda: loop.command(target) or (not loop.state().moving.any() and _at(loop, target)))
    assert loop.cycles > 5


def _at(loop, target):
    return np.allclose(loop.state().q, target, atol=1e-3)


def test_handing_over_a_command_takes_no_time(loop):
    q, times = np.zeros(6), []
    for _ in range(50):
        begin = time.perf_counter()
        loop.command(q)
        loop.state()
        times.append(time.perf_counter() - begin)
        time.sleep(0.002)
    assert np.median(times) < 1e-3


def test_a_program_that_hangs_stops_the_arm(loop, bus):
    loop.move({"right_elbow": 1.2})
    begin = time.monotonic()
    stopped(bus)
    assert time.monotonic() - begin < 0.3 + 0.5 + 1.0
    assert abs(bus.shafts()[3]) < 0.9 * 1.2 * 31831
    assert loop.state().valid.all()


def test_bad_commands_are_refused_before_they_are_handed_over(loop):
    with pytest.raises(ValueError, match=r"shape \(6,\)"):
        loop.command(np.zeros(3))
    with pytest.raises(ValueError, match="right_elbow cannot go to"):
        loop.command([0, 0, 0, 9, 0, 0])
    with pytest.raises(ValueError, match="finite"):
        loop.move({"right_elbow": float("nan")})
    loop.check()


def test_a_stop_has_the_last_word_over_a_command_that_was_just_handed_over(loop, bus):
    for target in (1.0, -1.0, 1.0):
        loop.command(np.full(6, target))
        loop.stop()
        assert stopped(bus) < 0.3
        assert not loop.state().moving.any()
    assert np.abs(bus.shafts()).max() < 1000.0


def test_who_waits_for_a_stop_hears_at_once_that_a_command_ended_the_thread(loop, bus):
    loop.call(lambda arm: arm.release(["right_elbow"]))
    begin = time.monotonic()
    loop.command(np.zeros(6))
    with pytest.raises(RobotError):
        loop.stop()
    assert time.monotonic() - begin < SOON
    with pytest.raises(ServoFault, match=r"right_elbow .* is not enabled"):
        loop.check()
    assert stopped(bus) < 0.3


def test_a_pulled_cable_is_raised_with_its_cause_within_a_second(loop, bus):
    loop.move({"right_elbow": 1.2})
    bus.unplug()
    begin = time.monotonic()
    with pytest.raises(PortLostError, match="plug the adapter in again") as caught:
        wait_for(lambda: loop.heartbeat() or loop.state() is None)
    assert time.monotonic() - begin < 1.0
    assert isinstance(caught.value.__cause__, PortLostError)
    with pytest.raises(PortLostError):
        loop.command(np.zeros(6))
    loop.close()  # cleanly
    assert not any(thread.name == "arm loop" for thread in threading.enumerate())


def test_a_lost_module_is_raised_and_named(loop, bus):
    loop.move(dict.fromkeys(JOINTS, 1.0))
    with bus.lock:
        bus.modules[2].silent = True
    with pytest.raises(BusError, match=r"right_upper_arm_twist \(module 3\) is lost"):
        wait_for(lambda: loop.heartbeat() or loop.state() is None)
    assert stopped(bus) < 0.8


def test_what_a_caller_does_wrong_does_not_end_the_loop(loop):
    loop.call(lambda arm: arm.release(["right_elbow"]))
    with pytest.raises(ServoFault, match="not enabled"):
        loop.move({"right_elbow": 0.1})
    loop.check()
    loop.close()
    with pytest.raises(BusError, match="has ended"):
        loop.move({"right_wrist": 0.1})


def test_a_loop_that_is_not_connected_says_so(bus):
    arm = ArmController.open(bus.name, configuration(baud=115200))
    loop = ArmLoop(arm)
    with pytest.raises(BusError, match="connect first"):
        loop.start()
    loop.close()


def test_one_process_commands_and_all_may_read(server, loop, bus):
    with MotorClient(server.port) as one, MotorClient(server.port) as two:
        with pytest.raises(RobotError, match="no lease"):
            two.move({"right_elbow": 0.1})
        one.take_lease(1.0)
        with pytest.raises(RobotError, match="another process holds the lease"):
            two.take_lease()
        assert one.move({"right_elbow": 0.1}) > 0.1
        wait_for(lambda: two.state()["joints"]["right_elbow"]["q_rad"] > 0.05)
        two.lease = "somebody else's"
        with pytest.raises(RobotError, match="not the lease"):
            two.move({"right_elbow": 0.0})
        two.lease = None
        one.ask("release")
        two.take_lease()
        limits = two.ask("describe")["joints"]["right_elbow"]
        assert limits["upper_rad"] == pytest.approx(np.pi / 2)
        two.ask("renew")
        two.ask("enable")


def test_a_lease_that_expires_stops_the_arm(server, bus):
    with MotorClient(server.port) as client:
        client.take_lease(0.3)
        client.move({"right_elbow": 1.4})
        begin = time.monotonic()
        stopped(bus)
        assert 0.3 < time.monotonic() - begin < 0.3 + 0.5 + 1.0
        assert abs(bus.shafts()[3]) < 0.8 * 1.4 * 31831
        with pytest.raises(RobotError, match="no lease"):
            client.move({"right_elbow": 0.0})


def test_a_move_that_comes_to_its_turn_after_its_lease_ended_is_not_made(server, loop, bus):
    with MotorClient(server.port) as one, MotorClient(server.port) as two:
        one.take_lease(0.1)
        busy, free = threading.Event(), threading.Event()
        waiting = threading.Thread(target=loop.call, args=(lambda _: (busy.set(), free.wait()),))
        waiting.start()
        busy.wait(SOON)
        refused = []
        late = threading.Thread(target=lambda: refused.append(_refusal(one, {"right_elbow": 1.0})))
        late.start()
        wait_for(lambda: server._lease is None)
        two.take_lease(10.0)  # whose heartbeat would keep the motion of the other going
        free.set()
        late.join()
        waiting.join()
        assert "not the lease" in refused[0]
        stopped(bus)
        assert bus.shafts() == [0.0] * 6


def test_a_holder_that_hangs_up_while_its_move_waits_does_not_hold_the_arms_thread_up(
    server, loop, bus
):
    """Whoever ends a lease waits for the arm's thread, which asks for the lease: not at once."""
    with MotorClient(server.port) as other:
        holder = MotorClient(server.port)
        holder.take_lease(10.0)
        other.lease = holder.lease
        busy, free = threading.Event(), threading.Event()
        waiting = threading.Thread(target=loop.call, args=(lambda _: (busy.set(), free.wait()),))
        waiting.start()
        busy.wait(SOON)
        refused = []
        late = threading.Thread(
            target=lambda: refused.append(_refusal(other, {"right_elbow": 1.0}))
        )
        late.start()
        wait_for(lambda: len(loop._jobs) == 1)
        holder.close()
        wait_for(lambda: len(loop._jobs) == 2)  # the stop
        free.set()
        late.join(SOON)
        waiting.join(SOON)
        assert "no lease" in refused[0]
        stopped(bus)
        assert bus.shafts() == [0.0] * 6


def _refusal(client, targets):
    with pytest.raises(RobotError) as caught:
        client.move(targets)
    return str(caught.value)


def test_a_client_that_dies_stops_the_arm(server, bus):
    client = MotorClient(server.port)
    client.take_lease(10.0)
    client.move({"right_elbow": 1.4})
    wait_for(lambda: bus.shafts()[3] != 0.0)
    client.close()
    stopped(bus)
    assert abs(bus.shafts()[3]) < 0.8 * 1.4 * 31831


def test_a_lease_keeps_a_long_move_going_and_anybody_may_stop_it(server, bus):
    with MotorClient(server.port) as one, MotorClient(server.port) as two:
        one.take_lease(5.0)
        one.move({"right_elbow": 1.4})
        time.sleep(0.9)  # three heartbeats
        assert two.state()["joints"]["right_elbow"]["moving"]
        two.stop()
        assert stopped(bus) < 0.6
        assert 0.2 * 31831 < abs(bus.shafts()[3]) < 1.3 * 31831


@pytest.mark.parametrize(
    ("line", "word"),
    [
        (b"move\n", '"op"'),
        (b"[1, 2]\n", '"op"'),
        (b'{"op": 5}\n', '"op"'),
        (b'{"op": "dance"}\n', "describe, enable, lease, move"),
        (b'{"op": "lease", "seconds": 99}\n', "0.1 to 10"),
        (b'{"op": "lease", "seconds": "x"}\n', "x"),
        (b'{"op": "lease", "seconds": NaN}\n', "0.1 to 10"),
        (b'{"op": "renew"}\n', "no lease"),
        (b"\xff\xfe\n", '"op"'),
        (b"[" * 9000 + b"\n", '"op"'),
        (b"x" * 70000 + b"\n", "at most 65536 bytes"),
    ],
)
def test_a_bad_request_gets_one_clear_answer(patient_server, line, word):
    with socket.create_connection(("127.0.0.1", patient_server.port), SOON) as connection:
        connection.sendall(line)
        answer = json.loads(connection.makefile("rb").readline())
    assert answer["ok"] is False
    assert word in answer["error"]


@pytest.mark.parametrize(
    ("targets", "word"),
    [
        ({}, "targets"),
        ([], "targets"),
        ({"right_elbow": "up"}, "must be a number"),
        ({"right_elbow": True}, "must be a number"),
        ({"right_elbow": float("nan")}, "finite"),
        ({"right_elbow": 7}, "limits"),
        ({"knee": 0}, "no joint 'knee'"),
    ],
)
def test_bad_targets_are_explained_to_the_client(patient_server, targets, word):
    wait_for(lambda: patient_server._lease is None)  # the test before has hung up
    with MotorClient(patient_server.port) as client:
        client.take_lease()
        with pytest.raises(RobotError, match=word):
            client.ask("move", targets=targets)


@pytest.mark.parametrize(
    ("op", "values", "word"),
    [
        ("enable", {"joints": "right_elbow"}, '"joints" must be a list of names'),
        ("enable", {"joints": 5}, '"joints" must be a list of names'),
        ("enable", {"joints": ["knee"]}, "no joint 'knee'"),
        ("move", {"targets": {"right_elbow": 0.1}, "speed_rad_s": "fast"}, "must be a number"),
        ("move", {"targets": {"right_elbow": 0.1}, "speed_rad_s": True}, "must be a number"),
        ("move", {"targets": {"right_elbow": 0.1}, "speed_rad_s": 9}, "speed must be at most"),
    ],
)
def test_bad_values_are_explained_to_the_client(patient_server, op, values, word):
    wait_for(lambda: patient_server._lease is None)  # the test before has hung up
    with MotorClient(patient_server.port) as client:
        client.take_lease()
        with pytest.raises(RobotError, match=word):
            client.ask(op, **values)


def test_two_servers_cannot_share_a_port(patient_server):
    with (
        pytest.raises(BusError, match="cannot listen"),
        MotorServer(patient_server.loop, patient_server.port),
    ):
        pass


def test_without_a_server_a_client_is_told_how_to_start_one(patient_server):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        with pytest.raises(RobotError, match="servo serve"):
            MotorClient(free.getsockname()[1])


def test_a_server_passes_on_what_its_arm_failed_with(server, bus):
    with MotorClient(server.port) as client:
        bus.unplug()
        with pytest.raises(RobotError, match="plug the adapter in"):
            server.wait(SOON)
        with pytest.raises(RobotError, match="plug the adapter in"):
            client.state()
