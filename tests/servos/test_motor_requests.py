"""What a client may ask for: numbers that are none, keys nobody knows, lines without an end."""

import json
import socket
import time

import pytest

from nico_selfmodel.servos.server.motor_requests import (
    NotARequestError,
    RefusedError,
    brief,
    number,
    read_request,
)

from .arms import SOON, wait_for
from .motor_client import MotorClient

HUGE = "1" + "0" * 400


def answers_to(server, *lines):
    """Return what a server says to lines of one connection until it falls silent or hangs up."""
    with socket.create_connection(("127.0.0.1", server.port), SOON) as connection:
        connection.sendall(b"".join(lines))
        connection.shutdown(socket.SHUT_WR)
        return [json.loads(line) for line in connection.makefile("rb")]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('{"op": "lease", "seconds": HUGE}', "finite number, got a whole number of more"),
        ('{"op": "lease", "seconds": 1e400}', "must be a finite number, got inf"),
        ('{"op": "lease", "seconds": -1e-300}', "0.1 to 10"),
        ('{"op": "lease", "seconds": true}', "must be a number, got True"),
        ('{"op": "lease", "seconds": null}', "must be a number, got None"),
        ('{"op": "lease", "seconds": [1]}', "must be a number, got a list of 1"),
        ('{"op": "lease", "seconds": %s}' % ("9" * 5000), '"op"'),
        ('{"op": "lease", "second": 1}', "no key 'second' in 'lease'; there are op, lease, sec"),
        ('{"op": "lease", "op": "stop"}', "a key stands twice"),
        ('{"op": "%s"}' % ("z" * 60_000), "no op 'zzz"),
        ('{"op": "stop", "deep": %s}' % ("[" * 20_000 + "]" * 20_000), "not so many in each other"),
        ('{"op": "stop"' + " " * 70_000 + "}", "at most 65536 bytes"),
        ('{"op": "stop"} {"op": "stop"}', '"op"'),
        ('{"op": "stop"}\x00', '"op"'),
        ('\ufeff{"op": "stop"}', '"op"'),
        ('{"op": "move", "lease": HUGE, "targets": {}}', "no lease"),
    ],
)  # fmt: skip
def test_a_line_that_cannot_be_meant_gets_one_clear_answer(patient_server, line, words):
    cycles = patient_server.loop.cycles
    (answer,) = answers_to(patient_server, line.replace("HUGE", HUGE).encode() + b"\n")
    assert answer["ok"] is False
    assert words in answer["error"]
    assert len(answer["error"]) < 320
    assert patient_server._lease is None
    wait_for(lambda: patient_server.loop.cycles > cycles)  # its thread goes on


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"targets": {"right_elbow": int(HUGE)}}, "must be a finite number"),
        ({"targets": {"right_elbow": 1e-3, "right_wrist": -int(HUGE)}}, "target of 'right_wrist'"),
        ({"targets": {"right_elbow": float("inf")}}, "must be a finite number, got inf"),
        ({"targets": {"right_elbow": None}}, "must be a number"),
        ({"targets": {"right_elbow": {"a": 1}}}, "must be a number, got an object of 1"),
        ({"targets": {"x" * 5000: 0.0}}, "no joint 'xxx"),
        ({"targets": {"right_elbow": 0.1}, "speed_rad_s": 1e-300}, "speed must be at least"),
        ({"targets": {"right_elbow": 0.1}, "speed_rad_s": 1e-6}, "speed must be at least"),
        ({"targets": {"right_elbow": 0.1}, "speed_rad_s": -1}, "speed must be a positive number"),
        ({"targets": {"right_elbow": 0.1}, "speed_rad_s": 0}, "speed must be a positive number"),
        ({"targets": {"right_elbow": 0.1}, "speed_rad_s": int(HUGE)}, "must be a finite number"),
        ({"targets": {"right_elbow": 0.1}, "speed_rad_s": float("nan")}, "must be a finite"),
        ({"targets": {"right_elbow": 0.1}, "speed": 0.1}, "no key 'speed' in 'move'"),
    ],
)
def test_a_motion_that_cannot_be_meant_is_refused_and_nothing_moves(patient_server, values, words):
    wait_for(lambda: patient_server._lease is None)  # the test before has hung up
    with MotorClient(patient_server.port) as client:
        client.take_lease()
        request = {"op": "move", "lease": client.lease, **values}
        (answer,) = answers_to(patient_server, json.dumps(request).encode() + b"\n")
        assert answer["ok"] is False
        assert words in answer["error"]
        assert len(answer["error"]) < 320
        assert not any(joint["moving"] for joint in client.state()["joints"].values())


def test_a_refused_request_does_not_end_the_talk_but_a_line_that_is_none_does(patient_server):
    known, unknown = b'{"op": "describe"}\n', b'{"op": "dance"}\n'
    answers = answers_to(patient_server, known, unknown, known, b"dance\n", known)
    assert [answer["ok"] for answer in answers] == [True, False, True, False]


def test_a_stop_is_obeyed_whatever_else_it_says(patient_server):
    for more in ('"lease": 5', f'"seconds": {HUGE}', '"please": {"a": [1]}'):
        assert answers_to(patient_server, b'{"op": "stop", %s}\n' % more.encode()) == [{"ok": True}]


def test_a_client_that_never_reads_is_hung_up_on_and_holds_nobody_up(patient_server):
    with socket.create_connection(("127.0.0.1", patient_server.port), SOON) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        deaf.settimeout(0.2)
        with pytest.raises((TimeoutError, ConnectionError)):
            deaf.sendall(b'{"op": "state"}\n' * 1_000_000)
        begin = time.monotonic()
        assert answers_to(patient_server, b'{"op": "describe"}\n')[0]["ok"]
        assert time.monotonic() - begin < 1.0


@pytest.mark.parametrize("value", [0, -1.5, 10**17, 1e308])
def test_a_number_is_a_number(value):
    assert number(value, "it") == value


@pytest.mark.parametrize("value", ["1", True, None, [], {}, 10**400, float("nan"), float("-inf")])
def test_what_is_no_number_is_refused(value):
    with pytest.raises(RefusedError, match="it must be a"):
        number(value, "it")


def test_what_somebody_sent_is_shown_in_few_words():
    for value in (10**5000, "x" * 10**5, list(range(10**5)), {"a" * 10**5: 1}):
        assert len(brief(value)) < 80


def test_a_request_is_read_as_it_stands():
    request = read_request(b'{"op": "move", "targets": {"a": 1}, "lease": "x"}\r\n')
    assert request == {"op": "move", "targets": {"a": 1}, "lease": "x"}
    with pytest.raises(NotARequestError, match="no web server"):
        read_request(b"POST /index.html HTTP/1.1\r\n")
