import json
import os
import subprocess
import sys

import numpy as np
import pytest

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import content_hash, load_dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.result_folder.writing import (
    replace_document,
    urdf_file,
    urdf_name,
    write_result,
)

DOCUMENT = {"status": "PASS", "value": 0.1}
WRITTEN = {"self_model.yaml", "result.json", "lamp_learned.urdf"}
WITHOUT_PICTURES = """
import sys
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.result_folder.writing import write_result
model = load_model({old!r})
write_result({new!r}, model, {{"status": "PASS"}})
assert load_model({new!r}).name == model.name
print(*sorted({{"matplotlib", "jinja2", "meshcat"}} & set(sys.modules)))
"""


def names(folder):
    return {path.name for path in folder.iterdir()}


@pytest.fixture
def model():
    axes, feet = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), np.array([[0, 0, 0], [0, 0, 0.1]])
    chain = Chain(("pan", "tilt"), axes, feet, ("lamp",), np.array([[0.3, 0.0, 0.1]]))
    zero, one = np.zeros(2), np.ones(2)
    servos = ServoMap(("pan", "tilt"), zero, one, ("rad", "rad"), np.full(2, np.nan), one)
    return SelfModel("lamp", DhTable.from_chain(chain), servos)


def test_a_model_is_saved_and_loaded_without_a_plot_library(model, tmp_path):
    old, new = tmp_path / "old", tmp_path / "new"
    write_result(old, model, DOCUMENT)
    code = WITHOUT_PICTURES.format(old=str(old), new=str(new))
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=os.environ
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
    assert names(new) == WRITTEN


def test_what_is_handed_in_lies_beside_model_and_document(model, tmp_path):
    q = np.zeros((2, 2))
    joints = (JointInfo("pan", "rad"), JointInfo("tilt", "rad"))
    data = Dataset("poses", joints, np.arange(2), q, np.ones((2, 3)))
    folder = write_result(tmp_path / "a" / "b", model, DOCUMENT, {"x.txt": "é\n"}, {"train": data})
    assert names(folder) == WRITTEN | {"x.txt", "recordings"}
    assert json.loads((folder / "result.json").read_text()) == DOCUMENT
    assert (folder / "x.txt").read_bytes() == "é\n".encode()
    assert content_hash(load_dataset(folder / "recordings" / "train")) == content_hash(data)


def test_a_robots_name_cannot_lead_out_of_the_folder(model, tmp_path):
    assert urdf_name("../../my robot") == "my_robot_learned.urdf"
    assert urdf_name("///") == "robot_learned.urdf"
    assert set(urdf_file(model, tmp_path, None)) == {"lamp_learned.urdf"}


def test_an_existing_folder_is_kept_unless_forced(model, tmp_path):
    folder = tmp_path / "result"
    folder.mkdir()
    (folder / "result.json").write_text("{}")
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="exists already"):
        write_result(folder, model, DOCUMENT)
    assert names(folder) == {"notes.txt", "result.json"}
    write_result(folder, model, DOCUMENT, force=True)
    assert names(folder) == WRITTEN


@pytest.mark.parametrize("document", [DOCUMENT, {"value": float("nan")}])
def test_a_failure_on_the_way_leaves_nothing_new(model, tmp_path, monkeypatch, document):
    def fail(*_args, **_kwargs):
        raise OSError("disk full")

    if document is DOCUMENT:
        monkeypatch.setattr("nico_selfmodel.result_folder.writing.save_model", fail)
    old = tmp_path / "old"
    old.mkdir()
    (old / "result.json").write_text("{}")
    for folder, force in ((tmp_path / "new", False), (old, True)):
        with pytest.raises((OSError, ValueError), match=r"disk full|JSON"):
            write_result(folder, model, document, force=force)
    assert names(tmp_path) == {"old"}
    assert names(old) == {"result.json"}


def test_a_document_is_replaced_whole(model, tmp_path):
    folder = write_result(tmp_path / "result", model, DOCUMENT)
    replace_document(folder, {"status": "FAIL"})
    assert json.loads((folder / "result.json").read_text()) == {"status": "FAIL"}
    assert names(folder) == WRITTEN
