import json
from unittest import mock

import pytest

from nico_selfmodel.cli.result_files import write_with_report
from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.viz.reports.arm import arm_report
from nico_selfmodel.viz.scene.arm_scene import calibration_scene
from nico_selfmodel.viz.scene.scene import load_scene

FILES = {"self_model.yaml", "result.json", "report.html", "residuals.csv", "scene.json"}


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.fixture(scope="module")
def written(tmp_path_factory, calibration, document):
    folder = tmp_path_factory.mktemp("results") / "deep" / "result"
    with mock.patch("nico_selfmodel.viz.figures.plot_style.image_bytes", return_value=b"<svg/>"):
        write_with_report(folder, calibration.model, arm_report(calibration, document))
    return folder


def test_the_folder_holds_everything(written):
    assert names(written) == FILES | {"sweeps_learned.urdf"}
    assert names(written.parent) == {"result"}
    assert "<robot" in (written / "sweeps_learned.urdf").read_text()


def test_the_result_is_the_document_without_nan(written, document):
    def no_constant(word):
        raise AssertionError(word)

    text = (written / "result.json").read_text()
    assert json.loads(text, parse_constant=no_constant) == document


def test_the_self_model_can_be_loaded_from_it(written, calibration):
    model = load_model(written)
    assert model.parameters.values.tolist() == calibration.model.parameters.values.tolist()


def test_the_scene_can_be_drawn_again_without_learning(written, calibration):
    assert load_scene(written).to_json() == calibration_scene(calibration).to_json()
    assert load_scene(written / "scene.json").paths == load_scene(written).paths


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "is empty; expected a result folder with scene"),
        (b"{", "not valid JSON"),
        (b"\xff", "cannot be read"),
    ],
)
def test_a_folder_without_a_scene_is_a_clear_error(tmp_path, content, message):
    if content is not None:
        (tmp_path / "scene.json").write_bytes(content)
    with pytest.raises(ModelError, match=message):
        load_scene(tmp_path)
