"""A whole Nico by the command line: recorded, and refused in one line where something is wrong."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
from nico_selfmodel.dataset.folder import save_dataset
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.model.tree.body_model import load_body, save_body
from nico_selfmodel.sessions.whole_body import whole_body_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS

from ..estimation.bodies_before_mirrors import knowing_body
from .one_line import assert_one_clear_line


@pytest.mark.slow
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
        (["--arms", "three", "--head"], "no --arms 'three'; there are right, left, both"),
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


@pytest.mark.slow
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
        (
            (tmp_path / "one", "--model", model),
            "is unobservable: 1 reflection does not",
        ),
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


@pytest.fixture(scope="module")
def after_restart(tmp_path_factory):
    """A recording of a Nico whose left elbow lost its zero, and the body as it was."""
    folder = tmp_path_factory.mktemp("restart")
    world = IMPERFECTIONS["clean"]
    data = whole_body_session(world, 5, 1, looks=2, hands=3)
    body = knowing_body(world, 5, data)
    save_body(body, folder / "body.yaml")
    readings = data.readings.copy()
    i = body.tree.joints.index("left_elbow")
    readings[:, i] += np.radians(30.0) * body.tree.gear[i] / body.si_per_unit[i]
    save_body_dataset(replace(data, readings=readings), folder / "seen")
    save_body_dataset(data, folder / "before")
    return folder


@pytest.mark.slow
def test_zeros_of_a_whole_body_are_found_again(after_restart, command, tmp_path):
    model, out = after_restart / "body.yaml", tmp_path / "out"
    words = ("rezero", model, after_restart / "seen", "--joint", "left_elbow", "--out", out)
    done = command(*words)
    assert done.returncode == 0, done.stderr
    assert "the rest of the body fits" in done.stdout
    document = json.loads((out / "result.json").read_text("utf-8"))
    assert document["shift_deg"]["left_elbow"] == pytest.approx(-30.0, abs=1.0)
    assert "Before and after" in (out / "report.html").read_text("utf-8")
    assert command("evaluate", out, after_restart / "seen").returncode == 0
    wrong = command("rezero", model, after_restart / "seen", "--joint", "neck_yaw", "--out",
                    tmp_path / "wrong")  # fmt: skip
    assert wrong.returncode == 1
    assert "the rest of the body no longer fits" in wrong.stdout


@pytest.mark.slow
def test_a_tool_of_a_whole_body_is_learned(after_restart, command, tmp_path):
    body, out = load_body(after_restart / "body.yaml"), tmp_path / "out"
    kept = tuple(m for m in body.tree.markers if m.name != "left_finger_tip")
    save_body(replace(body, tree=body.tree.with_markers(kept)), tmp_path / "body.yaml")
    words = ("calibrate", "tool", after_restart / "before", "--model", tmp_path / "body.yaml")
    done = command(*words, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "tip of left_finger_tip" in done.stdout
    assert "left_finger_tip" in {m.name for m in load_body(out).tree.markers}


def test_what_a_body_cannot_learn_anew_is_one_clear_line(after_restart, command, tmp_path):
    model, seen, out = after_restart / "body.yaml", after_restart / "seen", tmp_path / "none"
    tool = ("calibrate", "tool", seen, "--model", model)
    for words, said in (
        (("rezero", model, seen, "--joint", "elbow"), "no joint 'elbow'"),
        (("rezero", model, seen, "--loss", "huber"), "--loss would change nothing"),
        (("rezero", model, tmp_path), "dataset.yaml"),
        (tool, "name it with --tool"),
        ((*tool, "--tool", "stick"), "no marker 'stick'"),
        ((*tool, "--free-body"), "--free-body would change nothing"),
    ):
        assert_one_clear_line(command(*words, "--out", out), said)
        assert not out.exists()
