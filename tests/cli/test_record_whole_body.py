"""`record --head`: a whole Nico, simulated or through its servo bus, as somebody types it."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nico_selfmodel.dataset.body.body_folder import load_body_dataset
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.servos.arm.servo_config_file import save_servo_config
from nico_selfmodel.sessions.rendered_body import RenderedBody
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
from nico_selfmodel.vision.images.image_file import write_image

from .one_line import assert_one_clear_line

SEED = 3


@pytest.fixture(scope="module")
def lenses(tmp_path_factory):
    """Return calibrated cameras, as `calibrate stereo` leaves them."""
    path = tmp_path_factory.mktemp("lenses") / "cameras.yaml"
    pair = dict(zip(("left", "right"), NICO_CAMERAS.cameras, strict=True))
    save_model(SelfModel("cameras", cameras=pair), path)
    return path


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--arms", "right"), "--arms and --room need --head"),
        (("--head",), "--head needs --cameras"),
        (("--head", "--arms", "three"), "no --arms 'three'; there are right, left, both"),
        (("--head", "--circle", 6), "--circle is for one arm"),
        (("--head", "--random", 0, "--circle", 0), "nothing to record"),
        (("--head", "--room", "nowhere.yaml"), "nowhere.yaml"),
        (("--head", "--sensor", "stereo-color"), "leave out --images and --sensor"),
        (("--head", "--port", "nowhere"), "--room is missing"),
        (("--head", "--mirror", "glass=1,2"), "--mirror glass=1,2: expected ID=distance"),
        (("--head", "--mirror", "glass"), "nothing to see in a mirror: an arm must move"),
    ],
)
def test_what_does_not_fit_is_one_clear_line(command, words, said, tmp_path, lenses):
    cameras = () if words == ("--head",) else ("--cameras", lenses)
    words = words if words[0] == "--head" else (*words, "--random", 3)
    if words[0] != "--head":
        cameras = ()
    done = command("record", "--out", tmp_path / "out", *words, *cameras)
    assert_one_clear_line(done, said)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_simulated_head_is_recorded_in_a_room_of_ones_own(
    command, tmp_path, lenses, project_root
):
    room = tmp_path / "room.yaml"
    cards = (project_root / "examples" / "nico_room.yaml").read_text().splitlines()
    room.write_text("\n".join(cards[:-1]) + "\n")  # one card less
    words = ("--head", "--cameras", lenses, "--random", 2, "--seed", SEED, "--room", room)
    done = command("record", "--out", tmp_path / "data", *words)
    assert done.returncode == 0, done.stderr
    data = load_body_dataset(tmp_path / "data")
    assert len(data.joints) == 6
    assert sum(marker.xyz is not None for marker in data.markers) == 24
    assert all(sensor.lens is not None for sensor in data.sensors)


@pytest.mark.slow
def test_a_real_head_and_arm_are_recorded_through_bus_and_cameras(
    command, tmp_path, lenses, project_root
):
    whole = WholeRecording(("right",))
    robot = RenderedBody("thesis", SEED, whole)
    station = robot.station(0)
    angles = whole.plan(0, 1, np.random.default_rng(2))
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    there = whole.commands(station.joints, angles)[0]
    station.GetInputPort("encoders_commanded").FixValue(context, there)
    simulator.AdvanceTo(3.0)
    seen = np.reshape(station.GetOutputPort("pixels").Eval(context), (-1, 2, 2))
    (tmp_path / "seen").mkdir()
    for side in ("left", "right"):
        write_image(tmp_path / f"{side}.jpg", station.picture(context, side))
        for k in range(1800):  # a minute
            (tmp_path / "seen" / f"{side}{k}.jpg").symlink_to(tmp_path / f"{side}.jpg")
    nico = NicoBehindBus(robot.station(1))
    config = tmp_path / "servos.yaml"
    save_servo_config(nico.configuration, config)
    with SimulatedBus(len(nico.configuration.joints), plant=nico) as bus:
        words = ("--port", bus.name, "--config", config)
        homed = command("servo", "home", "--here", "--yes", *words)
        assert homed.returncode == 0, homed.stderr
        room = project_root / "examples" / "nico_room.yaml"
        done = command(
            "record", "--out", tmp_path / "data", *words, "--head", "--arms", "right",
            "--room", room, "--cameras", lenses, "--random", 1, "--yes",
            "--left-camera", tmp_path / "seen", "--right-camera", tmp_path / "seen",
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "data.samples").exists()
    data = load_body_dataset(tmp_path / "data")
    assert [joint.name for joint in data.joints] == list(whole.body.joints)
    names = [marker.name for marker in data.markers]
    table = data.observations
    for row in range(len(table)):
        marker = whole.tracked.index(names[table.marker[row]])
        assert table.values[row][:2] == pytest.approx(seen[marker, table.sensor[row]], abs=1.0)
    assert len(table) >= np.isfinite(seen[:, :, 0]).sum()
