"""A whole Nico by the command line: recorded, and refused in one line where something is wrong."""

import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset

from .one_line import assert_one_clear_line


def test_a_whole_nico_is_recorded_as_a_body(tmp_path, command):
    out = tmp_path / "nico"
    done = command(
        "simulate", "whole-body", "--looks", "4", "--hands", "2", "--seed", "3", "--out", out
    )
    assert done.returncode == 0, done.stderr
    assert "8 poses" in done.stdout
    data = load_body_dataset(out)
    assert len(data.joints) == 18
    assert {sensor.on for sensor in data.sensors} == {"left_eye_pan", "right_eye_pan"}
    assert sum(marker.xyz is not None for marker in data.markers) == 30
    refused = command("calibrate", "body", out, "--robot", "nico", "--out", tmp_path / "learned")
    assert_one_clear_line(refused, "leave out --robot")
    assert not (tmp_path / "learned").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--looks", "0", "--hands", "0"], "nothing to record"),
        (["--imperfections", "odd"], "thesis"),
    ],
)
def test_a_recording_of_nothing_is_refused(tmp_path, command, words, said):
    done = command("simulate", "whole-body", *words, "--out", tmp_path / "none")
    assert_one_clear_line(done, said)
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--arms", "both"], "--arms both needs --head"),
        (["--arms", "three", "--head"], "--arms must be one of right, left, both, got 'three'"),
        (["--head", "--sensor", "stereo-color"], "--sensor would change nothing"),
        (["--head", "--mirror", "--random", "3"], "--random, --mirror would change nothing"),
    ],
)
def test_a_whole_body_that_cannot_be_learned_is_refused(tmp_path, command, words, said):
    done = command("learn", *words, "--out", tmp_path / "none")
    assert_one_clear_line(done, said)
    assert not (tmp_path / "none").exists()
