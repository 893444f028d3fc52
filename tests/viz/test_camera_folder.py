import json

import numpy as np
import pytest

from nico_selfmodel.cli.result_files import write_with_report
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.viz.reports.cameras import camera_report
from nico_selfmodel.viz.scene.camera_scene import camera_scene
from nico_selfmodel.viz.scene.scene import load_scene

FILES = {"self_model.yaml", "result.json", "report.html", "residuals.csv", "scene.json"}


@pytest.fixture
def write(monkeypatch):
    """Return a function that writes a result without drawing its figures."""
    monkeypatch.setattr("nico_selfmodel.viz.figures.plot_style.image_bytes", lambda *_: b"<svg/>")

    def written(folder, assessment, document=None, images=None, force=False):
        model = assessment.calibration.self_model("cameras")
        document = document or to_json(assessment, judge(assessment))
        report = camera_report(assessment, document, images, model)
        write_with_report(folder, model, report, force=force)
        return folder

    return written


def test_the_folder_holds_everything_and_comes_back(tmp_path, write, cameras, photographs):
    folder = write(tmp_path / "deep" / "result", cameras, images=photographs)
    assert {path.name for path in folder.iterdir()} == FILES
    result = json.loads((folder / "result.json").read_text())
    assert result == to_json(cameras, judge(cameras))
    rig = load_model(folder).rig
    assert rig.values.tolist() == cameras.calibration.rig.values.tolist()
    scene = camera_scene(cameras, photographs, name="cameras")
    assert load_scene(folder).to_json() == scene.to_json()


@pytest.mark.slow
def test_what_else_is_known_is_kept_in_the_result(tmp_path, write, one_camera):
    document = to_json(one_camera, judge(one_camera)) | {"more": 1}
    folder = write(tmp_path / "result", one_camera, document=document)
    assert json.loads((folder / "result.json").read_text())["more"] == 1
    assert set(load_model(folder).cameras) == {"right"}


@pytest.mark.slow
def test_an_existing_folder_is_kept_unless_forced_and_a_failure_leaves_nothing(
    tmp_path, write, one_camera
):
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "result.json").write_text("{}")
    with pytest.raises(FileExistsError, match="exists already"):
        write(folder, one_camera)
    wrong = {"right": {one_camera.calibration.views.names[0]: np.zeros((3, 3), dtype=np.uint8)}}
    with pytest.raises(ValueError, match="calibrated for"):
        write(folder, one_camera, images=wrong, force=True)
    assert (folder / "result.json").read_text() == "{}"
    assert {path.name for path in tmp_path.iterdir()} == {"result"}
