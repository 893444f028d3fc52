"""Data sets to feed the command line, and a result."""

import pytest


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
    assert [done.returncode for done in made] == [0, 0], made
    return train, test


@pytest.fixture(scope="session")
def result(tmp_path_factory, command, recorded):
    """Return a result folder."""
    out = tmp_path_factory.mktemp("result") / "arm"
    train, test = recorded
    done = command("calibrate", "kinematics", train, "--test", test, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


@pytest.fixture
def servo(command, bus, config):
    """Return a function that runs a servo command on a module's bus with its configuration."""

    def run(*words, stdin=""):
        return command("servo", *words, "--port", bus.name, "--config", config, stdin=stdin)

    return run
