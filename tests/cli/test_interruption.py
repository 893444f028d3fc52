"""Ctrl-C, while modules load and later: one line, and the exit code of what was stopped."""

import subprocess
import sys

import pytest

STOPPED_LOADING = """
import sys
class Stop:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt as stop:
                if {wrapped!r}:
                    raise ImportError("initialization failed") from stop
                raise
sys.meta_path.insert(0, Stop())
from nico_selfmodel.cli.main import main
main()
"""


@pytest.mark.parametrize(
    ("module", "wrapped"),
    [("typer", False), ("nico_selfmodel.model.self_model_file", False), ("numpy", True)],
)
def test_ctrl_c_while_modules_load_ends_in_one_line(tmp_path, module, wrapped):
    code = STOPPED_LOADING.format(module=module, wrapped=wrapped)
    words = ("predict", tmp_path, "--encoders", "1")
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert done.stderr == "nico-selfmodel: stopped\n"


def test_ctrl_c_while_a_command_works_ends_in_one_line(command, tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("nico_selfmodel.model.self_model_file.load_model", stop)
    done = command("predict", tmp_path, "--encoders", "1")
    assert done.returncode == 130
    assert done.stderr.strip() == "nico-selfmodel: stopped"
