"""What README and examples show is what happens."""

import json
import os
import re
import subprocess
import sys
import time

import pytest

from nico_selfmodel.cli.app import _tree
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.shape.shape_folder import save_shape
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS

from .learned_ball import ball_body

COMMAND = "from nico_selfmodel.cli.main import main; main()"


def run(words, folder, root):
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, *map(str, words)],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        timeout=120,
        check=False,
    )


def python_of_the_readme(project_root):
    text = (project_root / "README.md").read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


@pytest.mark.slow
def test_the_readmes_python_runs(project_root, tmp_path):
    block, _ = python_of_the_readme(project_root)
    assert len([line for line in block.splitlines() if line.strip()]) <= 15
    process = run(["-c", block], tmp_path, project_root)
    assert process.returncode == 0, process.stderr
    assert process.stdout.startswith("PASS")


def test_the_readmes_cameras_see_a_point_before_them(project_root, tmp_path):
    cameras = {"left": NICO_CAMERAS.left, "right": NICO_CAMERAS.right}
    (tmp_path / "cameras").mkdir()
    save_model(SelfModel("cameras", cameras=cameras), tmp_path / "cameras" / "self_model.yaml")
    _, block = python_of_the_readme(project_root)
    process = run(["-c", block + "print(*points.p_WQ[0])"], tmp_path, project_root)
    assert process.returncode == 0, process.stderr
    x, y, z = map(float, process.stdout.split())
    # b f / disparity, the disparity of 40 px a little longer without the lens
    assert z == pytest.approx(0.07 * 381.0 / 40.0, rel=0.02)
    assert abs(x) < 0.05
    assert abs(y) < 0.01


@pytest.mark.slow
def test_the_python_of_what_bends_runs(project_root):
    text = (project_root / "docs" / "bending.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    process = run(["-c", block], project_root, project_root)
    assert process.returncode == 0, process.stderr
    assert process.stdout.startswith("('ripple'")


def test_the_python_of_learned_shapes_runs(project_root, tmp_path):
    text = (project_root / "docs" / "mirror_test.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n([^`]*?load_shape[^`]*?)```", text)
    (tmp_path / "nico").mkdir()
    save_shape(ball_body("head"), tmp_path / "nico" / "body")
    process = run(["-c", block], tmp_path, project_root)
    assert process.returncode == 0, process.stderr
    assert 0.3 < float(process.stdout.split()[0]) < 0.6


def test_links_and_pictures_of_the_documents_exist(project_root):
    for document in [*project_root.glob("*.md"), *project_root.glob("docs/*.md")]:
        text = document.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+)\)", text):
            assert (document.parent / target).exists(), (document.name, target)


def commands_of_the_documents(root):
    """Return the words of every command line that README, documents and examples show."""
    for document in [root / "README.md", *root.glob("docs/*.md"), *root.glob("examples/*.py")]:
        for line in document.read_text(encoding="utf-8").splitlines():
            for words in re.findall(r"nico-selfmodel ([a-z][^`#&)]*)", line):
                yield document.name, words.split()


def test_command_lines_of_the_documents_exist(project_root):
    found = 0
    for document, words in commands_of_the_documents(project_root):
        command = _tree()
        while words and words[0] in getattr(command, "commands", {}):
            command = command.commands[words.pop(0)]
            found += 1
        assert not hasattr(command, "commands") or not words, (document, words)
        options = {name for p in command.params for name in p.opts} | {"--help"}
        assert {word for word in words if word.startswith("--")} <= options, (document, words)
    assert found > 20


@pytest.mark.slow
def test_the_arm_of_the_first_example_is_learned(project_root, tmp_path):
    process = run([project_root / "examples/01_learn_an_arm.py"], tmp_path, project_root)
    assert process.returncode == 0, process.stderr
    assert process.stdout.startswith("PASS")


@pytest.mark.slow
def test_the_plant_of_the_second_example_agrees_with_its_self_model(project_root, tmp_path):
    path = project_root / "examples/02_plant_of_a_learned_arm.py"
    process = run([path], tmp_path, project_root)
    assert process.returncode == 0, process.stderr
    assert float(process.stdout.split()[-1]) < 1e-12


@pytest.mark.slow
def test_the_readmes_first_command_calibrates_a_real_robot_in_a_minute(project_root, tmp_path):
    text = (project_root / "README.md").read_text(encoding="utf-8")
    words = re.search(r"<!-- first command -->.*?(calibrate [^`\n]+)", text, re.DOTALL)[1].split()
    assert words[-2:] == ["--out", "franka"]
    words[-1] = tmp_path / "franka"
    start = time.monotonic()
    done = run(["-c", COMMAND, *words], project_root, project_root)
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - start < 60.0
    document = json.loads((tmp_path / "franka" / "result.json").read_text())
    assert document["status"] == "PASS"
    assert document["test"]["position_mm"]["rms"] <= 1.0
    said = f"{document['test']['position_mm']['mean']:.2f} mm mean error"
    assert said in text
    assert (tmp_path / "franka" / "report.html").is_file()


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("script", "source"),
    [
        ("03_import_franka.py", "franka_fr3/measurements.csv"),
        ("04_import_positioner.py", "positioner_two_axis/measurements.yaml"),
    ],
)
def test_data_in_the_box_are_the_originals_imported(
    script, source, project_root, real_data_folder, tmp_path
):
    path = project_root / "examples" / script
    process = run([path, real_data_folder / source, tmp_path / "data"], tmp_path, project_root)
    assert process.returncode == 0, process.stderr
    kept = project_root / "examples" / "data" / source.split("/")[0]
    assert (kept / "LICENSE").read_bytes() == (real_data_folder / source).with_name(
        "LICENSE"
    ).read_bytes()
    for name in ("dataset.yaml", "samples.csv"):
        assert (kept / name).read_bytes() == (tmp_path / "data" / name).read_bytes()


@pytest.mark.slow
def test_real_measurements_are_learned(project_root, tmp_path, command):
    data = project_root / "examples" / "data" / "positioner_two_axis"
    done = command("calibrate", "kinematics", data, "--out", tmp_path / "result", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["test"] is None
    assert document["train"]["position_mm"]["rms"] <= 0.405
