import json

from nico_selfmodel.cli.result_files import write_with_report
from nico_selfmodel.estimation.judging import judge, to_json
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.viz.reports.cameras import camera_report
from nico_selfmodel.viz.scene.camera_scene import camera_scene
from nico_selfmodel.viz.scene.scene import load_scene

FILES = {"self_model.yaml", "result.json", "report.html", "residuals.csv", "scene.json"}


def test_the_folder_holds_everything_and_comes_back(tmp_path, monkeypatch, cameras, photographs):
    monkeypatch.setattr("nico_selfmodel.viz.figures.plot_style.image_bytes", lambda *_: b"<svg/>")
    folder, model = tmp_path / "deep" / "result", cameras.calibration.self_model("cameras")
    document = to_json(cameras, judge(cameras))
    write_with_report(folder, model, camera_report(cameras, document, photographs, model))
    assert {path.name for path in folder.iterdir()} == FILES
    assert json.loads((folder / "result.json").read_text()) == document
    rig = load_model(folder).rig
    assert rig.values.tolist() == cameras.calibration.rig.values.tolist()
    scene = camera_scene(cameras, photographs, name="cameras")
    assert load_scene(folder).to_json() == scene.to_json()
