import json
from unittest import mock

import pytest

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model import SelfModel
from nico_selfmodel.viz import calibration_scene, load_scene, result_folder, write_result_folder

FILES = {"self_model.yaml", "result.json", "report.html", "scene.json"}


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.fixture(scope="module")
def written(tmp_path_factory, calibration, verdict):
    folder = tmp_path_factory.mktemp("results") / "deep" / "result"
    with mock.patch("nico_selfmodel.viz.report.svg_data_uri", return_value="data:,"):
        return write_result_folder(
            folder, calibration, verdict, urdf_text="<robot/>", robot_name="nico"
        )


def test_the_folder_holds_everything(written):
    assert names(written) == FILES | {"nico_learned.urdf"}
    assert names(written.parent) == {"result"}
    assert (written / "nico_learned.urdf").read_text() == "<robot/>"


def test_the_result_is_the_document_without_nan(written, document):
    def no_constant(word):
        raise AssertionError(word)

    text = (written / "result.json").read_text()
    assert json.loads(text, parse_constant=no_constant) == document


def test_the_self_model_can_be_loaded_from_it(written, calibration):
    model = SelfModel.load(written)
    assert model.parameters.values.tolist() == calibration.model.parameters.values.tolist()


def test_the_scene_can_be_drawn_again_without_learning(written, calibration):
    assert load_scene(written).to_json() == calibration_scene(calibration).to_json()
    assert load_scene(written / "scene.json").paths == load_scene(written).paths


@pytest.fixture
def short_report(monkeypatch):
    """Spare the pages that a test does not look at."""
    monkeypatch.setattr(result_folder, "report_html", lambda *_: "<!doctype html>")


@pytest.mark.usefixtures("short_report")
def test_without_a_robot_there_is_no_urdf(tmp_path, circles_alone, verdict):
    folder = write_result_folder(tmp_path / "result", circles_alone, verdict)
    assert names(folder) == FILES


@pytest.mark.usefixtures("short_report")
def test_a_robots_name_cannot_lead_out_of_the_folder(tmp_path, circles_alone, verdict):
    folder = write_result_folder(
        tmp_path / "result", circles_alone, verdict, urdf_text="x", robot_name="../../my robot"
    )
    assert names(folder) - FILES == {"my_robot_learned.urdf"}


@pytest.mark.usefixtures("short_report")
def test_an_existing_folder_is_kept_unless_forced(tmp_path, circles_alone, verdict):
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "result.json").write_text("{}")
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="exists already"):
        write_result_folder(folder, circles_alone, verdict)
    assert names(folder) == {"notes.txt", "result.json"}
    write_result_folder(folder, circles_alone, verdict, force=True)
    assert names(folder) == FILES


@pytest.mark.usefixtures("short_report")
@pytest.mark.parametrize("broken", ["report_html", "calibration_scene", "save"])
def test_a_failure_on_the_way_leaves_nothing_new(
    tmp_path, circles_alone, verdict, monkeypatch, broken
):
    def fail(*_args, **_kwargs):
        raise OSError("disk full")

    if broken == "save":
        monkeypatch.setattr(SelfModel, "save", fail)
    else:
        monkeypatch.setattr(result_folder, broken, fail)
    old = tmp_path / "old"
    old.mkdir()
    (old / "result.json").write_text("{}")
    for folder, force in ((tmp_path / "new", False), (old, True)):
        with pytest.raises(OSError, match="disk full"):
            write_result_folder(folder, circles_alone, verdict, force=force)
    assert names(tmp_path) == {"old"}
    assert names(old) == {"result.json"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "does not exist: give the folder"),
        (b"{", "not valid JSON"),
        (b"\xff", "cannot be read"),
    ],
)
def test_a_folder_without_a_scene_is_a_clear_error(tmp_path, content, message):
    if content is not None:
        (tmp_path / "scene.json").write_bytes(content)
    with pytest.raises(ModelError, match=message):
        load_scene(tmp_path)
