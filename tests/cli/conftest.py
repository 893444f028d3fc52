"""The command line as a process, and data sets to feed it."""

import os
import subprocess
import sys

import pytest

CODE = "from nico_selfmodel.cli import main; main()"


@pytest.fixture(scope="session")
def command():
    """Return a function that runs `nico-selfmodel` as a process."""

    def run(*words, stdin=None, cwd=None):
        return subprocess.run(
            [sys.executable, "-W", "error::DeprecationWarning", "-c", CODE, *map(str, words)],
            capture_output=True,
            text=True,
            input=stdin,
            cwd=cwd,
            env={**os.environ, "OMP_NUM_THREADS": "1", "NO_COLOR": "1", "COLUMNS": "120"},
            timeout=120,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def recorded(tmp_path_factory, command):
    """Return folders of a training and a test data set of one simulated arm."""
    folder = tmp_path_factory.mktemp("recorded")
    train, test = folder / "train", folder / "test"
    made = [
        command("simulate", "motion-capture", "--out", train, "--random", 40, "--seed", 3),
        command(
            *("simulate", "motion-capture", "--out", test, "--seed", 3, "--session", 1),
            *("--circle-points", 0, "--random", 40),
        ),
    ]
    assert [process.returncode for process in made] == [0, 0], made
    return train, test


@pytest.fixture(scope="session")
def result(tmp_path_factory, command, recorded):
    """Return a result folder."""
    out = tmp_path_factory.mktemp("result") / "arm"
    train, test = recorded
    process = command("calibrate", "kinematics", train, "--test", test, "--out", out)
    assert process.returncode == 0, process.stdout + process.stderr
    return out
