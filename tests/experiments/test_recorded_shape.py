"""The shape of links from a recording of one's own: what it takes, and what it gives."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from nico_selfmodel.errors import EstimationError
from nico_selfmodel.model.self_model_file import save_model
from nico_selfmodel.model.shape.shape_folder import load_shape
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.mirrors import recorded_shape
from nico_selfmodel.sessions.mirrors.recorded_shape import shape_of_recording

from ..cli.one_line import assert_one_clear_line
from .test_own_pictures import empty, kept, nico, poses, true_model


def test_all_that_hangs_on_a_link_counts_to_it_unless_its_shape_is_learned_too():
    tree = KinematicTree.from_urdf(nico().arm.urdf)
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


@pytest.mark.slow
def test_links_have_their_shape_by_the_commands_of_the_guide(tmp_path, command):
    model, looks, out = tmp_path / "model.yaml", tmp_path / "looks", tmp_path / "shaped"
    save_model(replace(true_model(), mirrors={}), model)
    mirrors = [
        word
        for k, (x, y) in enumerate(product((-27, -9, 9, 27), (-24, 10)))
        for word in ("--mirror", f"m{k}={(220, 280)[k % 2]},{x},{y}")
    ]
    recorded = command(
        *("record", "--cameras", model, "--seed", 2, "--imperfections", "clean", *mirrors),
        *("--glass-size", "1400,1400", "--random", 4, "--images", "--out", looks),
    )
    assert recorded.returncode == 0, recorded.stderr
    words = ("calibrate", "shape", looks, "--model", model, "--link", "head", "--out", out)
    done = command(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "shape of head, in " in done.stdout
    head = load_shape(out / "body").links["head"]
    assert head.seen.sum() > 500
    with nico().station(0) as station:
        truth = station.surfaces_true(station.CreateDefaultContext())["head"][0]
    off = np.abs(truth.distance(head.mesh.vertices[head.seen]))
    assert np.median(off) < 2e-3
    assert 0.0 < np.median(head.sigma[head.seen]) < 3e-3
