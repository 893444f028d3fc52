"""Many recordings, one command, one table: the same whoever does the work."""

import csv
import json
import shutil
import subprocess
from pathlib import Path

import pytest

from nico_selfmodel.model.self_model_file import load_model


@pytest.fixture(scope="module")
def recordings(tmp_path_factory, recorded):
    """Return a folder with recordings of two robots, one of which is spoilt."""
    folder = tmp_path_factory.mktemp("many") / "data"
    for name in ("first/monday", "first/tuesday", "second/monday"):
        shutil.copytree(recorded[0], folder / name)
    (folder / "second" / "monday" / "samples.csv").write_text("sample\n")
    return folder


def table(out):
    with (out / "table.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def learn(command, data, out, *words):
    held = ("--test-fraction", "0.3", "--method", "circle-points")
    return command("calibrate", "kinematics", data, *held, "--out", out, *words)


@pytest.fixture(scope="module")
def learned(recordings, tmp_path_factory, command):
    out = tmp_path_factory.mktemp("results") / "all"
    return out, learn(command, recordings, out)


def test_each_has_a_result_and_a_row_and_one_that_is_spoilt_stops_no_other(learned):
    out, done = learned
    assert done.returncode == 1
    rows = {row["dataset"]: row for row in table(out)}
    assert list(rows) == ["first/monday", "first/tuesday", "second/monday"]
    assert [row["verdict"] for row in rows.values()] == ["PASS", "PASS", "REFUSED"]
    assert "no rows below the header" in rows["second/monday"]["reason"]
    for name in ("first/monday", "first/tuesday"):
        document = json.loads((out / name / "result.json").read_text())
        mean = document["test"]["position_mm"]["mean"]
        assert float(rows[name]["held_out_mean_mm"]) == mean
        assert (out / name / "report.html").is_file()
        assert load_model(out / name).has_arm
        assert document["run"]["command"].startswith("nico-selfmodel calibrate kinematics ")
    document = json.loads((out / "result.json").read_text())
    assert document["status"] == "FAIL"
    assert document["reasons"][0] == "of 3 recordings: 2 PASS, 1 REFUSED"
    assert "second/monday" in done.stdout


@pytest.mark.slow
def test_processes_give_the_same_table(learned, recordings, tmp_path, process):
    done = learn(process, recordings, tmp_path / "out", "--processes", "2")
    assert done.returncode == 1, done.stderr
    assert table(tmp_path / "out") == table(learned[0])


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_dask_cluster_gives_the_same_table(learned, recordings, tmp_path, command):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        address = cluster.scheduler_address
        done = learn(command, recordings, tmp_path / "out", "--dask", address)
    assert done.returncode == 1, done.stderr
    assert table(tmp_path / "out") == table(learned[0])


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_dask_address_that_does_not_answer_is_one_line(address, recordings, tmp_path, command):
    pytest.importorskip("distributed")
    done = learn(command, recordings, tmp_path / "out", "--dask", address)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert f"no Dask scheduler answers at {address}" in line
    assert list(tmp_path.iterdir()) == []


def test_a_dask_cluster_for_one_data_set_is_refused(recordings, tmp_path, command):
    done = learn(command, recordings / "first" / "monday", tmp_path / "out", "--dask", "tcp://x:1")
    assert done.returncode == 2
    assert "--dask is for many data sets, got one" in done.stderr


@pytest.mark.slow
def test_names_are_paths_below_what_recordings_have_in_common(recordings, tmp_path, command):
    one, two = recordings / "first" / "monday", recordings / "second"
    done = command(
        *("calibrate", "kinematics", one, two, "--starts", "1", "--out", tmp_path / "out", "--json")
    )
    document = json.loads(done.stdout)
    assert [row["dataset"] for row in document["recordings"]] == ["first/monday", "second/monday"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--test", "FIRST"), "--test and --name are for one data set"),
        (("--name", "x"), "--test and --name are for one data set"),
        (("RECORDINGS",), "is given twice: leave one of them out"),
    ],
)
def test_options_of_one_data_set_are_refused_of_many(words, reason, recordings, tmp_path, command):
    named = {"FIRST": recordings / "first" / "monday", "RECORDINGS": recordings}
    words = [named.get(word, word) for word in words]
    done = command("calibrate", "kinematics", recordings, *words, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert reason in done.stderr


@pytest.mark.slow
def test_the_pipeline_of_the_examples_ends_in_an_exit_code(project_root, tmp_path, monkeypatch):
    script = project_root / "examples" / "pipeline" / "calibrate_recordings.sh"
    place = tmp_path / "bin"
    place.mkdir()
    import sys

    (place / "nico-selfmodel").write_text(
        f"#!/bin/sh\nexec {sys.executable} -c "
        "'from nico_selfmodel.cli.main import main; main()' \"$@\"\n"
    )
    (place / "nico-selfmodel").chmod(0o755)
    monkeypatch.setenv("PATH", f"{place}:/usr/bin:/bin")
    monkeypatch.setenv("PROCESSES", "1")

    def code(data):
        words = [script, data, tmp_path / "results"]
        return subprocess.run(words, capture_output=True, check=False, cwd=project_root).returncode

    assert code(Path("examples/data")) == 0
    assert {row["verdict"] for row in table(tmp_path / "results")} == {"PASS"}
    spoilt = tmp_path / "data"
    shutil.copytree(project_root / "examples" / "data", spoilt)
    (spoilt / "franka_fr3" / "samples.csv").write_text("sample\n")
    assert code(spoilt) == 1
    assert code(tmp_path / "nothing") == 2
