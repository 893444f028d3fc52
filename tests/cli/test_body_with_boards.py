"""`calibrate body --boards`: photographs of a board tell the lenses of any body's cameras."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.body.boards import with_boards
from nico_selfmodel.dataset.body.body_folder import save_body_dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_model import load_body

from ..drawn_boards import drawn, sight_lines
from ..estimation.boards_in_hand import shape_mm
from ..estimation.simulated_trees import two_arms


@pytest.fixture(scope="module")
def arms():
    return two_arms(4, poses=50, torso=0)


def without_lenses(data):
    sensors = tuple(replace(s, lens=None) for s in data.sensors)
    return replace(data, name="arms", sensors=sensors)


@pytest.fixture(scope="module")
def folders(arms, tmp_path_factory):
    """The recording, and photographs of boards in a folder for each camera."""
    made, rng = tmp_path_factory.mktemp("boards"), np.random.default_rng(0)
    save_body_dataset(without_lenses(arms.data), made / "arms")
    facing = transform(rotation_from_vector([0.0, -np.pi / 2, 0.0]), [0.95, 0.0, 0.4])
    for camera in ("camera1", "camera2"):
        (made / "photographs" / camera).mkdir(parents=True)
    cameras = [arms.tree.camera(name) for name in ("camera1", "camera2")]
    lines = [sight_lines(camera) for camera in cameras]
    for view in range(14):
        turn = rotation_from_vector(rng.normal([0.0, 0.0, np.pi / 2], 0.3))
        X = facing @ transform(turn, rng.uniform(-0.08, 0.08, 3))
        for camera, line in zip(cameras, lines, strict=True):
            picture = drawn(camera, line, X, rng=rng)
            name = "camera1" if camera is cameras[0] else "camera2"
            cv2.imwrite(str(made / "photographs" / name / f"{view:02d}.png"), picture)
    return made


@pytest.mark.slow
def test_lenses_that_nothing_else_tells_are_learned_with_the_arms(arms, folders, command):
    out = folders / "out"
    done = command(
        *("calibrate", "body", folders / "arms", "--boards", folders / "photographs"),
        *("--board", "7x5", "--square-mm", "30", "--effects", "none", "--test-fraction", "0.2"),
        *("--out", out),
    )
    assert done.returncode == 0, done.stderr
    told = json.loads((out / "result.json").read_text())
    assert told["status"] == "PASS"
    assert told["scale_from"] == "markers at known places"
    assert told["parameters"]["camera1.fx"]["value"] == pytest.approx(600.0, abs=4.0)
    body = load_body(out / "body.yaml")
    assert "board" not in body.tree.joints
    assert shape_mm(body.tree, arms.tree) < 3.0
    assert command("evaluate", out, folders / "arms").returncode == 0


@pytest.mark.slow
def test_without_boards_the_lens_is_asked_for(folders, command):
    done = command("calibrate", "body", folders / "arms", "--out", folders / "none")
    assert done.returncode == 2
    assert "nothing tells the lens of camera 'camera1'" in done.stderr
    assert not (folders / "none").exists()


def views(cameras=("camera1", "camera2"), size=(640, 480)):
    rng = np.random.default_rng(1)
    corners = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.1, 0.1, 0.0]])
    pixels = rng.uniform(0.0, 400.0, (3, 4, 2 * len(cameras)))
    pixels[1, 2, :2] = np.nan
    return BoardViews(corners, ("a", "b", "c"), cameras, pixels, (size,) * len(cameras))


def test_boards_stand_behind_a_recording_with_every_corner_that_was_seen(arms):
    data, seen = arms.data, views()
    both = with_boards(data, seen)
    assert both.joint_names == (*data.joint_names, "board")
    assert len(both.sample) == len(data.sample) + 3
    assert len(both.observations) == len(data.observations) + 3 * 4 * 2 - 1
    row = len(data.observations) + 23 - 2
    table = both.observations
    corner = table.marker[row] - len(data.markers)
    at = 2 * table.sensor[row]
    expected = seen.pixels[table.pose[row] - len(data.sample), corner, at : at + 2]
    assert table.values[row, :2].tolist() == expected.tolist()


@pytest.mark.parametrize(
    ("seen", "match"),
    [
        (views(("front",)), "photographed by front.* has the cameras camera1, camera2"),
        (views(size=(320, 240)), "320 x 240 px, camera 'camera1' .* has 640 x 480"),
    ],
)
def test_boards_of_other_cameras_are_refused(arms, seen, match):
    with pytest.raises(DataError, match=match):
        with_boards(arms.data, seen)


def test_cameras_that_move_with_a_joint_are_refused(arms):
    moving = tuple(replace(s, on="left1") for s in arms.data.sensors)
    with pytest.raises(DataError, match="move with a joint"):
        with_boards(replace(arms.data, sensors=moving), views())


def test_a_second_board_is_refused(arms):
    with pytest.raises(DataError, match="has a joint called 'board' already"):
        with_boards(with_boards(arms.data, views()), views())
