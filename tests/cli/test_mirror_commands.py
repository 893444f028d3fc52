"""Mirrors at the command line: learned, asked, and refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.dataset.folder import save_dataset
from nico_selfmodel.experiments.mirror_body import mirror_body
from nico_selfmodel.model.self_model_file import load_model, save_model


@pytest.fixture(scope="module")
def body():
    return mirror_body(2)


@pytest.fixture(scope="module")
def inputs(body, tmp_path_factory):
    """Return a folder with a body, training and test data."""
    folder = tmp_path_factory.mktemp("mirror")
    save_model(body.calibrated(), folder / "body.yaml")
    save_dataset(body.watch("middle", 12, session=1), folder / "train")
    save_dataset(body.watch("middle", 30, session=2), folder / "test")
    return folder


@pytest.fixture(scope="module")
def result(command, inputs, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "result"
    words = ("--model", inputs / "body.yaml", "--test", inputs / "test", "--out", out)
    done = command("calibrate", "mirror", inputs / "train", *words)
    assert done.returncode == 0, done.stderr
    return out, done


def test_a_mirror_is_learned_and_lies_in_the_self_model(result, body):
    out, done = result
    assert "PASS" in done.stdout
    assert "middle" in done.stdout
    assert {p.name for p in out.iterdir()} == {
        "self_model.yaml", "result.json", "report.html", "residuals.csv", "scene.json",
        "calibrated_body_2_learned.urdf",
    }  # fmt: skip
    mirror = load_model(out).mirrors["middle"]
    assert np.degrees(mirror.angle_to(body.ground_truth.mirrors["middle"])) < 0.15
    assert mirror.covariance is not None
    document = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert document["status"] == "PASS"
    assert document["test"]["pixels"]["mean"] < 1.0


def test_the_report_says_the_verdict_and_loads_nothing(result):
    text = (result[0] / "report.html").read_text(encoding="utf-8")
    assert "What a body learned about a mirror" in text
    assert "mirror.middle.distance" in text
    assert 'src="http' not in text


def test_a_thing_seen_in_the_mirror_is_located(command, result, body):
    out, _ = result
    seen = body.watch("middle", 1, session=5)
    p = load_model(out).predict(seen.encoders).p_WH[0]
    word = ",".join(f"{v:.3f}" for v in seen.pixels[0])
    done = command("locate", out, "--mirror", "middle", f"--pixels={word}", "--json")
    assert done.returncode == 0, done.stderr
    (place,) = json.loads(done.stdout)["places"]
    miss = np.array([place["x_m"], place["y_m"], place["z_m"]]) - p
    assert 1e3 * np.linalg.norm(miss) < 5.0 * place["sigma_mm"] + 10.0
    assert place["sigma_along_mm"] > place["sigma_across_mm"]
    shown = command("locate", out, "--mirror", "middle", f"--pixels={word}")
    assert "seen in mirror middle" in shown.stdout


@pytest.mark.slow
def test_nothing_is_located_in_a_mirror_that_failed(command, inputs, body, tmp_path):
    """The self-model says so itself, until the mirror passes."""
    out, again = tmp_path / "failed", tmp_path / "passed"
    words = ("--model", inputs / "body.yaml", "--test", inputs / "test")
    command(
        "calibrate", "mirror", inputs / "train", *words, "--out", out, "--require-test-px", 0.01
    )
    seen = ",".join(f"{v:.3f}" for v in body.watch("middle", 1, session=5).pixels[0])
    done = command("locate", out, "--mirror", "middle", f"--pixels={seen}")
    assert done.returncode == 2
    assert "mirror 'middle' failed its calibration (mean held-out error" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    words = ("--model", out, "--test", inputs / "test", "--out", again)
    assert command("calibrate", "mirror", inputs / "train", *words).returncode == 0
    assert command("locate", again, "--mirror", "middle", f"--pixels={seen}").returncode == 0


def test_json_is_the_result_file(command, inputs, tmp_path):
    out = tmp_path / "result"
    words = ("--model", inputs / "body.yaml", "--test-fraction", "0.3", "--out", out, "--json")
    done = command("calibrate", "mirror", inputs / "train", *words)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((out / "result.json").read_text("utf-8"))


def test_a_missed_bound_fails_and_writes_its_folder(command, inputs, tmp_path):
    out = tmp_path / "result"
    words = ("--model", inputs / "body.yaml", "--test", inputs / "test", "--out", out)
    done = command("calibrate", "mirror", inputs / "train", *words, "--require-test-px", "0.01")
    assert done.returncode == 1
    assert "FAIL" in done.stdout
    assert (out / "result.json").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--require-test-px", "-1"), "must be a positive number"),
        (("--test-fraction", "0.3", "--test", "{test}"), "not both"),
        (("--test", "{train}"), "nothing would be held out"),
        (("--joint-sigma-deg", "-1"), "joint_sigma must lie between 0 and pi"),
        (("--loss", "mean"), "no loss 'mean'"),
    ],
)
def test_options_that_make_no_sense_are_refused(command, inputs, tmp_path, options, message):
    words = [w.format(test=inputs / "test", train=inputs / "train") for w in options]
    out = tmp_path / "result"
    done = command(
        "calibrate", "mirror", inputs / "train", "--model", inputs / "body.yaml", "--out", out,
        *words,
    )  # fmt: skip
    assert done.returncode == 2
    assert message in done.stderr
    assert not out.exists()


def test_bad_data_are_one_clear_line(command, inputs, body, tmp_path):
    arm_alone = replace(body.calibrated(), cameras={})
    save_model(arm_alone, tmp_path / "arm.yaml")
    direct = body.watch("", 8)
    save_dataset(replace(direct, mirror=np.full(8, "middle")), tmp_path / "direct")
    out = tmp_path / "result"
    for data, model, message in (
        (inputs / "train", tmp_path / "arm.yaml", "no cameras"),
        (tmp_path / "direct", inputs / "body.yaml", "show the hand itself"),
        (inputs / "train", tmp_path / "none.yaml", "does not exist"),
    ):
        done = command("calibrate", "mirror", data, "--model", model, "--out", out)
        assert done.returncode == 2
        assert message in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
        assert not out.exists()


def test_a_place_that_cannot_be_is_refused(command, result, inputs):
    out, _ = result
    for words, message in (
        (("--mirror", "wall", "--pixels", "1,2,3,4"), "there are middle"),
        (("--mirror", "middle", "--pixels", "1,2,3"), "got 3 numbers"),
        (("--mirror", "middle", "--pixels", "a,2,3,4"), "--pixels a,2,3,4: 'a' is not a number"),
        (("--mirror", "middle", "--pixels", "100,200,500,200"), "no reflection"),
        (("--mirror", "middle", "--pixels", "1,2,3,4", "--pixel-sigma", "0"), "positive number"),
    ):
        done = command("locate", out, *words)
        assert done.returncode == 2
        assert message in done.stderr
    done = command("locate", inputs / "body.yaml", "--mirror", "m", "--pixels", "1,2,3,4")
    assert "calibrate mirror" in done.stderr
