"""The commands of any body, as a user types them: what works, and what is refused in one line."""

import csv
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import yaml

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.tree.body_model import BodyModel, load_body, save_body

from ..estimation.simulated_trees import one_arm
from ..estimation.test_one_problem import flange_dataset, hand_eye_poses
from .one_line import assert_one_clear_line


@pytest.fixture(scope="module")
def folder(tmp_path_factory, project_root):
    made = tmp_path_factory.mktemp("any_body")
    example = (project_root / "examples" / "15_two_arms_two_cameras.py").read_text()
    assert "POSES, TAGS, FOCAL = 80" in example
    fewer = example.replace("POSES, TAGS, FOCAL = 80", "POSES, TAGS, FOCAL = 40")
    words = [sys.executable, "-c", fewer, made / "two_arms"]
    subprocess.run(words, check=True, timeout=60)
    shutil.copytree(project_root / "examples" / "data" / "franka_fr3_flange", made / "flange")
    return made


@pytest.fixture(scope="module")
def learned(folder, command):
    done = command(
        "calibrate",
        "body",
        folder / "two_arms",
        "--test-fraction",
        "0.25",
        "--out",
        folder / "body",
    )
    assert done.returncode == 0, done.stderr
    return folder / "body", done


@pytest.mark.slow
def test_two_arms_are_learned_by_one_command(learned):
    out, done = learned
    assert "PASS" in done.stdout
    assert "ruler (known distances)" in done.stdout
    document = json.loads((out / "result.json").read_text())
    assert document["test"]["pixels"]["mean"] < 0.5
    assert document["start"]["agreeing"] >= 2
    assert {path.name for path in out.iterdir()} >= {"body.yaml", "report.html", "residuals.csv"}


@pytest.mark.slow
def test_the_report_shows_the_tree(learned):
    page = (learned[0] / "report.html").read_text()
    assert "torso" in page
    assert "5 markers" in page
    assert "joints alike" in page


@pytest.mark.slow
def test_a_body_is_held_against_a_recording(learned, folder, command):
    done = command("evaluate", learned[0], folder / "two_arms", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["status"] == "PASS"
    assert document["pixels"]["mean"] < 0.5


@pytest.mark.slow
def test_a_body_predicts_places_and_pixels_with_error_bars(learned, folder, command):
    words = ",".join(["0.1"] * 13)
    done = command("predict", learned[0], "--encoders", words, "--json")
    rows = json.loads(done.stdout)["markers"]
    assert len(rows) == 10
    assert all(0.0 < row["sigma_mm"] < 20.0 for row in rows)
    body = load_body(learned[0])
    camera = body.tree.camera("camera2")
    for row in rows:
        if row["camera2_u"] is not None:
            seen = camera.project([row["x_m"], row["y_m"], row["z_m"]])
            assert [row["camera2_u"], row["camera2_v"]] == pytest.approx(seen)


@pytest.mark.slow
def test_a_body_on_disk_is_the_body(learned, tmp_path):
    body = load_body(learned[0])
    save_body(body, tmp_path / "body.yaml")
    again = load_body(tmp_path / "body.yaml")
    assert (again.tree.X_PJ == body.tree.X_PJ).all()
    assert (again.covariance.matrix == body.covariance.matrix).all()
    assert [s.name for s in again.tree.sensors] == [s.name for s in body.tree.sensors]


def test_a_recording_on_disk_is_the_recording(folder, tmp_path):
    data = load_body_dataset(folder / "two_arms")
    save_body_dataset(data, tmp_path / "again")
    again = load_body_dataset(tmp_path / "again")
    assert np.array_equal(again.readings, data.readings)
    assert np.array_equal(again.observations.values, data.observations.values, equal_nan=True)
    assert np.array_equal(again.observations.pose, data.observations.pose)


def test_chosen_poses_are_not_handed_to_a_command_that_moves_another_robot(
    learned, folder, tmp_path, command
):
    words = ("choose-poses", learned[0], folder / "two_arms", "--count", 1)
    done = command(*words, "--out", tmp_path / "poses.csv")
    assert done.returncode == 0, done.stderr
    assert "next  move the robot there" in done.stdout


def test_hand_eye_of_a_real_arm_is_where_its_joints_say_as_surely_as_it_says(folder, command):
    done = command(
        "calibrate", "hand-eye", folder / "flange", "--test-fraction", "0.3", "--out", folder / "he"
    )
    assert done.returncode == 0, done.stderr
    known = json.loads((folder / "he" / "result.json").read_text())["parameters"]
    place = [1e3 * known[f"camera.{axis}"]["value"] for axis in "xyz"]
    sigma = [1e3 * known[f"camera.{axis}"]["sigma"] for axis in "xyz"]
    # From the same poses with the joints' readings: links off by 0.2 deg and 0.5 mm (one standard
    # deviation), zeros included, leave 1.5 mm where the controller's own poses leave 4.7.
    by_joints, its_sigma = np.array([59.0, -74.3, 39.7]), np.array([0.4, 0.3, 0.9])
    assert (np.abs(place - by_joints) < 3.0 * np.hypot(sigma, its_sigma)).all()
    assert max(sigma) < 2.0
    lost = command("rezero", folder / "he", folder / "flange", "--out", folder / "rezeroed")
    assert lost.returncode == 2
    assert "the body has no joint with an encoder of its own, and so no zero" in lost.stderr


def test_the_commands_of_the_document_are_those_that_are_tested(project_root):
    text = (project_root / "docs" / "any-robot.md").read_text(encoding="utf-8")
    found = re.findall(r"^nico-selfmodel (.*)$", text, re.MULTILINE)
    assert [line.split()[:2] for line in found[-5:]] == [
        ["calibrate", "body"],
        ["evaluate", "two_arms_body"],
        ["predict", "two_arms_body"],
        ["join", "by_cameras"],
        ["calibrate", "hand-eye"],
    ]


def test_recordings_with_touches_are_joined_as_the_document_says(
    folder, project_root, tmp_path, command
):
    text = (project_root / "docs" / "any-robot.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```yaml\n(markers:\n- \{name: left_ball.*?)```", text, re.DOTALL)
    (line,) = re.findall(r"^nico-selfmodel (join .*)$", text, re.MULTILINE)
    head = yaml.safe_load((folder / "two_arms" / "dataset.yaml").read_text())
    links = {"left_wrist": "left5", "right_wrist": "right5"}
    told = yaml.safe_load(block)
    for entry in told["markers"]:
        entry["on"] = links[entry.pop(True)]
    shutil.copytree(folder / "two_arms", tmp_path / "by_cameras")
    tracked = [*told["markers"], {"name": "left_tag0", "on": "left5"}]
    sensors = [{"name": "laser", "kind": "points"}]
    for name, markers, seeing, rows in (
        ("by_tracker", tracked, sensors, ["0,laser,left_tag0,,1,2,3"]),
        ("touches", told["markers"], told["sensors"], ["0,bump,left_ball,right_ball,,,",
                                                       "1,table,left_ball,,,,"]),
    ):  # fmt: skip
        (tmp_path / name).mkdir()
        content = head | {"name": name, "markers": markers, "sensors": seeing}
        (tmp_path / name / "dataset.yaml").write_text(yaml.safe_dump(content))
        poses = (folder / "two_arms" / "poses.csv").read_text().splitlines()[:3]
        (tmp_path / name / "poses.csv").write_text("\n".join(poses) + "\n")
        table = ["sample,sensor,marker,other,x_m,y_m,z_m", *rows]
        (tmp_path / name / "observations.csv").write_text("\n".join(table) + "\n")
    words = line.split()
    done = command(*words[:1], *(tmp_path / w for w in words[1:4]), "--out", tmp_path / words[5])
    assert done.returncode == 0, done.stderr
    both = load_body_dataset(tmp_path / "everything")
    assert [s.kind for s in both.sensors].count("camera") == 2
    assert {s.name for s in both.sensors} >= {"laser", "bump", "ruler", "table"}
    assert len(both.sample) == 44
    content["markers"][0]["on"] = "right5"
    (tmp_path / "touches" / "dataset.yaml").write_text(yaml.safe_dump(content))
    done = command("join", tmp_path / "everything", tmp_path / "touches", "--out", tmp_path / "x")
    assert done.returncode == 2
    assert "'left_ball' has 'on' 'left5'" in done.stderr
    assert not (tmp_path / "x").exists()


def spoilt(folder, tmp_path, *, head=None, table=None):
    """A copy of the two arms with its head or its observations changed."""
    made = tmp_path / "spoilt"
    shutil.copytree(folder / "two_arms", made)
    if head is not None:
        content = yaml.safe_load((made / "dataset.yaml").read_text())
        for key in ("markers", "sensors"):
            content[key] = [
                {"on" if k is True else k: v for k, v in e.items()} for e in content[key]
            ]
        head(content)
        (made / "dataset.yaml").write_text(yaml.safe_dump(content))
    if table is not None:
        with (made / "observations.csv").open(newline="") as file:
            rows = list(csv.reader(file))
        table(rows)
        with (made / "observations.csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)
    return made


def refused(command, data, tmp_path, *words):
    done = command("calibrate", "body", data, "--out", tmp_path / "out", *words)
    assert done.returncode == 2
    said = [line for line in done.stderr.splitlines() if not line.endswith(": done")]
    assert len(said) == 1, done.stderr
    assert not (tmp_path / "out").exists()
    return said[0]


def no_link(content):
    content["markers"][0]["on"] = "left9"


def on_nothing(content):
    del content["markers"][0]["on"]


def follow_each_other(content):
    content["joints"][1]["follows"] = {"left1": 1.0}
    content["joints"][2]["follows"] = {"left0": 1.0}


def parent_later(content):
    content["joints"][0]["parent"] = "left0"


def same_name(content):
    content["markers"][1]["name"] = content["markers"][0]["name"]


def no_lens(content):
    del content["sensors"][1]["lens"]


def odd_kind(content):
    content["sensors"][1]["kind"] = "radar"


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (no_link, "'left_tag0' is on 'left9', which is no link"),
        (on_nothing, "marker 'left_tag0' is on no link: add 'on'"),
        (follow_each_other, "let both follow joints with encoders"),
        (parent_later, "list the parent first"),
        (same_name, "an id on two links cannot be told apart"),
        (no_lens, "nothing tells the lens of camera 'camera1'"),
        (odd_kind, "the kind of sensor 'camera1' must be one of"),
    ],
)
def test_a_wrong_head_is_refused_in_one_line(folder, tmp_path, command, head, words):
    assert words in refused(command, spoilt(folder, tmp_path, head=head), tmp_path)


def strange_sensor(rows):
    rows[5][1] = "camera9"


def half_a_pixel(rows):
    rows[5][5] = ""


def strange_sample(rows):
    rows[5][0] = "999"


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (strange_sensor, "line 6, column 'sensor': 'camera9' is not listed in dataset.yaml"),
        (half_a_pixel, "line 6, column 'v': the cell is empty, but sensor"),
        (strange_sample, "line 6, column 'sample': '999' is no sample of poses.csv"),
    ],
)
def test_a_wrong_observation_is_refused_with_its_line(folder, tmp_path, command, table, words):
    assert words in refused(command, spoilt(folder, tmp_path, table=table), tmp_path)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--prior", "camera2.x"), "--prior must be NAME=MEAN,SIGMA"),
        (("--prior", "camera2.x=1,1,2"), "--prior must be NAME=MEAN,SIGMA, got camera2.x=1,1,2"),
        (("--prior", "camera2.x=1,0"), "sigma must be positive"),
        (("--prior", "camera2.x=1,1", "--prior", "camera2.x=2,1"), "camera2.x is given twice"),
        (("--fix", "camera2.x=1", "--prior", "camera2.x=1,1"), "fixed and given a prior"),
        (("--fix", "camara2.x=1"), "no parameter 'camara2.x'"),
        pytest.param(
            ("--fix", "left1.x=0"),
            "left1.x can only be held against a robot description",
            marks=pytest.mark.slow,
        ),
        (("--fix", "left_tag0.z"), "nothing tells left_tag0.z"),
        (("--prior", "left1.rx=0,0.1"), "left1.rx can only be held against a robot description"),
        (("--stage", "full", "--arm", "b"), "--stage, --arm would change nothing"),
        (("--robot-sigma", "2,10"), "give --robot too"),
        (("--robot", "nico", "--robot-sigma", "2"), "--robot-sigma 2 must be DEG,MM"),
        (("--test", "nowhere"), "nowhere does not exist; a recording of any body is a folder"),
    ],
)
def test_wrong_words_are_refused_in_one_line(folder, tmp_path, command, words, reason):
    assert reason in refused(command, folder / "two_arms", tmp_path, *words)


def test_a_description_in_millimetres_is_refused(folder, tmp_path, command):
    document = yaml.safe_load((folder / "two_arms" / "dataset.yaml").read_text())
    lines, before = ['<robot name="large"><link name="base"/>'], "world"
    for joint in document["joints"]:
        parent, before = joint.get("parent", before), joint["name"]
        lines.append(
            f'<link name="{before}_link"/><joint name="{before}" type="revolute">'
            f'<parent link="{"base" if parent == "world" else parent + "_link"}"/>'
            f'<child link="{before}_link"/><origin xyz="0 0 120"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    urdf = tmp_path / "large.urdf"
    urdf.write_text("\n".join([*lines, "</robot>"]))
    said = refused(command, folder / "two_arms", tmp_path, "--robot", urdf)
    assert "from joint to joint it is 1560 m: were millimetres given as metres?" in said


@pytest.mark.parametrize("words", [("body", "two_arms"), ("hand-eye", "flange")])
def test_training_data_are_refused_as_held_out_data(folder, tmp_path, command, words):
    kind, data = words
    done = command(
        *("calibrate", kind, folder / data, "--test", folder / data, "--out", tmp_path / "out")
    )
    assert_one_clear_line(done, "holds the training data: nothing would be held out")
    assert not (tmp_path / "out").exists()


def test_lenses_of_other_cameras_alone_are_refused(folder, tmp_path, command):
    lens = Camera(600.0, 600.0, 320.0, 240.0, (640, 480))
    save_model(SelfModel("pair", cameras={"left": lens, "right": lens}), tmp_path / "pair.yaml")
    reason = refused(command, folder / "two_arms", tmp_path, "--cameras", tmp_path / "pair.yaml")
    assert "has the cameras: left, right;" in reason
    assert "camera1, camera2: they are matched by name" in reason


def test_predictions_of_a_body_name_the_frame_that_they_are_in(tmp_path, command):
    tree = one_arm(2).tree
    body = BodyModel("arm", tree, np.ones(5), provenance={"world": "base_link"})
    save_body(body, tmp_path / "body.yaml")
    words = ("predict", tmp_path / "body.yaml", "--encoders", "0,0.1,0,0,0")
    told = json.loads(command(*words, "--json").stdout)["markers"]
    assert [row["frame"] for row in told] == ["base_link"]
    heading, row = csv.reader(command(*words).stdout.splitlines())
    assert dict(zip(heading, row, strict=True))["frame"] == "base_link"
    seen = json.loads(command(*words, "--frame", "tracker", "--json").stdout)["markers"]
    assert [row["frame"] for row in seen] == ["tracker"]
    done = command(*words, "--frame", "nobody")
    assert done.returncode == 2
    assert "no sensor 'nobody'; there are tracker" in done.stderr


@pytest.mark.parametrize(("moved_mm", "name"), [(0.0, "tracker"), (5.0, "world")])
def test_places_bear_the_name_of_a_tracker_only_while_it_is_where_the_body_begins(
    tmp_path, command, moved_mm, name
):
    tree = one_arm(2).tree
    pose = np.eye(4) + 1e-3 * moved_mm * np.eye(4, k=3)
    tree = replace(tree, sensors=(replace(tree.sensors[0], X_LA=pose),))
    body = BodyModel("arm", tree, np.ones(5), provenance={"world": "tracker"})
    save_body(body, tmp_path / "body.yaml")
    words = ("predict", tmp_path / "body.yaml", "--encoders", "0,0.1,0,0,0", "--json")
    (told,), (seen,) = (
        json.loads(command(*words, *frame).stdout)["markers"]
        for frame in ((), ("--frame", "tracker"))
    )
    assert (told["frame"], seen["frame"]) == (name, "tracker")
    assert told["x_m"] - seen["x_m"] == pytest.approx(1e-3 * moved_mm, abs=1e-9)


def test_a_warning_is_told_once_before_the_error_that_follows(tmp_path, command):
    _, _, F, M = hand_eye_poses(np.random.default_rng(4), 1)
    save_body_dataset(flange_dataset(*np.repeat([F, M], 25, axis=1)), tmp_path / "same")
    words = ("calibrate", "hand-eye", tmp_path / "same", "--out", tmp_path / "out")
    done = command(*words, "--test-fraction", 0.2)
    assert done.returncode == 2
    warning, error = (line for line in done.stderr.splitlines() if not line.endswith(": done"))
    assert "warning: 24 of 25 observations are of one pose and the same" in warning
    assert "cannot split 1 poses" in error


def test_an_arm_with_encoders_is_no_hand_eye(folder, tmp_path, command):
    done = command("calibrate", "hand-eye", folder / "two_arms", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "has no joint with 'motion: flange'" in done.stderr


@pytest.mark.slow
def test_a_data_set_of_one_arm_is_converted_and_learned_as_well(project_root, tmp_path, command):
    data = project_root / "examples" / "data" / "positioner_two_axis"
    done = command("convert", data, "--out", tmp_path / "positioner")
    assert done.returncode == 0, done.stderr
    assert "205 poses, 205 observations, 2 joints" in done.stdout
    out = tmp_path / "body"
    words = ("calibrate", "body", tmp_path / "positioner", "--out")
    assert command(*words, out, "--effects", "none").returncode == 0
    document = json.loads((out / "result.json").read_text())
    assert document["train"]["position_mm"]["rms"] == pytest.approx(0.4007, rel=0.01)
    assert "--effects auto" in " ".join(document["warnings"])
    assert command(*words, tmp_path / "bent").returncode == 0
    bent = json.loads((tmp_path / "bent" / "result.json").read_text())
    assert "ripple" in bent["bending"]["effects"]
    assert bent["train"]["position_mm"]["rms"] < 0.34
    told = load_body(tmp_path / "bent").tree.bending
    assert set(bent["bending"]["effects"]) <= {*told.effects, "gear"}
    assert "sag" not in bent["bending"]["effects"]
    second = document["joints"][1]
    assert 89.95 <= second["axis_angle_deg"] <= 90.0


def test_what_exists_is_not_converted_over(folder, project_root, command):
    data = project_root / "examples" / "data" / "positioner_two_axis"
    done = command("convert", data, "--out", folder / "flange")
    assert done.returncode == 2
    assert "exists already" in done.stderr


def test_a_recording_is_not_written_over_itself(folder, command):
    flange = folder / "flange"
    before = {path.name: path.read_bytes() for path in flange.iterdir()}
    for words in (("join", flange, "--out", flange), ("convert", flange, "--out", flange)):
        done = command(*words, "--force")
        assert done.returncode == 2
        assert done.stderr.endswith("flange is read: choose another name\n")
    assert {path.name: path.read_bytes() for path in flange.iterdir()} == before
