"""Commands on a body one of whose joints follows another."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.body.sensors import SensorInfo
from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
from nico_selfmodel.estimation.tree.tree_result import body_model
from nico_selfmodel.model.tree.body_model import save_body

from ..estimation.simulated_trees import assembled, observed, serial, tags


@pytest.fixture(scope="module")
def learned(tmp_path_factory):
    """A recording before a tracker of an arm whose third joint follows the second, and the body."""
    folder, rng = tmp_path_factory.mktemp("follows"), np.random.default_rng(2)
    joints, frames = serial(rng, ["j1", "j2", "j3", "j4"], "world", 0.5)
    joints[2] = replace(joints[2], follows={"j2": -1.0})
    markers, attached = tags(rng, "hand", "j4", 2)
    sensors = [SensorInfo("tracker", "points")]
    tree = assembled(joints, frames, markers, attached, sensors, [np.eye(4)], {})
    q = rng.uniform(-1.2, 1.2, size=(30, 4))
    q[:, 2] = 0.0
    how = {"joint_sigma": 1e-3, "sigma": {"points": 2e-4}}
    data = observed(tree, joints, markers, sensors, q, rng, **how)
    q[:, 2] = np.nan
    data = replace(data, readings=q)
    save_body_dataset(data, folder / "data")
    save_body(body_model(calibrate_tree(data, effects=())), folder / "body.yaml")
    return folder


def test_poses_are_chosen_for_the_joints_that_are_read_and_are_read_again(
    learned, tmp_path, command
):
    words = ("choose-poses", learned / "body.yaml", learned / "data", "--count", 3, "--json")
    done = command(*words, "--out", tmp_path / "poses.csv")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "poses.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["encoder.j1", "encoder.j2", "encoder.j4"]
    chosen = np.array(rows[1:], dtype=float)
    assert json.loads(done.stdout)["poses"] == pytest.approx(chosen)
    next_ones = [",".join([sample, *row]) for sample, row in zip("012", rows[1:], strict=True)]
    header = ",".join(["sample", *rows[0]])
    (learned / "data" / "poses.csv").write_text("\n".join([header, *next_ones]) + "\n")
    observations = learned / "data" / "observations.csv"
    of_them = [line for line in observations.read_text().splitlines() if line[:2] in OF_THEM]
    observations.write_text("\n".join(of_them) + "\n")
    again = load_body_dataset(learned / "data")
    assert again.readings[:, [0, 1, 3]] == pytest.approx(chosen)


OF_THEM = ("sa", "0,", "1,", "2,")
"""How lines of the first three samples begin."""
