"""The commands do what their help says."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from nico_selfmodel.cli import printer
from nico_selfmodel.dataset.folder import load_dataset, save_dataset
from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.plant import ArmDescription


def test_the_result_folder_is_complete_and_consistent(result):
    document = json.loads((result / "result.json").read_text())
    keys = {"status", "reasons", "train", "test", "cross_validation", "parameters"}
    keys |= {"not_identifiable", "outliers", "seconds", "iterations", "converged"}
    assert keys <= set(document)
    statistics = {"mean", "sd", "rms", "median", "p95", "max"}
    for part in ("train", "test", "cross_validation"):
        assert set(document[part]["position_mm"]) == statistics
    for entry in document["parameters"].values():
        assert {"value", "sigma", "unit", "free"} == set(entry)
    model = load_model(result)
    values = dict(zip(model.parameters.names, model.parameters.values, strict=True))
    for name in ("right_elbow.gear", "right_elbow.r", "M0.x"):
        assert document["parameters"][name]["value"] == values[name]


@pytest.mark.slow
def test_without_a_report_all_else_is_the_same(recorded, tmp_path, command, result):
    out = tmp_path / "arm"
    train, test = recorded
    done = command("calibrate", "kinematics", train, "--test", test, "--out", out, "--no-report")
    assert done.returncode == 0
    left_out = {"report.html", "residuals.csv", "scene.json"}
    assert {path.name for path in out.iterdir()} == {p.name for p in result.iterdir()} - left_out
    with_report, without = (json.loads((f / "result.json").read_text()) for f in (result, out))
    assert without["parameters"] == with_report["parameters"]
    assert command("view", out).returncode == 2


@pytest.mark.slow
def test_nothing_held_out_is_not_evaluated(recorded, tmp_path, command):
    out = tmp_path / "arm"
    done = command("calibrate", "kinematics", recorded[0], "--out", out, "--json")
    assert done.returncode == 0
    document = json.loads(done.stdout)
    assert document["status"] == "NOT_EVALUATED"
    assert document["test"] is None
    assert document["cross_validation"]["n"] > 100


def test_a_bound_that_is_missed_fails_with_exit_code_1_and_a_whole_folder(
    recorded, tmp_path, command
):
    out = tmp_path / "arm"
    done = command(
        *("calibrate", "kinematics", recorded[0], "--test", recorded[1]),
        *("--require-test-mm", "0.01", "--out", out, "--method", "circle-points"),
    )
    assert done.returncode == 1
    document = json.loads((out / "result.json").read_text())
    assert document["status"] == "FAIL"
    assert any("0.01" in reason for reason in document["reasons"])
    assert (out / "report.html").is_file()


@pytest.mark.slow
def test_a_freed_gauge_is_named_and_fails(recorded, tmp_path, command):
    out = tmp_path / "arm"
    done = command(
        "calibrate", "kinematics", recorded[0], "--free", "right_elbow.alpha", "--out", out
    )
    assert done.returncode == 1, done.stderr
    document = json.loads((out / "result.json").read_text())
    assert document["status"] == "FAIL"
    assert any("right_elbow.alpha" in words for words in document["not_identifiable"])


def test_evaluate_and_predict_agree_with_the_library(result, recorded, command):
    test = load_dataset(recorded[1])
    model = load_model(result)
    done = command("evaluate", result, recorded[1], "--json")
    predicted = model.predict(test.encoders)
    distances = np.linalg.norm(predicted.p_WH - test.p_WH_measured, axis=1)
    distances = distances[np.isfinite(distances)]
    found = json.loads(done.stdout)["position_mm"]["mean"]
    assert found == pytest.approx(1e3 * distances.mean())
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow(model.joints)
    writer.writerows(test.encoders[:3])
    done = command("predict", result, "--table", "-", stdin=table.getvalue())
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert len(rows) == 3
    assert {row["frame"] for row in rows} == {"tracker"}
    p = [[float(row[name]) for name in ("x_m", "y_m", "z_m")] for row in rows]
    np.testing.assert_allclose(p, predicted.p_WH[:3], atol=1e-15)
    sigma = [float(row["sigma_mm"]) for row in rows]
    np.testing.assert_allclose(sigma, 1e3 * predicted.sigma[:3])


def test_evaluate_says_whether_the_error_is_that_of_the_training(result, recorded, command):
    done = command("evaluate", result, recorded[1])
    assert done.returncode == 0, done.stderr
    assert "PASS" in done.stdout
    assert "is that of the training poses" in done.stdout
    document = json.loads(command("evaluate", result, recorded[1], "--json").stdout)
    assert document["status"] == "PASS"
    assert document["reasons"][0] in done.stdout


def test_a_body_that_changed_since_fails_with_exit_code_1(result, recorded, tmp_path, command):
    data = load_dataset(recorded[1])
    moved = replace(data, p_WH_measured=data.p_WH_measured + np.array([0.01, 0.0, 0.0]))
    save_dataset(moved, tmp_path / "moved")
    done = command("evaluate", result, tmp_path / "moved")
    assert done.returncode == 1
    assert "FAIL" in done.stdout
    assert "something moved between recordings" in done.stdout


def test_poses_worth_recording_are_written_as_a_table_that_predict_reads(
    result, recorded, command, tmp_path
):
    table = tmp_path / "poses.csv"
    words = ("choose-poses", result, recorded[0], "--out", table)
    done = command(*words, "--count", 6, "--json")
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    assert 0.0 < said["sigma_after_mm"] < said["sigma_before_mm"]
    predicted = command("predict", result, "--table", table, "--json")
    assert len(json.loads(predicted.stdout)["poses"]) == 6
    refused = command(*words)
    assert refused.returncode == 2
    assert "exists already" in refused.stderr


def test_poses_chosen_by_data_of_another_robot_come_with_a_warning(
    result, recorded, command, tmp_path
):
    data = load_dataset(recorded[0])
    save_dataset(replace(data, p_WH_measured=data.p_WH_measured[::-1]), tmp_path / "other")
    words = ("choose-poses", result, tmp_path / "other", "--out", tmp_path / "poses.csv")
    done = command(*words, "--count", 2)
    assert done.returncode == 0
    assert "warning: the data contradict the model: the error" in done.stderr
    assert f"next  nico-selfmodel record --poses {tmp_path / 'poses.csv'}" in done.stdout


def test_a_prediction_far_from_the_training_comes_with_a_warning(result, recorded, command):
    train = load_dataset(recorded[0])
    within = ",".join(map(str, np.median(train.encoders, axis=0)))
    done = command("predict", result, "--encoders", within)
    assert (done.returncode, done.stderr) == (0, "")
    lowest, highest = train.encoders.min(axis=0), train.encoders.max(axis=0)
    far = highest + 0.3 * (highest - lowest) * (np.arange(4) == 2)
    done = command("predict", result, "--encoders", within, "--encoders", ",".join(map(str, far)))
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) == 3
    (warning,) = done.stderr.splitlines()
    assert warning.startswith("nico-selfmodel: warning: readings far outside the training data")
    assert train.joint_names[2] in warning
    assert train.joint_names[1] not in warning


def test_the_exported_urdf_holds_the_learned_arm(result, tmp_path, command):
    out = tmp_path / "learned.urdf"
    assert command("export-urdf", result, "--out", out).returncode == 0
    assert "<robot" in out.read_text()
    assert command("export-urdf", result, "--out", out).returncode == 2
    assert command("export-urdf", result, "--out", out, "--force").returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["left_arm", "neck"])
def test_other_chains_of_nico_are_learned_the_same_way(arm, tmp_path, command):
    out = tmp_path / "arm"
    done = command("learn", "--arm", arm, "--out", out, "--random", 60, "--json")
    assert done.returncode == 0, done.stdout[-800:] + done.stderr
    document = json.loads(done.stdout)
    joints = ArmDescription.named("nico", arm).joints
    assert all(f"{joint}.gear" in document["parameters"] for joint in joints)


def test_a_csv_is_imported_by_a_column_map(tmp_path, command):
    (tmp_path / "table.csv").write_text("a,b,px,py,pz\n1,2,100,200,300\n3,4,110,210,310\n")
    columns = {
        "joints": [
            {"name": "first", "column": "a", "encoder_unit": "deg"},
            {"name": "second", "column": "b", "encoder_unit": "deg"},
        ],
        "point": {"x": "px", "y": "py", "z": "pz", "unit": "mm"},
    }
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(columns))
    done = command(
        "import",
        "csv",
        tmp_path / "table.csv",
        "--map",
        tmp_path / "map.yaml",
        "--out",
        tmp_path / "d",
    )
    assert done.returncode == 0, done.stderr
    data = load_dataset(tmp_path / "d")
    np.testing.assert_allclose(data.p_WH_measured, [[0.1, 0.2, 0.3], [0.11, 0.21, 0.31]])


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("learn",),
        ("simulate", "motion-capture"),
        ("import", "csv"),
        ("import", "vicon"),
        ("calibrate", "kinematics"),
        ("evaluate",),
        ("predict",),
        ("export-urdf",),
        ("view",),
        ("experiment", "motion-capture"),
    ],
)
def test_every_command_explains_itself(words, command):
    done = command(*words, "--help")
    assert done.returncode == 0
    assert "Usage" in done.stdout


@pytest.mark.slow
def test_the_motion_capture_experiment_writes_tables_and_charts(tmp_path, command):
    out = tmp_path / "chapter6"
    done = command("experiment", "motion-capture", "--out", out, "--robots", 1, "--repeats", 3)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in out.iterdir()}
    assert names == {
        "result.json",
        "tables.md",
        "circle_points_and_refined.png",
        "random_samples.png",
    }
    assert "132.60" in (out / "tables.md").read_text()


def test_a_table_in_a_pipe_is_as_wide_as_it_must_be_and_loses_no_word(capsys):
    words = [
        "fiducial, arm and cameras refined together",
        *(f"{k}.00 (0.50) / 3.00" for k in range(9)),
    ]
    printer.table("errors [mm]", [f"column {k}" for k in range(10)], [words])
    said = capsys.readouterr().out
    assert all(word in said for word in words)
    assert "errors [mm]" in said
