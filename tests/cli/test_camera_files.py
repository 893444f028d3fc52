"""`export cameras` and `import cameras`, as somebody types them."""

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import load_model, save_model

from .one_line import assert_one_clear_line

CAMERA = Camera(610.0, 612.0, 320.0, 240.0, (640, 480), k1=-0.2)


@pytest.fixture
def model(tmp_path):
    X_WR = np.eye(4)
    X_WR[0, 3] = 0.1
    right = CAMERA.at(X_WR)
    save_model(SelfModel("pair", cameras={"left": CAMERA, "right": right}), tmp_path / "a.yaml")
    return tmp_path / "a.yaml"


@pytest.mark.parametrize("kind", ["opencv", "opencv-json", "ros", "kalibr", "mrcal"])
def test_there_and_back(command, model, tmp_path, kind):
    done = command("export", "cameras", model, "--format", kind, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    files = sorted((tmp_path / "out").iterdir())
    assert str(files[0]) in done.stdout
    back = command("import", "cameras", *files, "--out", tmp_path / "back")
    assert back.returncode == 0, back.stderr
    found, truth = load_model(tmp_path / "back").rig, load_model(model).rig
    assert found.values == pytest.approx(truth.values, abs=1e-12)


def test_what_is_wrong_is_one_line(command, model, tmp_path):
    words = ("export", "cameras", model, "--out", tmp_path / "out", "--format")
    assert_one_clear_line(command(*words, "tum"), "no format 'tum'", "opencv")
    nothing = command("import", "cameras", tmp_path / "no.yaml", "--out", tmp_path / "out")
    assert_one_clear_line(nothing, "there is no such file")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_recordings_take_cameras_with_a_fisheye(command, tmp_path):
    X = np.eye(4)
    X[0, 3] = 0.1
    eye = Camera(150.0, 150.0, 160.0, 120.0, (320, 240), k4=1e-3, lens="fisheye")
    save_model(SelfModel("wide", cameras={"left": eye, "right": eye.at(X)}), tmp_path / "eyes.yaml")
    out = tmp_path / "out"
    words = ("record", "--sensor", "stereo-color", "--circle", "0", "--random", "8")
    done = command(*words, "--cameras", tmp_path / "eyes.yaml", "--out", out)
    assert done.returncode == 0, done.stderr
    assert len(load_dataset(out)) >= 4
