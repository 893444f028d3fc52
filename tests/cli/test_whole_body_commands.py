"""A whole Nico by the command line: recorded, and refused in one line where something is wrong."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.folder import save_dataset
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..estimation.bodies_before_mirrors import knowing_body
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


@pytest.fixture(scope="module")
def before_mirrors(tmp_path_factory, command):
    """A Nico recorded by the command line, and the body that it is."""
    folder = tmp_path_factory.mktemp("mirrors")
    words = ("--imperfections", "clean", "--seed", "2", "--mirror", "glass", "--reflections", "4")
    done = command("simulate", "whole-body", *words, "--out", folder / "seen")
    assert done.returncode == 0, done.stderr
    data = load_body_dataset(folder / "seen")
    body = knowing_body(IMPERFECTIONS["clean"], 2, data)
    known = {**body.noise, **dict.fromkeys(body.tree.joints, 1e-4)}
    save_body(replace(body, noise=known), folder / "body.yaml")
    return folder


def test_a_mirror_before_a_moving_head_is_learned_and_kept(before_mirrors, command, tmp_path):
    data = load_body_dataset(before_mirrors / "seen")
    assert (len(data.sample), data.mirrors) == (4, ("glass",))
    model, out = before_mirrors / "body.yaml", tmp_path / "out"
    words = ("calibrate", "mirror", before_mirrors / "seen", "--model", model, "--out", out)
    done = command(*words, "--test-fraction", "0.25")
    assert done.returncode == 0, done.stderr
    assert "3 poses" in done.stdout
    assert "from the world's origin" in done.stdout
    (mirror,) = load_body(out).tree.mirrors
    assert mirror.plane.normal == pytest.approx([-0.94, 0.0, -0.342], abs=0.01)
    assert "mirrors/glass" in (out / "scene.json").read_text("utf-8")
    assert "mirror.glass.distance" in (out / "report.html").read_text("utf-8")
    assert command("evaluate", out, before_mirrors / "seen").returncode == 0
    assert "flat" in done.stdout
    table = data.observations
    (row, *_) = np.flatnonzero(table.mirror == "glass")
    marker, camera = (items[k].name for items, k in (
        (data.markers, table.marker[row]), (data.sensors, table.sensor[row])))  # fmt: skip
    encoders = ",".join(str(value) for value in data.readings[table.pose[row]])
    words = ("predict", out, "--encoders", encoders, "--marker", marker, "--json")
    (told,) = json.loads(command(*words).stdout)["markers"]
    found = [told[f"{camera}_in_glass_{axis}"] for axis in "uv"]
    assert found == pytest.approx(table.values[row, :2].tolist(), abs=3.0)
    unknown = command("evaluate", model, before_mirrors / "seen")
    assert_one_clear_line(unknown, "the body knows no mirror: learn it with")


def test_mirrors_that_a_body_cannot_learn_are_one_clear_line(before_mirrors, command, tmp_path):
    seen, model, out = before_mirrors / "seen", before_mirrors / "body.yaml", tmp_path / "none"
    body, data = load_body(model), load_body_dataset(seen)
    (tmp_path / "dark").mkdir()
    without = replace(body, tree=replace(body.tree, lenses={}))
    save_body(without, tmp_path / "dark" / "body.yaml")
    table = data.observations
    one = data.of_rows(np.flatnonzero(table.mirror != "")[:1])
    save_body_dataset(one, tmp_path / "one")
    save_body_dataset(data.of_rows(table.mirror == ""), tmp_path / "direct")
    save_dataset(mirror_body(2).watch("middle", 4), arm := tmp_path / "arm")
    for words, said in (
        ((seen, "--model", tmp_path / "dark"), "has no cameras"),
        ((tmp_path / "one", "--model", model), "is unobservable: 1 sight of reflections"),
        ((tmp_path / "direct", "--model", model), "has no reflection"),
        ((seen, "--model", model, "--loss", "huber"), "--loss would change nothing"),
        ((arm, "--model", model), "not a self-model"),
    ):
        assert_one_clear_line(command("calibrate", "mirror", *words, "--out", out), said)
        assert not out.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--reflections", "3"], "give --mirror"),
        (["--mirror", "a", "--mirror", "a=300,0,0"], "two mirrors have one name"),
        (["--mirror", "a=-1,0,0"], "a positive distance"),
        pytest.param(["--mirror", "a=300,0,170"], "hardly sees", marks=pytest.mark.slow),
    ],
)
def test_mirrors_that_cannot_stand_there_are_refused(tmp_path, command, words, said):
    done = command("simulate", "whole-body", *words, "--out", tmp_path / "none")
    assert_one_clear_line(done, said)
    assert not (tmp_path / "none").exists()
