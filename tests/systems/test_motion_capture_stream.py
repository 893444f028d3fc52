"""Motion capture over TCP, and what happens when the other side goes away."""

import json
import socket
import threading

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from nico_selfmodel.errors import RobotError
from nico_selfmodel.systems.hardware.motion_capture_link import (
    MotionCaptureReceiver,
    MotionCaptureSender,
)
from nico_selfmodel.systems.hardware.motion_capture_stream import (
    MarkerFrame,
    MotionCaptureClient,
    MotionCaptureServer,
)
from nico_selfmodel.systems.simulated.motion_capture import MotionCapture

POINT = np.array([0.1, -0.2, 0.3])


def frame(number=12, hand=POINT):
    return MarkerFrame(number, 0.01 * number, {"hand": hand, "elbow": None})


@pytest.fixture
def server():
    with MotionCaptureServer(["hand", "elbow"]) as running:
        yield running


@pytest.fixture
def client(server):
    with MotionCaptureClient(server.address, timeout=2.0) as connected:
        yield connected


def test_frames_arrive_exactly_and_lost_markers_as_none(server, client):
    server.send(frame())
    received = client.next()
    assert client.markers == ("hand", "elbow")
    assert (received.frame, received.time) == (12, 0.12)
    assert np.array_equal(received.positions["hand"], POINT)
    assert received.positions["elbow"] is None


def test_what_goes_over_the_wire_is_what_the_documentation_says(server):
    with socket.create_connection(server.address, 2.0) as raw, raw.makefile() as lines:
        greeting = json.loads(lines.readline())
        server.send(frame())
        sent = json.loads(lines.readline())
    assert greeting == {
        "format": "nico-motion-capture/1",
        "markers": ["hand", "elbow"],
        "unit": "m",
    }
    assert sent == {"frame": 12, "time_s": 0.12, "hand": POINT.tolist(), "elbow": None}


def test_a_server_listens_on_this_machine_only(server):
    assert server.address[0] == "127.0.0.1"


def test_the_newest_frame_is_had_without_waiting_for_the_older_ones(server, client):
    for number in range(20):
        server.send(frame(number))
    seen = client.latest().frame
    while seen < 19:
        seen = client.latest().frame
    assert seen == 19


def test_many_clients_get_the_same(server):
    with (
        MotionCaptureClient(server.address, 2.0) as a,
        MotionCaptureClient(server.address, 2.0) as b,
    ):
        server.send(frame(5))
        assert a.next().frame == b.next().frame == 5
        assert server.clients == 2


def test_a_server_that_closes_says_so(server, client):
    server.send(frame())
    server.close()
    assert client.next().frame == 12
    with pytest.raises(RobotError, match="has ended"):
        client.next()


def test_a_peer_that_vanishes_is_an_error_and_no_hang():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=_greet_and_leave, args=(listener,)).start()
        client = MotionCaptureClient(listener.getsockname(), timeout=2.0)
        with client, pytest.raises(RobotError, match="went away"):
            client.next()


def _greet_and_leave(listener):
    connection, _ = listener.accept()
    with connection:
        connection.sendall(b'{"format": "nico-motion-capture/1", "markers": ["hand"]}\n')


@pytest.mark.parametrize(
    ("sent", "match"),
    [
        (b"SSH-2.0-OpenSSH\n", "no JSON"),
        (b'{"format": "other/1"}\n', "not nico-motion-capture/1"),
        (b'{"format": "nico-motion-capture/1", "markers": ["hand"]}\n[1]\n', "no frame"),
        (
            b'{"format": "nico-motion-capture/1", "markers": ["hand"]}\n'
            b'{"frame": 1, "time_s": 0}\n',
            "no frame",
        ),
        (
            b'{"format": "nico-motion-capture/1", "markers": ["hand"]}\n'
            b'{"frame": 1, "time_s": 0, "hand": [1, 2]}\n',
            "three numbers",
        ),
    ],
)
def test_whatever_is_no_motion_capture_is_refused(sent, match):
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer():
            connection, _ = listener.accept()
            with connection:
                connection.sendall(sent)

        threading.Thread(target=answer).start()
        with (
            pytest.raises(RobotError, match=match),
            MotionCaptureClient(listener.getsockname(), timeout=2.0) as client,
        ):
            client.next()


def test_silence_is_an_error(client):
    client._connection.settimeout(0.05)
    with pytest.raises(RobotError, match="was silent"):
        client.next()


def test_nobody_there_and_a_port_that_is_taken(server):
    host, port = server.address
    with pytest.raises(RobotError, match="cannot listen"):
        MotionCaptureServer(["hand"], host, port)
    server.close()
    with pytest.raises(RobotError, match="is its server running"):
        MotionCaptureClient((host, port), timeout=0.5)


def test_names_that_are_taken_are_refused():
    with pytest.raises(ValueError, match="other names"):
        MotionCaptureServer(["hand", "frame"])


def test_no_thread_outlives_a_server():
    before = threading.active_count()
    with MotionCaptureServer(["hand", "elbow"]) as server:
        client = MotionCaptureClient(server.address, 2.0)
        server.send(frame())
        assert threading.active_count() > before
        client.close()
    assert threading.active_count() == before


def sending(server, seconds):
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([*POINT, np.nan, np.nan, np.nan]))
    sender = builder.AddSystem(MotionCaptureSender(server, rate=50.0))
    builder.Connect(source.get_output_port(), sender.get_input_port())
    diagram = builder.Build()
    Simulator(diagram).AdvanceTo(seconds)


def test_a_diagram_sends_and_another_receives(server, client):
    sending(server, 0.1)
    receiver = MotionCaptureReceiver(client, rate=100.0)
    simulator = Simulator(receiver)
    simulator.Initialize()
    context = simulator.get_context()
    measured = receiver.GetOutputPort("p_WH_measured").Eval(context)
    assert measured[:3] == pytest.approx(POINT)
    assert np.isnan(measured[3:]).all()
    assert receiver.GetOutputPort("frame_number").Eval(context)[0] >= 0.0


def test_a_diagram_whose_sender_goes_away_stops_with_the_reason(server, client):
    sending(server, 0.0)
    receiver = MotionCaptureReceiver(client, rate=100.0)
    simulator = Simulator(receiver)
    simulator.Initialize()
    server.close()
    with pytest.raises(RobotError, match="has ended"):
        simulator.AdvanceTo(0.1)


def measured(tracker, time, positions):
    context = tracker.CreateDefaultContext()
    context.SetTime(time)
    tracker.get_input_port().FixValue(context, positions)
    return tracker.GetOutputPort("p_WH_measured").Eval(context)


def test_motion_capture_has_a_frame_noise_and_losses_of_its_own():
    X_WB = np.diag([-1.0, -1.0, 1.0, 1.0])
    exact = MotionCapture(["hand"], X_WB=X_WB)
    assert measured(exact, 0.0, POINT) == pytest.approx([-0.1, 0.2, 0.3])
    noisy = MotionCapture(["hand"], sigma=1e-3, dropout_share=0.25, seed=4)
    seen = np.array([measured(noisy, k / 100.0, POINT) for k in range(800)])
    lost = np.isnan(seen).any(axis=1)
    assert lost.mean() == pytest.approx(0.25, abs=0.06)
    assert (seen[~lost] - POINT).std() == pytest.approx(1e-3, rel=0.08)
    assert np.array_equal(measured(noisy, 0.07, POINT), seen[7], equal_nan=True)


@pytest.mark.parametrize("changes", [{"sigma": -1.0}, {"dropout_share": 1.5}, {"rate": 0.0}])
def test_an_instrument_that_cannot_be_is_refused(changes):
    with pytest.raises(ValueError, match="must not be negative"):
        MotionCapture(["hand"], **changes)
    with pytest.raises(ValueError, match="names of their own"):
        MotionCapture([])
