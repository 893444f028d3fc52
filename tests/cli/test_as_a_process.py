"""The command line as a person meets it: a process with streams and an exit code."""

import io
import json
import subprocess
import sys

import pytest

from nico_selfmodel.dataset.folder import load_dataset
from nico_selfmodel.model.self_model_file import load_model

# What takes longest to load: nobody who asks for help or mistypes a name waits for it.
SLOW_TO_LOAD = {"cv2", "matplotlib", "meshcat", "numpy", "pydrake"}


def loaded_by(words):
    """Return the exit code of a command and which slow packages it loaded."""
    code = (
        "import sys\n"
        "from nico_selfmodel.cli.main import main\n"
        "try:\n    main()\n"
        f"except SystemExit as end:\n    print(end.code, *{SLOW_TO_LOAD} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True, check=True
    )
    number, *packages = done.stdout.strip().splitlines()[-1].split()
    return int(number), set(packages)


@pytest.mark.parametrize("words", [("--help",), ("calibrate", "kinematics", "--help")])
def test_help_loads_nothing_that_is_slow(words):
    assert loaded_by(words) == (0, set())


def test_python_runs_the_package_as_the_command():
    words = [sys.executable, "-m", "nico_selfmodel", "--version"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout.strip().startswith("nico-selfmodel ")


def test_a_refusal_loads_no_more_than_it_looks_at(tmp_path):
    there = tmp_path / "there"
    there.mkdir()
    out = ("--out", tmp_path / "out")
    assert loaded_by(("learn", "--out", there)) == (2, set())
    for words in (
        ("learn", "--imperfections", "moon"),
        ("calibrate", "kinematics", tmp_path / "nothing"),
    ):
        code, packages = loaded_by((*words, *out))
        assert code == 2
        assert not packages & {"matplotlib", "meshcat"}


def test_a_command_ends_without_looking_for_what_refers_to_itself():
    """What ends with the process need not be found first: that took a fifth of a report."""
    code = (
        "import atexit, gc\n"
        "atexit.register(lambda: print(gc.get_freeze_count() > 10_000, len(gc.get_objects())))\n"
        "from nico_selfmodel.cli.main import main\n"
        "main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "--version"], capture_output=True, text=True, check=True
    )
    frozen, left = done.stdout.splitlines()[-1].split()
    assert frozen == "True"
    assert int(left) < 100


@pytest.mark.slow
def test_learn_writes_a_result_that_passes(tmp_path, process, command):
    out = tmp_path / "arm"
    done = process("learn", "--sensor", "motion-capture", "--out", out, "--random", 60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(line.endswith(": done") for line in done.stderr.splitlines())
    assert "PASS" in done.stdout
    assert str(out / "report.html") in done.stdout.replace("\n", "")
    names = {path.name for path in out.iterdir()}
    assert {"self_model.yaml", "result.json", "report.html", "nico_learned.urdf"} <= names
    document = json.loads((out / "result.json").read_text())
    assert document["status"] == "PASS"
    assert document["test"]["position_mm"]["mean"] < 4.0
    assert document["not_identifiable"] == []
    again = command(
        *("calibrate", "kinematics", out / "recordings" / "train"),
        *("--test", out / "recordings" / "test", "--out", tmp_path / "again", "--json"),
    )
    assert again.returncode == 0, again.stderr
    ours, theirs = document["test"]["position_mm"], json.loads(again.stdout)["test"]["position_mm"]
    assert ours["mean"] == pytest.approx(theirs["mean"], rel=1e-3)


def test_bad_data_end_in_one_line_on_the_error_stream(recorded, tmp_path, process):
    folder = tmp_path / "nothing"
    done = process("calibrate", "kinematics", folder, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("nico-selfmodel: ")
    assert len(done.stderr.strip().splitlines()) == 1
    assert str(folder) in done.stderr


def test_a_table_goes_in_and_predictions_come_out(result, recorded, process):
    model, test = load_model(result), load_dataset(recorded[1])
    table = io.StringIO()
    table.write(",".join(model.joints) + "\n")
    table.write(",".join(map(str, test.encoders[0])) + "\n")
    done = process("predict", result, "--table", "-", stdin=table.getvalue())
    assert done.returncode == 0, done.stderr
    x, y, z = map(float, done.stdout.splitlines()[1].split(",")[:3])
    assert (x, y, z) == pytest.approx(tuple(model.predict(test.encoders[0]).p_WH[0]), abs=1e-15)
