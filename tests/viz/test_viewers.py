"""Both viewers draw every kind of item, at the same paths."""

import base64
import logging
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
import zmq
from pydrake.geometry import Meshcat, MeshcatParams

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.viz.live.drake_backend import draw_in_drake
from nico_selfmodel.viz.live.live_page import LivePage, opened, recorded
from nico_selfmodel.viz.live.meshcat_backend import publish
from nico_selfmodel.viz.scene.arm_scene import calibration_scene
from nico_selfmodel.viz.scene.scene import ROOT, Camera, Scene

from .every_item import every_item


@pytest.fixture(scope="module")
def everything():
    camera = Camera(np.array([2.0, -1.0, 1.0]), np.array([0.1, 0.2, 0.3]))
    return Scene("everything", every_item(), camera)


@pytest.fixture(scope="module")
def learned(calibration):
    return calibration_scene(calibration)


@pytest.mark.parametrize("which", ["everything", "learned"])
def test_drake_has_every_path(which, request):
    scene = request.getfixturevalue(which)
    meshcat = draw_in_drake(scene)
    assert [path for path in scene.paths if not meshcat.HasPath(f"{ROOT}/{path}")] == []


def test_a_second_scene_replaces_the_first(everything, learned):
    meshcat = draw_in_drake(everything)
    assert draw_in_drake(learned, meshcat) is meshcat
    assert not meshcat.HasPath(f"{ROOT}/points")
    assert meshcat.HasPath(f"{ROOT}/arm")


def test_drake_listens_on_this_machine_only_and_keeps_quiet(everything, caplog, capfd):
    with caplog.at_level(logging.INFO):
        meshcat = draw_in_drake(everything)
    assert meshcat.web_url().startswith("http://localhost:")
    assert caplog.records == []
    assert capfd.readouterr() == ("", "")


def draw_commands(page):
    """Return the paths of all objects in the page of a meshcat server."""
    from meshcat.visualizer import umsgpack

    found = set()
    for blob in re.findall(r'base64,([A-Za-z0-9+/=]+)"', page):
        try:
            command = umsgpack.unpackb(base64.b64decode(blob))
        except umsgpack.UnpackException:
            continue
        if isinstance(command, dict) and command.get("type") == "set_object":
            found.add(command["path"].removesuffix("/<object>"))
    return found


@pytest.fixture(scope="module")
def server():
    """Run a meshcat server, and return its ZMQ address."""
    command = [sys.executable, "-u", "-m", "meshcat.servers.zmqserver"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, encoding="utf-8"
    )
    with process:
        url = ""
        while not url.startswith("zmq_url="):
            url = process.stdout.readline()
            assert url or process.poll() is None, "the server did not start"
        yield url.strip().removeprefix("zmq_url=")
        process.terminate()


def page_of(url):
    with zmq.Context() as context, context.socket(zmq.REQ) as socket:
        socket.setsockopt(zmq.RCVTIMEO, 5000)
        socket.connect(url)
        socket.send(b"get_scene")
        return socket.recv().decode()


@pytest.mark.parametrize("which", ["everything", "learned"])
def test_a_meshcat_server_gets_the_same_paths(server, which, request, capfd):
    scene = request.getfixturevalue(which)
    assert publish(scene, server).startswith("http://127.0.0.1:")
    assert capfd.readouterr() == ("", "")
    drawn = {path.removeprefix(f"{ROOT}/") for path in draw_commands(page_of(server))}
    # Cylinders and capsules are put together from several objects there.
    whole = {path for path in scene.paths if any((d + "/").startswith(path + "/") for d in drawn)}
    assert whole == set(scene.paths)
    strays = {d for d in drawn if not any((d + "/").startswith(p + "/") for p in scene.paths)}
    assert {stray for stray in strays if not stray.startswith("/Cameras")} == set()


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("tcp://127.0.0.1:1", "no meshcat server answers at tcp://127.0.0.1:1: start one"),
        ("127.0.0.1", "'127.0.0.1' is not an address"),
        ("", "is not an address"),
    ],
)
def test_no_server_is_a_clear_error_within_seconds(everything, url, message):
    began = time.monotonic()
    with pytest.raises(SelfModelError, match=message):
        publish(everything, url, timeout=1.0)
    assert time.monotonic() - began < 5.0


@pytest.fixture
def impostor():
    """Run something else that speaks ZMQ: it gives the answers it is told to, then none."""
    context = zmq.Context()
    socket = context.socket(zmq.REP)
    socket.setsockopt(zmq.LINGER, 0)
    port = socket.bind_to_random_port("tcp://127.0.0.1")
    answers = []

    def serve():
        try:
            for answer in answers:
                socket.recv_multipart()
                socket.send(answer)
        except zmq.ZMQError:  # the test is over
            pass

    thread = threading.Thread(target=serve)

    def start(*given):
        answers.extend(given)
        thread.start()
        return f"tcp://127.0.0.1:{port}"

    yield start
    context.destroy(linger=0)
    thread.join()


def test_a_server_that_answers_something_else_is_named(everything, impostor):
    with pytest.raises(SelfModelError, match="is not a meshcat server: it answered 'hello'"):
        publish(everything, impostor(b"hello"), timeout=2.0)


def test_a_server_that_refuses_a_command_is_an_error(everything, impostor):
    with pytest.raises(SelfModelError, match="answered b'error: no'"):
        publish(everything, impostor(b"http://x", b"ok", b"error: no"), timeout=2.0)


def test_a_server_that_dies_on_the_way_is_an_error_and_no_hang(everything, impostor):
    with pytest.raises(SelfModelError, match="no meshcat server answers"):
        publish(everything, impostor(b"http://x", b"ok"), timeout=0.5)


def test_the_live_page_is_drakes_own_with_its_sliders_open_and_hands_on_the_rest():
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    with LivePage(meshcat) as page:
        assert page.url.startswith("http://localhost:")

        def read(path):
            with urllib.request.urlopen(page.url + path, timeout=10.0) as answer:
                return answer.read().decode("utf-8")

        shown = read("/")
        assert f'url = "{meshcat.web_url()}/";' in shown
        assert "viewer.gui.open();" in shown
        assert shown.index("viewer.gui.open();") > shown.index("make_connection(url")
        (script,) = re.findall(r'src="([^"]*)"', shown)[:1]
        assert "MeshCat" in read(f"/{script}")
        with pytest.raises(urllib.error.HTTPError, match="404"):
            read("/nothing")
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(page.url, timeout=10.0)


def test_a_page_that_it_was_not_made_for_stays_as_it_is():
    assert opened("<p>other</p>", "http://localhost:7000") == "<p>other</p>"
    assert recorded("<p>other</p>") == "<p>other</p>"


def test_a_reader_that_leaves_before_it_has_everything_is_nothing_to_tell(capfd):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    with LivePage(meshcat) as page:
        with urllib.request.urlopen(page.url, timeout=10.0) as answer:
            (script,) = re.findall(r'src="([^"]*)"', answer.read().decode("utf-8"))[:1]
        with socket.create_connection(("127.0.0.1", int(page.url.rpartition(":")[2]))) as gone:
            gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            gone.sendall(f"GET /{script} HTTP/1.0\r\n\r\n".encode())
            gone.recv(10)
        with urllib.request.urlopen(page.url, timeout=10.0) as answer:
            assert answer.status == 200
    assert "Traceback" not in capfd.readouterr().err


def test_a_recorded_page_shows_narrow_windows_all_of_the_scene():
    page = recorded("<html><head></head><body>scene</body></html>")
    assert page.index("width=device-width") < page.index("scene") < page.index("camera.zoom = zoom")
