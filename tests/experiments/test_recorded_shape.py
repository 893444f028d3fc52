"""The shape of links from a recording of one's own: what it takes, and what it gives."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.plant.robots import ROBOTS
from nico_selfmodel.sessions.mirrors import recorded_shape
from nico_selfmodel.sessions.mirrors.recorded_shape import shape_of_recording

from ..cli.one_line import assert_one_clear_line
from .test_own_pictures import empty, kept, poses, true_model


def test_all_that_hangs_on_a_link_counts_to_it_unless_its_shape_is_learned_too():
    tree = KinematicTree.from_urdf(ROBOTS["nico"].urdf)
    assert recorded_shape.ends(tree, ["head", "chest"]) == ("head",)
    assert recorded_shape.ends(tree, ["chest"]) == ("chest",)


def test_a_recording_that_tells_no_shape_says_why(tmp_path, command):
    folder = kept(tmp_path / "own", poses(), empty())
    model, rng = true_model(), np.random.default_rng(0)
    alone = replace(model, mirrors={})
    with pytest.raises(EstimationError, match="in 1 mirrors, a shape takes 6"):
        shape_of_recording(alone, poses(), folder, ["head"], rng)
    save_model(alone, tmp_path / "model.yaml")
    words = ("calibrate", "shape", folder, "--model", tmp_path / "model.yaml", "--link", "head")
    done = command(*words, "--out", tmp_path / "out")
    assert_one_clear_line(done, "a shape takes 6")
    assert not (tmp_path / "out").exists()
