"""A whole Nico that learns itself through rendered pictures, from the command line."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset
from nico_selfmodel.model.tree.body_model import BodyModel, load_body, save_body
from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS, looking_body

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


def test_a_body_with_joints_that_the_robot_does_not_command_is_not_recorded(tmp_path, command):
    tree = looking_body().tree
    renamed = tuple("tail" if name == "left_wrist" else name for name in tree.joints)
    body = BodyModel("nico", replace(tree, joints=renamed), np.ones(len(renamed)))
    save_body(body, tmp_path / "body.yaml")
    words = ("record", "--cameras", tmp_path / "body.yaml", "--random", 2)
    refused = command(*words, "--out", tmp_path / "none")
    assert_one_clear_line(refused, "the joints tail, which this robot does not command")
    assert not (tmp_path / "none").exists()
