"""What every command has: a file of options, more or fewer words, completion, lines of progress."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.app import _tree
from nico_selfmodel.dataset.folder import load_dataset, save_dataset

HABITS = {"--options", "--verbose", "--quiet"}


def leaves(command):
    below = getattr(command, "commands", None)
    return [command] if below is None else [leaf for one in below.values() for leaf in leaves(one)]


def test_every_command_has_them_once():
    for leaf in leaves(_tree()):
        names = [name for param in leaf.params for name in param.opts]
        assert [names.count(name) for name in HABITS] == [1, 1, 1], leaf.name
        assert len(names) == len(set(names)), leaf.name


def test_a_file_gives_options_and_the_command_line_wins(recorded, tmp_path, command):
    options = tmp_path / "options.yaml"
    options.write_text(
        f"dataset: {recorded[0]}\ntest: {recorded[1]}\nfix: [right_elbow.gear=1.7]\n"
        "require-test-mm: 1000\neffects: none\nno-report: true\n"
    )
    words = ("calibrate", "kinematics", "--options", options, "--out", tmp_path / "out", "--json")
    failed = command(*words, "--require-test-mm", "0.001")
    document = json.loads(failed.stdout)
    assert failed.returncode == 1
    assert document["parameters"]["right_elbow.gear"]["value"] == 1.7
    assert any("0.001" in reason for reason in document["reasons"])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("sensors: points", "has no option 'sensors'; it has dataset, json, model, sensor"),
        ("- 1", "expected options as `name: value`"),
        ("options: x.yaml", "has no option 'options'"),
        ("sensor: [", "options.yaml"),
    ],
)
def test_a_file_of_options_that_is_none_is_refused(content, words, recorded, tmp_path, command):
    options = tmp_path / "options.yaml"
    options.write_text(content)
    done = command("evaluate", "--options", options, recorded[0], recorded[1])
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("test-fraction: a lot", "expected a number, got 'a lot'"),
        ("force: maybe", "expected true or false, got 'maybe'"),
    ],
)
def test_a_value_of_a_file_of_options_that_is_none_is_told(
    content, words, recorded, tmp_path, command
):
    options = tmp_path / "options.yaml"
    options.write_text(content)
    out = tmp_path / "out"
    done = command("calibrate", "kinematics", recorded[0], "--options", options, "--out", out)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not out.exists()


def test_stages_are_lines_where_nobody_looks_at_a_bar(recorded, tmp_path, command):
    out = tmp_path / "out"
    words = ("calibrate", "kinematics", recorded[0], "--out", out, "--force")
    words += ("--method", "circle-points", "--no-report")
    plain = command(*words)
    stages = ["nico-selfmodel: learning: done", "nico-selfmodel: writing the result: done"]
    assert plain.stderr.splitlines() == stages
    verbose = command(*words, "-v").stderr.splitlines()
    assert [re.sub(r" \(\d+\.\d s\)$", "", line) for line in verbose] == stages
    assert verbose != stages
    quiet = command(*words, "--quiet")
    assert (quiet.returncode, quiet.stdout, quiet.stderr) == (0, "", "")


def test_a_quiet_command_that_fails_says_why(result, recorded, tmp_path, command):
    data = load_dataset(recorded[1])
    moved = replace(data, p_WH_measured=data.p_WH_measured + np.array([0.05, 0.0, 0.0]))
    save_dataset(moved, tmp_path / "moved")
    done = command("evaluate", result, tmp_path / "moved", "--quiet")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("nico-selfmodel: FAIL: the error (median ")
    assert len(done.stderr.splitlines()) == 1


def test_quiet_keeps_errors_and_what_a_script_reads(recorded, tmp_path, command):
    done = command("evaluate", tmp_path / "no", recorded[1], "--quiet")
    assert done.returncode == 2
    assert "does not exist" in done.stderr
    assert printer.talk is printer.Talk.QUIET
    command("--version")
    assert printer.talk is printer.Talk.PLAIN


def test_a_stage_of_many_steps_is_one_line(capsys):
    printer.set_talk(printer.Talk.PLAIN)
    with printer.progress_bar() as progress:
        for done in range(4):
            progress("moving", done, 3)
        progress("looking", 0, 1)
    assert capsys.readouterr().err == "nico-selfmodel: moving: done\n"


def test_the_shell_can_be_taught_to_complete(process):
    done = process("--show-completion", "bash")
    assert "complete" in done.stdout
