"""The server that lends an arm out, one process at a time."""

import json
import socket
import threading
import time

import numpy as np
import pytest

from nico_selfmodel.errors import BusError, RobotError
from nico_selfmodel.servos import MotorServer

from .arms import SOON, stopped, wait_for
from .motor_client import MotorClient


def test_one_process_commands_and_all_may_read(server, loop, bus):
    with MotorClient(server.port) as one, MotorClient(server.port) as two:
        with pytest.raises(RobotError, match="no lease"):
            two.move({"right_elbow": 0.1})
        one.take_lease(5.0)
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


def test_a_server_passes_on_what_its_arm_failed_with(server, bus):
    with MotorClient(server.port) as client:
        bus.unplug()
        with pytest.raises(RobotError, match="plug the adapter in"):
            server.wait(SOON)
        with pytest.raises(RobotError, match="plug the adapter in"):
            client.state()
