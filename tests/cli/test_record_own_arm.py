"""`record --port --robot`: an arm of one's own on servos of any make, under motion capture."""

import threading

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.systems.hardware.motion_capture_stream import MarkerFrame, MotionCaptureServer

from .one_line import assert_one_clear_line

JOINT = """
  - {{name: {name}, address: {address}, lower_deg: -60, upper_deg: 60, max_velocity_deg_s: 120,
     max_acceleration_deg_s2: 480}}"""


@pytest.fixture
def urdf(project_root):
    return project_root / "examples" / "six_axis.urdf"


@pytest.fixture
def config(urdf, tmp_path):
    pytest.importorskip("scservo_sdk")
    arm = ArmDescription.from_urdf(urdf, tip_link="tool0")
    joints = "".join(JOINT.format(name=name, address=k + 1) for k, name in enumerate(arm.joints))
    path = tmp_path / "servos.yaml"
    head = "format: nico-servos/1\nname: own\nmake: feetech\nbaud: 1000000\n"
    path.write_text(f"{head}joints:{joints}\n")
    return path


@pytest.fixture
def watched(urdf):
    """Return the words that name a six-axis arm on simulated servos, and what tracks it."""
    pytest.importorskip("scservo_sdk")
    chain = ArmDescription.from_urdf(urdf, tip_link="tool0").chain
    done = threading.Event()
    with SimulatedBus(6, make="feetech") as bus, MotionCaptureServer(("tip",)) as server:

        def send():
            number = 0
            while not done.wait(0.02):
                q = (np.array(bus.shafts()) - 2048) * 2.0 * np.pi / 4096
                number += 1
                server.send(MarkerFrame(number, 0.02 * number, {"tip": chain.forward(q)}))

        thread = threading.Thread(target=send)
        thread.start()
        host, port = server.address
        tracker = ("--sensor", "motion-capture", "--motion-capture", f"{host}:{port}")
        yield ("--port", bus.name, *tracker)
        done.set()
        thread.join()


@pytest.mark.slow
def test_an_arm_of_ones_own_is_recorded_and_learned(command, watched, config, urdf, tmp_path):
    words = ("record", "--out", tmp_path / "own", *watched, "--config", config, "--yes")
    plan = ("--circle", 0, "--random", 25, "--speed-deg-s", 120)
    made = command(*words, *plan, "--robot", urdf, "--tip", "tool0")
    assert made.returncode == 0, made.stderr
    data = load_dataset(tmp_path / "own")
    assert data.source.startswith("six_axis, servos 'own'")
    assert len(data.samples) == 25
    assert data.approach[1:].all()
    assert np.ptp(data.encoders, axis=0) == pytest.approx(4096 / 3, rel=0.3)
    learned = calibrate_kinematics(data, explain=False)
    assert learned.cross_validation.mean() < 2e-3


def test_what_does_not_fit_is_refused(command, watched, config, urdf, tmp_path):
    words = ("record", "--out", tmp_path / "own", *watched, "--config", config, "--yes")
    assert_one_clear_line(command(*words, "--tip", "tool0"), "need --robot")
    other = ("--robot", "nico", "--arm", "right_arm")
    assert_one_clear_line(command(*words, *other), "the servo configuration has no right_shoulder")
    cameras = ("record", "--out", tmp_path / "own", *watched[:2], "--config", config, "--yes")
    own = ("--robot", urdf, "--tip", "tool0", "--left-camera", 0, "--right-camera", 1)
    assert_one_clear_line(command(*cameras, *own), "cameras watch Nico's arm")
    assert_one_clear_line(
        command("record", "--out", "x", "--robot", urdf), "--robot: for a real robot"
    )
    assert not (tmp_path / "own").exists()
