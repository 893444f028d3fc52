"""What every test shares: one BLAS thread, Hypothesis without a clock, the real measurements."""

import contextlib
import gc
import importlib
import io
import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path
from unittest import mock

# Before numpy is imported: two BLAS threads make small factorisations many times slower.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

import hypothesis
import pytest

from nico_selfmodel.cli.main import main

# The clock of a busy machine is no property of the code. CI must not depend on the day's luck.
quiet = hypothesis.settings(deadline=None, derandomize="CI" in os.environ)
hypothesis.settings.register_profile("project", quiet, max_examples=40)
hypothesis.settings.register_profile("thorough", quiet, max_examples=200)
hypothesis.settings.load_profile("project")

# Nothing that is imported or collected is ever let go: to look for it takes a quarter of the time.
gc.disable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """Let each of several processes load the tests from elsewhere on, if all are to be run.

    In a fresh checkout each has a part to compile, which the others then find compiled.
    """
    worker = getattr(session.config, "workerinput", None)
    if worker is None or session.config.args_source is not pytest.Config.ArgsSource.TESTPATHS:
        return
    paths = sorted(PROJECT_ROOT.glob("tests/*/test_*.py"))
    first = len(paths) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
    for path in (*paths[first:], *paths[:first]):
        # What is wrong with one is told where it is collected.
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(".".join(path.relative_to(PROJECT_ROOT).with_suffix("").parts))


def pytest_collection_finish():
    """From here on the garbage is collected, and what is there already is not looked through."""
    gc.freeze()
    gc.enable()


if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell lets what runs in its background ignore Ctrl-C; commands under test must hear it.
    signal.signal(signal.SIGINT, signal.default_int_handler)

PROJECT_ROOT = Path(__file__).resolve().parents[1]
CODE = "from nico_selfmodel.cli.main import main; main()"
SURROUNDINGS = {
    "OMP_NUM_THREADS": "1",
    "NO_COLOR": "1",
    "COLUMNS": "120",
    # Completion is for the shell that is named, not for whichever runs the tests.
    "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1",
}


@pytest.fixture(scope="session")
def project_root() -> Path:
    """Return the folder that holds pyproject.toml."""
    return PROJECT_ROOT


@pytest.fixture(scope="session")
def real_data_folder() -> Path:
    """Return the folder of real measurements, or skip the test with the reason."""
    named = os.environ.get("NICO_DATA")
    folder = Path(named) if named else PROJECT_ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        source = "$NICO_DATA" if named else "no $NICO_DATA, and"
        pytest.skip(f"no real measurements: {source} {folder} is not a folder")
    return folder


@pytest.fixture(scope="session")
def process():
    """Return a function that runs `nico-selfmodel` as a process of its own."""

    def run(*words, stdin=None, cwd=None):
        return subprocess.run(
            [sys.executable, "-W", "error::DeprecationWarning", "-c", CODE, *map(str, words)],
            capture_output=True,
            text=True,
            input=stdin,
            cwd=cwd,
            env={**os.environ, **SURROUNDINGS},
            timeout=120,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def command():
    """Return a function that runs `nico-selfmodel` here, which saves loading what it imports.

    It sees the same words and streams as `process` and ends with the same exit code, and draws
    nothing in its reports: what a command costs most is its figures, which other tests look at.
    """

    def run(*words, stdin=""):
        out, err, code = io.StringIO(), io.StringIO(), None
        words = list(map(str, words))
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            mock.patch.object(sys, "stdin", io.StringIO(stdin)),
            mock.patch.object(sys, "argv", ["nico-selfmodel", *words]),
            mock.patch.dict(os.environ, SURROUNDINGS),
            mock.patch("nico_selfmodel.viz.figures.plot_style.image_bytes", return_value=b"<svg/>"),
            warnings.catch_warnings(),
        ):
            # A warning is a line to a person here, not an error as in the other tests.
            warnings.simplefilter("default")
            warnings.simplefilter("error", DeprecationWarning)
            try:
                main()
            except SystemExit as end:
                code = end.code
        return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())

    return run
