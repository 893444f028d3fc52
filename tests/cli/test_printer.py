"""One printer for all results: what it says of the golden ones."""

import json
from pathlib import Path

import pytest
import typer

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.monitor import remedy
from nico_selfmodel.cli.option_groups import Output


@pytest.fixture
def said(project_root, tmp_path, capsys):
    """Return a function that gives what is printed of a golden result, and the exit code."""

    def of(name, **changes):
        path = project_root / "tests" / "golden" / f"{name}.result.json"
        document = json.loads(path.read_text()) | changes
        with pytest.raises(typer.Exit) as ended:
            printer.result(name, document, Output(tmp_path))
        return capsys.readouterr().out, ended.value.exit_code

    return of


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("arm", ["held out [mm]", "cross-validated [mm]", "1.04", "PASS"]),
        ("body", ["held out [px]", "2.40", "held out [mm]", "1.93", "irreducible", "1.72 mm"]),
        ("cameras", ["epipolar [px]", "0.241", "left.fx", "baseline", "0.0700465", "5.4e-05"]),
        ("mirror", ["training [px]", "mirror.glass.distance", "481 mm from the left camera"]),
        ("rezeroed", ["zero of right_elbow", "moved by -0.08 deg, +- 0.33 deg", "NOT_EVALUATED"]),
        ("tool", ["tip of tool", "83.9 +- 0.2 mm from the hand's point", "hand.tool.x"]),
    ],
)
def test_every_result_is_printed_in_one_form(said, name, words):
    text, code = said(name)
    assert [word for word in words if word not in text] == []
    assert code == 0


@pytest.mark.parametrize("where", ["report.html", "result.json"])
def test_many_parameters_are_left_to_the_report_or_without_one_to_the_result(said, tmp_path, where):
    (tmp_path / where).touch()
    text, _ = said("body")
    assert "M0.x" not in text
    assert "link.upper" in text
    assert f"parameters with their sigmas are in {where}" in text


def test_a_result_that_fails_ends_with_one_and_its_reasons(said):
    text, code = said("arm", status="FAIL", reasons=["too far off [mm]"], warnings=["doubtful"])
    assert code == 1
    assert "FAIL\n  too far off [mm]\n  note: doubtful" in text


def test_errors_of_nothing_are_dashes(capsys):
    printer.errors("arm", [("held out", None)])
    assert capsys.readouterr().out.count(" - ") == 6


@pytest.mark.parametrize(
    ("parameters", "command"),
    [
        (["elbow.theta_offset"], "rezero MODEL DATA --joint elbow"),
        (["elbow.gear", "elbow.theta_offset"], "monitor MODEL DATA --relearn"),
        (["hand.tip.x", "hand.tip.y"], "calibrate tool DATA --model MODEL --tool tip"),
        (["M0.x", "right.pose.x"], "monitor MODEL DATA --relearn"),
    ],
)
def test_what_changed_is_cured_by_a_command_with_real_paths(tmp_path, parameters, command):
    data, model = tmp_path / "new data", tmp_path / "arm"
    (tmp_path / "new data_relearned").mkdir()
    expected = command.replace("MODEL", str(model)).replace("DATA", f"'{data}'")
    out = f"'{data}_relearned_2'"
    assert remedy(parameters, model, data) == f"nico-selfmodel {expected} --out {out}"


@pytest.mark.parametrize("parameter", ["elbow.theta_offset", "hand.tip.x"])
def test_what_changed_in_mid_session_is_learned_from_what_came_after(parameter, tmp_path):
    words = remedy([parameter], tmp_path / "arm", tmp_path / "data", whole=False)
    assert words.startswith(f"nico-selfmodel monitor {tmp_path / 'arm'} {tmp_path / 'data'} --rel")


def test_a_command_within_a_data_set_makes_its_folder_beside_it(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    monkeypatch.chdir(tmp_path / "data")
    words = remedy(["elbow.theta_offset"], Path("../arm"), Path())
    assert words.endswith(f"--out {tmp_path.resolve() / 'data_relearned'}")


def test_a_result_whose_scale_nothing_holds_is_printed(said):
    text, _ = said("body", scale_from=None)
    row = next(line for line in text.splitlines() if "scale held by" in line)
    assert "nothing" in row
