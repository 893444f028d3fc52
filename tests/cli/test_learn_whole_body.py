"""A whole Nico that learns itself through rendered pictures, from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.model.tree.body_model import BodyModel, load_body, save_body
from nico_selfmodel.model.tree.body_tree import WORLD
from nico_selfmodel.planning import body_poses
from nico_selfmodel.sessions import whole_recording
from nico_selfmodel.sessions.whole_body import whole_body_session, whole_nico
from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS, looking_body
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from .one_line import assert_one_clear_line


@pytest.mark.slow
def test_head_and_one_arm_are_learned_recorded_again_and_watched(tmp_path, command):
    out, again, table = tmp_path / "nico", tmp_path / "again", tmp_path / "poses.csv"
    done = command("learn", "--head", "--arms", "right", "--seed", 3, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads((out / "result.json").read_text())
    assert document["status"] == "PASS"
    (hand,) = document["hands"].values()
    assert hand["ratio"] < 1.15
    assert hand["n"] >= 60
    assert all(lens["rms_px"] < 0.1 for lens in document["lenses"].values())
    assert (out / "report.html").exists()
    body = load_body(out)
    assert body.tree.joints == (*HEAD_JOINTS, *ARM_JOINTS["right"])
    train = load_body_dataset(out / "recordings" / "train")
    assert len(train.joints) == 12

    chosen = command(
        "choose-poses", out, out / "recordings" / "train", "--out", table, "--count", 4
    )
    assert chosen.returncode == 0, chosen.stderr
    words = ("record", "--cameras", out, "--seed", 3, "--session", 7, "--poses", table)
    recorded = command(*words, "--out", again)
    assert recorded.returncode == 0, recorded.stderr
    data = load_body_dataset(again)
    assert data.joint_names == body.tree.joints
    assert np.isfinite(data.readings).all()
    assert command("monitor", out, again).returncode == 0
    page = tmp_path / "live.html"
    assert command("live", out, "--out", page, "--count", 2).returncode == 0
    assert page.read_text().lstrip().lower().startswith("<!doctype html>")


def test_a_body_with_joints_that_the_robot_does_not_command_is_neither_recorded_nor_shown(
    tmp_path, command
):
    tree = looking_body().tree
    renamed = tuple("tail" if name == "left_wrist" else name for name in tree.joints)
    body = BodyModel("nico", replace(tree, joints=renamed), np.ones(len(renamed)))
    save_body(body, tmp_path / "body.yaml")
    words = ("record", "--cameras", tmp_path / "body.yaml", "--random", 2)
    refused = command(*words, "--out", tmp_path / "none")
    assert_one_clear_line(refused, "the joints tail, which this robot does not command")
    refused = command("live", tmp_path / "body.yaml", "--out", tmp_path / "none")
    assert_one_clear_line(refused, "the joints tail, which this robot does not command")
    assert not (tmp_path / "none").exists()


def test_a_body_that_is_sent_to_no_pose_is_one_line(tmp_path, command):
    described = looking_body()
    save_body(BodyModel("nico", described.tree, np.ones(18)), tmp_path / "body.yaml")
    words = ("record", "--cameras", tmp_path / "body.yaml", "--random", 0)
    done = command(*words, "--out", tmp_path / "none")
    assert_one_clear_line(done, "give --random N of 1 or more, or --poses FILE")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("carried", "said"),
    [(True, "carries right_hand_fiducial"), (False, "carries none, and knows card0_0, card0_1")],
)
def test_a_marker_that_a_body_does_not_carry_is_answered_by_those_it_knows(
    tmp_path, command, carried, said
):
    _, tree = whole_nico(IMPERFECTIONS["clean"], 0)
    tree = tree.with_markers(tuple(m for m in tree.markers if carried or m.on == WORLD))
    known = ParameterCovariance(("neck_yaw.rz",), np.eye(1))
    body = BodyModel("nico", tree, np.ones(len(tree.joints)), covariance=known)
    save_body(body, tmp_path / "body.yaml")
    data = whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=2, hands=0)
    save_body_dataset(data, tmp_path / "data")
    words = ("choose-poses", tmp_path / "body.yaml", tmp_path / "data", "--marker", "bogus")
    done = command(*words, "--out", tmp_path / "poses.csv")
    assert_one_clear_line(done, said)


@pytest.mark.slow
def test_a_head_that_sees_nothing_of_the_arm_is_said_before_anything_is_recorded(
    tmp_path, command, monkeypatch
):
    near_sighted = replace(whole_recording.RENDERED, far=whole_recording.RENDERED.near)
    monkeypatch.setattr(whole_recording, "RENDERED", near_sighted)
    monkeypatch.setattr(body_poses, "_ROUNDS", 1)
    done = command("learn", "--head", "--arms", "right", "--out", tmp_path / "none")
    assert_one_clear_line(done, "the head hardly sees right_hand_fiducial: 0 of 2000 poses")
    assert not (tmp_path / "none").exists()


def test_a_recording_in_which_the_head_saw_nothing_of_the_arms_is_refused(tmp_path, command):
    data = whole_body_session(IMPERFECTIONS["clean"], 0, 0, looks=12, hands=0)
    known = np.array([marker.xyz is not None for marker in data.markers])
    table = data.observations
    table = table.select(known[table.marker])
    save_body_dataset(replace(data, observations=table), tmp_path / "room")
    done = command("calibrate", "body", tmp_path / "room", "--out", tmp_path / "none")
    assert_one_clear_line(done, "the cameras saw nothing that right_shoulder_pitch")
    assert not (tmp_path / "none").exists()
