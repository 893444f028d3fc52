"""An arm and a board in virtual time, and the byte vectors of the protocol."""

import json
import os
from pathlib import Path

import pytest

from nico_selfmodel.servos import MotorServer, SimulatedBus
from nico_selfmodel.servos.pic_servo.line.board import PicServo
from nico_selfmodel.servos.pic_servo.line.bus import Bus
from nico_selfmodel.servos.pic_servo.line.chain import scan
from nico_selfmodel.servos.pic_servo.simulated.line import PicServoLine
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.simulated.port import SimulatedPort

from .arms import addressed_modules, loop_on, virtual_arm


@pytest.fixture
def virtual():
    """Return an arm in virtual time: connected, enabled, its zero trusted."""
    made = virtual_arm()
    made.arm.connect()
    made.arm.enable()
    return made


@pytest.fixture
def module():
    """Return one simulated module and the driver's side of it."""
    board = SimulatedModule()
    port = SimulatedPort(PicServoLine([board]))
    bus = Bus(port)
    scan(bus, [1])
    servo = PicServo(bus, 1)
    servo.watch()
    return board, servo, port


@pytest.fixture
def bus():
    """Return six boards behind a pseudo-terminal, in real time."""
    with SimulatedBus(addressed_modules(115200)) as simulated:
        yield simulated


@pytest.fixture
def loop(bus):
    """Return the thread of an arm that is enabled."""
    with loop_on(bus) as running:
        yield running


@pytest.fixture
def server(loop):
    """Return a server of that arm."""
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


@pytest.fixture(scope="session")
def published_vectors(project_root):
    """Return the byte vectors of the protocol's description, or skip with the reason."""
    named = os.environ.get("NICO_PICSERVO")
    folder = Path(named) if named else project_root.parent / "shared" / "picservo"
    path = folder / "vectors.json"
    if not path.is_file():
        source = "$NICO_PICSERVO" if named else "no $NICO_PICSERVO, and"
        pytest.skip(f"no byte vectors: {source} {path} is not a file")
    entries = json.loads(path.read_text(encoding="utf-8"))
    return {entry["name"]: bytes.fromhex(entry["hex"]) for entry in entries}
