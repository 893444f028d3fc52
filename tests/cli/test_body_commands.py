"""`calibrate body`, `calibrate tool`, `rezero`, `monitor`, and the experiments of chapter 8."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import CONDITIONS, simulated_scenario
from nico_selfmodel.model.self_model_file import load_model, save_model
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

DETECT = "nico_selfmodel.vision.boards.board_detections.detect_boards"

PLAY = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
TOOL = np.array([0.025, 0.0, -0.08])


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a folder of data sets and the seed's cameras, and the boards they learned from."""
    folder = tmp_path_factory.mktemp("bodies")
    protocol = ProjectedNico.tracked_by()
    scenario = simulated_scenario(protocol, PLAY, 0)
    save_dataset(scenario.train, folder / "train")
    save_dataset(scenario.test, folder / "test")
    save_model(scenario.cameras, folder / "cameras.yaml")
    (folder / "photographs").mkdir()
    one = protocol.robot(PLAY, 0, session=2)
    rng = np.random.default_rng(0)
    save_dataset(protocol.record(one, "later", protocol.random_poses(30, rng)), folder / "later")
    one.faults.slip("right_elbow", np.radians(3.0))
    save_dataset(
        protocol.record(one, "slipped", protocol.random_poses(20, rng)), folder / "slipped"
    )
    one.faults.take_tool(TOOL)
    held = protocol.robot(PLAY, 0, session=3)
    held.faults.take_tool(TOOL)
    poses = protocol.random_poses(25, rng, TOOL)
    save_dataset(protocol.record(held, "tool", poses), folder / "tool")
    return folder, scenario.boards


@pytest.fixture
def photographs(recorded, monkeypatch):
    """Let a folder of photographs show the boards that the cameras learned from."""
    folder, boards = recorded
    found = SimpleNamespace(told_views=boards)
    monkeypatch.setattr(DETECT, lambda *_, **__: found)
    return folder / "photographs"


@pytest.fixture(scope="module")
def body(recorded, command, tmp_path_factory):
    """Return the result folder of a learned body."""
    folder, boards = recorded
    out = tmp_path_factory.mktemp("body") / "nico"
    with pytest.MonkeyPatch.context() as patch:
        found = SimpleNamespace(told_views=boards)
        patch.setattr(DETECT, lambda *_, **__: found)
        done = command(
            *("calibrate", "body", folder / "train", "--model", folder / "cameras.yaml"),
            *("--boards", folder / "photographs", "--test", folder / "test", "--out", out),
        )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "PASS" in done.stdout
    assert "held-out boards" in done.stdout
    assert "scale held by" in done.stdout
    return out


def document_of(folder):
    return json.loads((folder / "result.json").read_text())


def test_a_body_leaves_model_numbers_and_urdf(body):
    names = {path.name for path in body.iterdir()}
    assert {"self_model.yaml", "result.json"} <= names
    assert any(name.endswith("_learned.urdf") for name in names)
    model = load_model(body)
    assert model.has_arm
    assert set(model.cameras) == {"left", "right"}
    document = document_of(body)
    assert document["status"] == "PASS"
    assert document["boards"]["held_out"]
    assert document["test"]["position_mm"]["mean"] < 3.0
    assert document["cross_validation"]["n"] > 150


def test_a_body_is_evaluated_by_what_its_cameras_saw(recorded, body, command):
    test = recorded[0] / "test"
    done = command("evaluate", body, test, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["status"] == "PASS"
    assert "px, expected" in found["reasons"][0]
    assert found["poses"] == document_of(body)["test"]["poses"]
    assert found["pixels"] == document_of(body)["test"]["pixels"]
    assert found["position_mm"] == document_of(body)["test"]["position_mm"]
    done = command("evaluate", body, test)
    assert [words in done.stdout for words in ("[mm]", "[px]", "PASS")] == [True] * 3
    refused = command("evaluate", body, test, "--sensor", "nose")
    assert refused.returncode == 2
    assert "no sensor 'nose'" in refused.stderr


@pytest.mark.slow
def test_the_thesis_own_variant_ends_with_one_where_it_harmed_the_cameras(
    recorded, photographs, command, tmp_path
):
    folder, _ = recorded
    done = command(
        *("calibrate", "body", folder / "train", "--model", folder / "cameras.yaml"),
        *("--boards", photographs, "--board-test-fraction", 0.5, "--variant", "thesis"),
        *("--out", tmp_path / "out", "--json"),
    )
    document = json.loads(done.stdout)
    assert document == document_of(tmp_path / "out")
    assert document["variant"] == "thesis"
    assert any("the thesis' own variant" in words for words in document["warnings"])
    assert done.returncode == (1 if document["status"] == "FAIL" else 0)


@pytest.mark.slow
def test_kinematics_alone_need_no_boards(recorded, command, tmp_path):
    folder, _ = recorded
    done = command(
        *("calibrate", "body", folder / "train", "--model", folder / "cameras.yaml"),
        *("--stage", "kinematics", "--test-fraction", 0.2, "--robot", "nico"),
        *("--base", "chest", "--tip", "right_hand", "--hold", "right_forearm_twist=-1.5708"),
        *("--hold", "right_wrist", "--point", "hand=right_hand_fiducial"),
        *("--out", tmp_path / "arm"),
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "arm" / "nico_learned.urdf").is_file()
    assert document_of(tmp_path / "arm")["scale_from"] == "cameras"


@pytest.mark.slow
def test_three_boards_are_all_learned_from(recorded, photographs, monkeypatch, command, tmp_path):
    folder, boards = recorded
    found = SimpleNamespace(told_views=boards.select(np.arange(3)))
    monkeypatch.setattr(DETECT, lambda *_, **__: found)
    done = command(
        *("calibrate", "body", folder / "train", "--model", folder / "cameras.yaml"),
        *("--boards", photographs, "--out", tmp_path / "out", "--json"),
    )
    assert done.returncode in (0, 1), done.stderr
    document = json.loads(done.stdout)
    assert not document["boards"]["held_out"]
    assert any("no board was held out" in words for words in document["warnings"])
    known = document["noise_known_to"]
    assert 0.0 < known["pixel_sigma_px"] < 0.1 * document["pixel_sigma_px"]
    assert 0.0 < known["joint_sigma_deg"] < 0.1 * document["joint_sigma_deg"]


def test_a_tool_from_the_command_line(recorded, body, command, tmp_path):
    folder, _ = recorded
    done = command(
        *("calibrate", "tool", folder / "tool", "--model", body, "--test-fraction", 0.5),
        *("--tool", "screwdriver", "--out", tmp_path / "held"),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "tip" in done.stdout
    document = document_of(tmp_path / "held")
    reach = document["reach_mm"]
    assert reach["value"] == pytest.approx(1e3 * np.linalg.norm(TOOL), abs=4.0 * reach["sigma"])
    assert load_model(tmp_path / "held").markers == ("hand", "screwdriver")


@pytest.mark.slow
def test_a_point_that_moved_is_learned_anew_as_monitor_says(recorded, body, command):
    folder, _ = recorded
    ill = json.loads(command("monitor", body, folder / "tool", "--json").stdout)
    words = shlex.split(ill["causes"][0]["command"])
    assert words[:4] == ["nico-selfmodel", "calibrate", "tool", str(folder / "tool")]
    done = command(*words[1:])
    assert done.returncode == 0, done.stdout + done.stderr
    assert "from where it was" in done.stdout
    reach = document_of(Path(words[-1]))["reach_mm"]
    assert reach["value"] == pytest.approx(1e3 * np.linalg.norm(TOOL), abs=4.0 * reach["sigma"])
    assert command("monitor", words[-1], folder / "tool").returncode == 0


@pytest.mark.slow
def test_a_bare_hand_as_a_tool_ends_with_one(recorded, body, command, tmp_path):
    folder, _ = recorded
    done = command(
        "calibrate", "tool", folder / "later", "--model", body, "--out", tmp_path / "none"
    )
    assert done.returncode == 1
    assert "no tool can be told" in done.stdout


@pytest.mark.slow
def test_monitor_says_what_changed_and_learns_just_that(recorded, body, command, tmp_path):
    folder, _ = recorded
    fine = command("monitor", body, folder / "later")
    assert fine.returncode == 0
    assert "PASS" in fine.stdout
    ill = command("monitor", body, folder / "slipped")
    assert ill.returncode == 1
    assert "zero of right_elbow" in ill.stdout
    assert f"rezero {body} {folder / 'slipped'} --joint right_elbow" in ill.stdout
    document = json.loads(command("monitor", body, folder / "slipped", "--json").stdout)
    assert document["causes"][0]["parameters"] == ["right_elbow.theta_offset"]
    again = ("--relearn", "--out", tmp_path / "cured")
    cured = command("monitor", body, folder / "slipped", *again)
    assert cured.returncode == 0, cured.stdout + cured.stderr
    assert document_of(tmp_path / "cured")["cause"] == "zero of right_elbow"
    assert command("monitor", tmp_path / "cured", folder / "slipped").returncode == 0


@pytest.mark.slow
def test_rezero_of_one_joint_and_of_all(recorded, body, command, tmp_path):
    folder, _ = recorded
    one = command(
        *("rezero", body, folder / "slipped", "--joint", "right_elbow"),
        *("--out", tmp_path / "one"),
    )
    assert one.returncode == 0, one.stdout + one.stderr
    shift = document_of(tmp_path / "one")["shift_deg"]
    assert shift["right_elbow"] == pytest.approx(3.0, abs=0.7)
    assert shift["right_shoulder_roll"] == pytest.approx(0.0, abs=1e-9)
    every = command("rezero", body, folder / "slipped", "--out", tmp_path / "all", "--json")
    assert every.returncode == 0
    assert set(json.loads(every.stdout)["parameters"]) == {
        f"{joint}.theta_offset" for joint in load_model(body).joints
    }


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("--variant", "anchored"), "needs views of a chessboard by both cameras"),
        (("--stage", "all"), "there are kinematics"),
        (("--test-fraction", 0.2, "--test", "test"), "give --test or --test-fraction"),
        (("--arm", "right_arm"), "need --robot"),
        (("--stage", "kinematics", "--fix", "left.f"), "no camera parameter"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_writes_nothing(
    recorded, command, tmp_path, words, complaint
):
    folder, _ = recorded
    words = [folder / w if w == "test" else w for w in words]
    done = command(
        *("calibrate", "body", folder / "train", "--model", folder / "cameras.yaml"),
        *("--out", tmp_path / "out", *words),
    )
    assert done.returncode == 2
    assert complaint in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_models_and_data_that_do_not_suit_are_refused(recorded, body, command, tmp_path):
    folder, _ = recorded
    without = load_model(body)
    save_model(replace(without, cameras={}, covariance=None), tmp_path / "arm.yaml")
    out = tmp_path / "out"
    done = command(
        *("calibrate", "body", folder / "train", "--model", tmp_path / "arm.yaml"),
        *("--stage", "kinematics", "--out", out),
    )
    assert done.returncode == 2
    assert "no pair of cameras" in done.stderr
    lacking = command("monitor", tmp_path / "arm.yaml", folder / "later")
    assert lacking.returncode == 2
    assert "has no cameras, and data set 'later' holds nothing but pixels" in lacking.stderr
    once = tmp_path / "once"
    save_dataset(load_dataset(folder / "later").select(np.arange(1)), once)
    lost = command("rezero", body, once, "--out", out)
    assert lost.returncode == 2
    assert "1 observation is too few or too alike: `right_" in lost.stderr
    assert lost.stderr.rstrip().endswith("record more poses, spread over the workspace")
    assert command("monitor", folder / "cameras.yaml", folder / "later").returncode == 2
    lone = command("monitor", body, folder / "slipped", "--relearn")
    assert "--relearn and --out belong together" in lone.stderr
    assert not out.exists()


ANY_ARM = 23
"""Parameters of four joints with unknown gears that points can tell."""


def named_unobservable(done):
    """Return the parameters that a refusal names, and how many there are in all."""
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    words = done.stderr.rpartition("wholly or in part: ")[2]
    listed, _, more = words.rpartition(":")[0].partition(", ... and ")
    names = listed.split(", ")
    return names, len(names) + int(more.removesuffix(" more") or 0)


@pytest.mark.parametrize("count", [1, 2, 5, 7])
def test_too_few_poses_for_a_body_name_what_is_unobservable(
    recorded, body, command, tmp_path, count
):
    folder, _ = recorded
    few, out = tmp_path / "few", tmp_path / "out"
    save_dataset(load_dataset(folder / "later").select(np.arange(count)), few)
    task = ("--stage", "kinematics", "--out", out)
    unknown = command("calibrate", "body", few, "--model", folder / "cameras.yaml", *task)
    poses = "1 pose" if count == 1 else f"{count} poses"
    assert f"both cameras saw the hand in {poses}, at least 8 are needed" in unknown.stderr
    names, total = named_unobservable(unknown)
    assert total == ANY_ARM
    assert len(set(names)) == len(names) == 8
    assert "M0.x" in names
    known = command("calibrate", "body", few, "--model", body, *task)
    # Each direction that few poses leave open has a part of every parameter.
    assert named_unobservable(known)[1] == total
    pixels = command(
        "calibrate", "kinematics", few, "--cameras", folder / "cameras.yaml", *task[2:]
    )
    assert named_unobservable(pixels) == (names, total)
    assert not out.exists()


def test_only_what_is_unobservable_is_named(recorded, body, command, tmp_path):
    folder, _ = recorded
    out, free = tmp_path / "out", {"right_elbow.gear", "right_elbow.theta_offset"}
    held = [n for n in load_model(body).parameters.names if n not in free]
    task = ("--model", body, "--stage", "kinematics", "--out", out)
    pins = [word for name in held for word in ("--fix", name)]
    data = load_dataset(folder / "later")
    save_dataset(data.select(np.arange(1)), tmp_path / "one")
    save_dataset(data.select(np.arange(5)), tmp_path / "five")
    one = command("calibrate", "body", tmp_path / "one", *task, *pins)
    assert set(named_unobservable(one)[0]) == free
    five = command("calibrate", "body", tmp_path / "five", *task, *pins)
    assert five.returncode == 2
    assert "unobservable" not in five.stderr
    assert "in 5 poses, at least 8 are needed: record more" in five.stderr


def test_a_tool_seen_once_names_what_one_pose_cannot_tell(recorded, body, command, tmp_path):
    folder, _ = recorded
    save_dataset(load_dataset(folder / "tool").select(np.arange(1)), tmp_path / "once")
    done = command(
        "calibrate", "tool", tmp_path / "once", "--model", body, "--out", tmp_path / "out"
    )
    assert done.returncode == 2
    assert "hand.tool.x, hand.tool.y, hand.tool.z cannot be told" in done.stderr


@pytest.mark.slow
def test_the_experiments_of_chapter_8_run(command, tmp_path, monkeypatch):
    some = {"full, anchored": CONDITIONS["full, anchored"]}
    monkeypatch.setattr("nico_selfmodel.experiments.refinement.CONDITIONS", some)
    done = command(
        *("experiment", "refinement", "--robots", 1, "--tracker", "fiducial"),
        *("--out", tmp_path / "refined"),
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "refined" / "true.png").is_file()
    wrong = command("experiment", "refinement", "--tracker", "touch", "--out", tmp_path / "x")
    assert wrong.returncode == 2
    assert "no tracker" in wrong.stderr
