"""A result folder that was renamed, copied, sent away: every command takes it."""

import json
import re
import shutil

import pytest
import yaml

from nico_selfmodel import __version__
from nico_selfmodel.model.self_model_file import load_model, save_model
from nico_selfmodel.plant import ArmDescription

CHAIN = ("--base", "foot", "--tip", "tip")
MESH = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n"


@pytest.fixture(scope="module")
def robot(tmp_path_factory, project_root):
    """Return the URDF of the example with a mesh in a folder beside it."""
    text = (project_root / "examples" / "07_your_own_urdf_arm.py").read_text(encoding="utf-8")
    found = {}
    exec(text.partition("with tempfile")[0], found)
    folder = tmp_path_factory.mktemp("robot")
    (folder / "meshes").mkdir()
    (folder / "meshes" / "turret.obj").write_text(f"mtllib turret.mtl\n{MESH}")
    (folder / "meshes" / "turret.mtl").write_text("newmtl grey\n")
    (folder / "urdf").mkdir()
    visual = '<visual><geometry><mesh filename="../meshes/turret.obj"/></geometry></visual></link>'
    urdf = folder / "urdf" / "three.urdf"
    urdf.write_text(re.sub(r'(name="turret">.*?)</link>', rf"\1{visual}", found["URDF"], flags=16))
    return urdf


@pytest.fixture(scope="module")
def moved(tmp_path_factory, robot, command):
    """Return a result and data that are not where they were made; the robot's file is gone."""
    made, other = tmp_path_factory.mktemp("made"), tmp_path_factory.mktemp("elsewhere")
    recorded, result = made / "recorded", made / "result"
    simulated = ("simulate", "motion-capture", "--robot", robot, *CHAIN, "--random", 40)
    assert command(*simulated, "--out", recorded).returncode == 0
    words = ("calibrate", "kinematics", recorded, "--robot", robot, *CHAIN, "--test-fraction", 0.3)
    done = command(*words, "--out", result)
    assert done.returncode == 0, done.stdout + done.stderr
    shutil.copytree(made, other / "my data")
    shutil.rmtree(made)
    shutil.rmtree(robot.parents[1])
    return other / "my data" / "result", other / "my data" / "recorded"


@pytest.mark.parametrize(
    "words",
    [
        ("predict", "MODEL", "--encoders", "0,0,0"),
        ("evaluate", "MODEL", "DATA"),
        ("monitor", "MODEL", "DATA"),
        ("choose-poses", "MODEL", "DATA", "--count", "2", "--out", "poses.csv"),
        ("export-urdf", "MODEL", "--out", "arm.urdf"),
        ("view", "MODEL", "--out", "scene.html"),
        ("rezero", "MODEL", "DATA", "--out", "zeros"),
        pytest.param(
            ("calibrate", "kinematics", "DATA", "--robot", "URDF", *CHAIN, "--out", "again"),
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda words: words[0],
)
def test_commands_work_with_a_result_that_was_moved(words, moved, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    (urdf,) = (moved[0] / "robot").glob("*.urdf")
    places = {"MODEL": moved[0], "DATA": moved[1], "URDF": urdf}
    done = command(*(places.get(word, word) for word in words))
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_description_and_its_meshes_lie_in_the_folder(moved):
    result, _ = moved
    kept = yaml.safe_load((result / "self_model.yaml").read_text())["robot"]["urdf"]
    assert kept == "./robot/three.urdf"
    assert {path.name for path in (result / "robot" / "meshes").iterdir()} == {
        *("turret.obj", "turret.mtl")
    }
    assert 'filename="meshes/turret.obj"' in (result / kept).read_text()
    learned = (result / "three_learned.urdf").read_text()
    assert 'filename="robot/meshes/turret.obj"' in learned
    assert "none was invented" in learned


def test_no_file_of_a_result_tells_where_it_was_made(moved):
    for name in ("self_model.yaml", "three_learned.urdf", "scene.json"):
        assert "made" not in (moved[0] / name).read_text(), name


def test_a_model_that_leads_beside_itself_is_saved_so_again(moved, tmp_path):
    model = load_model(moved[0])
    again = moved[0] / "again.yaml"
    save_model(model, again)
    assert again.read_bytes() == (moved[0] / "self_model.yaml").read_bytes()
    again.unlink()
    save_model(model, tmp_path / "far.yaml")
    assert load_model(tmp_path / "far.yaml").robot["urdf"] == model.robot["urdf"]
    assert ArmDescription.of_model(model).urdf == moved[0] / "robot" / "three.urdf"


def test_a_result_tells_its_day_command_and_version_and_the_model_does_not(moved):
    run = json.loads((moved[0] / "result.json").read_text())["run"]
    assert run["command"].startswith("nico-selfmodel calibrate kinematics ")
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", run["date"])
    assert run["version"] == __version__
    model = load_model(moved[0])
    assert model.provenance["dataset"] == "recorded"
    assert not {"date", "command", "run"} & set(model.provenance)


def test_the_version_is_told(command):
    done = command("--version")
    assert (done.returncode, done.stdout) == (0, f"nico-selfmodel {__version__}\n")


@pytest.mark.slow
def test_an_export_without_a_robot_names_the_masses_that_it_invented(recorded, tmp_path, command):
    result = tmp_path / "result"
    assert command("calibrate", "kinematics", recorded[0], "--out", result).returncode == 0
    done = command("export-urdf", result, "--out", tmp_path / "arm.urdf")
    joints = load_model(result).joints
    for text in (done.stdout, (tmp_path / "arm.urdf").read_text()):
        words = " ".join(text.split())
        assert f"of {', '.join(f'{joint}_link' for joint in joints)} are invented" in words
