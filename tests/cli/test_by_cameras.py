"""Recording and learning through rendered cameras, from the command line."""

import json

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import content_hash, load_dataset
from nico_selfmodel.model.self_model_file import load_model


@pytest.mark.slow
def test_a_short_recording_by_sight_is_a_data_set_and_can_be_gone_on_with(tmp_path, command):
    out = tmp_path / "seen"
    words = ("record", "--out", out, "--circle", 0, "--seed", 1, "--images", "--random")
    done = command(*words, 2)
    assert done.returncode == 0, done.stderr
    data = load_dataset(out)
    assert data.image_size == (640, 480)
    assert np.isfinite(data.pixels).all(axis=1).sum() >= 2
    assert len(list((out / "images").iterdir())) == 2 * len(data.samples)
    again = command(*words, 2)
    assert again.returncode == 0, again.stderr
    assert content_hash(load_dataset(out)) == content_hash(data)


def test_motion_capture_is_recorded_into_a_folder_that_can_be_resumed(tmp_path, command):
    out = tmp_path / "captured"
    words = ("record", "--out", out, "--sensor", "motion-capture", "--circle", 12, "--random", 5)
    assert command(*words).returncode == 0
    data = load_dataset(out)
    assert set(data.sweep.tolist()) - {"", "home"} == set(data.joint_names)
    assert command(*words).returncode == 0
    assert content_hash(load_dataset(out)) == content_hash(data)
    other = command("record", "--out", out, "--sensor", "motion-capture", "--seed", 9)
    assert other.returncode == 2
    assert "choose another name" in other.stderr


@pytest.mark.slow
def test_chosen_poses_are_visited_instead_of_random_ones(tmp_path, command):
    first, arm, table, more = (tmp_path / name for name in ("first", "arm", "poses.csv", "more"))
    words = ("record", "--out", first, "--sensor", "motion-capture", "--circle", 12, "--random", 20)
    assert command(*words).returncode == 0
    assert command("calibrate", "kinematics", first, "--out", arm).returncode == 0
    assert command("choose-poses", arm, first, "--count", 5, "--out", table).returncode == 0
    words = ("record", "--out", more, "--sensor", "motion-capture", "--poses", table)
    done = command(*words)
    assert done.returncode == 0, done.stderr
    data = load_dataset(more)
    assert len(data.samples) == 5
    assert set(data.sweep.tolist()) == {""}
    chosen = np.loadtxt(table, delimiter=",", skiprows=1)
    assert np.abs(data.encoders - chosen).max() < 200.0  # counts of 16384: play, not another pose
    refused = command(*words, "--random", 3)
    assert refused.returncode == 2
    assert "leave out --random" in refused.stderr


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("record", "--out", "out", "--sensor", "ears"), "no sensor 'ears'"),
        (("record", "--out", "out", "--circle", "0", "--random", "0"), "nothing to record"),
        (
            ("record", "--out", "out", "--sensor", "motion-capture", "--images"),
            "need --sensor stereo",
        ),
        (("learn", "--sensor", "nose"), "no sensor 'nose'"),
        (("learn", "--sensor", "stereo-color", "--arm", "left_arm"), "Nico's own right arm"),
        (("live", "nothing"), "nothing"),
        (
            ("experiment", "vision", "--out", "out", "--imperfections", "moon"),
            "no imperfections 'moon'",
        ),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(words, reason, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = command(*words)
    assert done.returncode == 2
    assert reason in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_boards_cameras_hand_arm_and_the_live_scene_one_command_after_the_other(tmp_path, command):
    boards, pair, seen, arm = (tmp_path / name for name in ("boards", "pair", "seen", "arm"))
    assert (
        command("record", "--out", boards, "--sensor", "chessboard", "--board-views", 12).returncode
        == 0
    )
    words = ("calibrate", "stereo", boards, "--board", "9x6", "--square-mm", 28, "--window", 5)
    done = command(*words, "--out", pair)
    assert done.returncode == 0, done.stdout + done.stderr
    words = (
        "record",
        "--out",
        seen,
        "--circle",
        24,
        "--random",
        40,
        "--cameras",
        pair,
        "--session",
        1,
    )
    assert command(*words).returncode == 0
    words = ("calibrate", "kinematics", seen, "--cameras", pair, "--test-fraction", 0.3)
    done = command(*words, "--out", arm, "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads((arm / "result.json").read_text())
    assert document == json.loads(done.stdout)
    assert document["test"]["position_mm"]["mean"] < 5.0
    assert document["test"]["pixels"]["mean"] < 8.0
    assert set(load_model(arm).cameras) == {"left", "right"}
    page = tmp_path / "live.html"
    assert command("live", arm, "--out", page, "--count", 2).returncode == 0
    text = page.read_text()
    assert text.lstrip().lower().startswith("<!doctype html>")
    assert "http://" not in text.split("<body")[0]
