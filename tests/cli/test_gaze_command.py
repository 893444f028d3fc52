"""The command `gaze`: joints of the head on standard output, and one line where it cannot look."""

import json

import numpy as np
import pytest

from nico_selfmodel.model.tree.body_model import BodyModel, save_body
from nico_selfmodel.systems.looking import HEAD_JOINTS, looking_body

from .one_line import assert_one_clear_line


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    path = tmp_path_factory.mktemp("gaze") / "body.yaml"
    described = looking_body()
    save_body(BodyModel("nico", described.tree, np.ones(18), limits=described.limits), path)
    return path


STILL = ",".join(["0"] * 18)


def test_a_point_is_looked_at_by_the_joints_of_the_head(body, command):
    words = ("gaze", body, "--encoders", STILL, "--target", "0.6,0.2,0.4")
    done = command(*words)
    assert done.returncode == 0, done.stderr
    assert [line.split()[0] for line in done.stdout.splitlines()[:6]] == list(HEAD_JOINTS)
    document = json.loads(command(*words, "--json").stdout)
    assert document["off_px"] < 1.0
    assert set(document["pixels"]) == {"left_wide_camera", "right_wide_camera"}
    one = json.loads(command(*words, "--camera", "left_wide_camera", "--json").stdout)
    assert list(one["pixels"]) == ["left_wide_camera"]
    assert "right_eye_pan" not in one["readings"]


def test_the_own_hand_is_looked_at(body, command):
    bent = ",".join(["0"] * 6 + ["-0.8", "0.2", "-0.6", "-1", "-1.5", "0"] + ["0"] * 6)
    done = command("gaze", body, "--encoders", bent, "--marker", "right_hand_fiducial", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["off_px"] < 10.0


AT_POINT = ("--encoders", STILL, "--target", "0.6,0.2,0.4")


def test_a_point_is_looked_at_where_it_was_seen(body, command):
    still = json.loads(command("gaze", body, *AT_POINT, "--json").stdout)
    seen = [f"{name}={u + 20:.2f},{v:.2f}" for name, (u, v) in _seen_at(still).items()]
    now = ",".join(str(value) for value in still["readings"].values()) + ",0" * 12
    words = ("gaze", body, "--encoders", now, "--target", "0.6,0.2,0.4")
    words += tuple(word for one in seen for word in ("--seen", one))
    again = json.loads(command(*words, "--json").stdout)
    assert again["offset_m"][1] < -0.015
    assert again["readings"]["neck_yaw"] < still["readings"]["neck_yaw"]
    assert "from where the body expects it" in command(*words).stdout


def _seen_at(document):
    assert set(document["pixels"]) == {"left_wide_camera", "right_wide_camera"}
    return document["pixels"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--encoders", STILL, "--target", "-0.5,0,0.4"], "out of reach"),
        (["--encoders", STILL, "--marker", "right_hand_fiducial"], "out of reach"),
        (["--encoders", STILL], "either --target or --marker"),
        (["--encoders", "0,0", "--target", "1,0,0.4"], "18"),
        (["--encoders", STILL, "--target", "1,0"], "X,Y,Z"),
        (["--encoders", STILL, "--target", "1,0,0.4", "--camera", "third"], "third"),
        (["--encoders", STILL, "--marker", "tail"], "tail"),
        ([*AT_POINT, "--seen", "left_wide_camera"], "expected NAME=VALUE"),
        ([*AT_POINT, "--seen", "left_wide_camera=1"], "must be U,V"),
        ([*AT_POINT, "--seen", "third=1,2"], "no camera third looks"),
        ([*AT_POINT, "--seen", "left_wide_camera=900,2"], "its image is 640 x 480 px"),
    ],
)
def test_what_cannot_be_looked_at_is_one_line(body, command, words, said):
    done = command("gaze", body, *words)
    assert_one_clear_line(done, said)


def test_what_is_no_body_is_answered_by_what_leaves_one(tmp_path, command):
    done = command("gaze", tmp_path, "--encoders", STILL, "--target", "0.6,0.2,0.4")
    assert_one_clear_line(done, "give the folder that `learn --head` left, or `calibrate body`")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "does not know the markers right_hand_fiducial_0"),
        (["--mirror", "glass"], "does not know the markers right_hand_fiducial_0"),
    ],
)
def test_a_whole_body_that_cannot_be_shown_live_is_one_line(body, tmp_path, command, words, said):
    done = command("live", body, "--out", tmp_path / "page.html", *words)
    assert_one_clear_line(done, said)
    assert not (tmp_path / "page.html").exists()
