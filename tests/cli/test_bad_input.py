"""Bad input: one clear line on standard error, exit code 2, nothing left behind."""

import shutil

import pytest

from .one_line import assert_one_clear_line


def edited(recorded, tmp_path, change):
    """Return a copy of the training data with `samples.csv` changed as lists of cells."""
    folder = tmp_path / "edited"
    shutil.copytree(recorded[0], folder)
    path = folder / "samples.csv"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    rows = change(rows[0], rows)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return folder


def cell(column, line, value):
    """Return a change of one cell; `line` counts from the header's 1."""

    def change(header, rows):
        rows[line - 1][header.index(column)] = value
        return rows

    return change


def without_column(column):
    def change(header, rows):
        k = header.index(column)
        return [row[:k] + row[k + 1 :] for row in rows]

    return change


def all_rows(**columns):
    def change(header, rows):
        for row in rows[1:]:
            for name, value in columns.items():
                k = header.index(name)
                row[k] = value(row[k]) if callable(value) else value
        return rows

    return change


def still_sweep(header, rows):
    """Let the elbow's sweep stand still."""
    k, s = header.index("encoder.right_elbow"), header.index("sweep")
    for row in rows[1:]:
        if row[s] in ("right_elbow", "home"):
            row[k] = rows[1][k]
    return rows


CASES = {
    "a missing column": (without_column("encoder.right_elbow"), "encoder.right_elbow"),
    "text in a number cell": (cell("x_m", 5, "abc"), "abc"),
    "nan in a cell": (cell("y_m", 6, "nan"), "nan"),
    "an empty encoder": (cell("encoder.right_elbow", 7, ""), "right_elbow"),
    "a sweep of no joint": (cell("sweep", 30, "left_knee"), "left_knee"),
    "a sweep that did not move": (still_sweep, "right_elbow"),
    "a sample twice": (cell("sample", 9, "1"), "1"),
    "millimetres as metres": (
        all_rows(x_m=lambda v: v and str(1e3 * float(v)), y_m=lambda v: v and str(1e3 * float(v))),
        "millimet",
    ),
    "coincident points": (all_rows(x_m="0.1", y_m="0.1", z_m="0.1"), "do not move"),
    "too few samples": (lambda header, rows: [*rows[:1], *rows[-7:]], "equations"),
    "no rows": (lambda header, rows: rows[:1], "row"),
}


RIGHT_ARM = ("--robot", "nico", "--base", "chest", "--tip", "right_hand")


@pytest.mark.parametrize("name", CASES)
def test_bad_data_get_one_clear_line_and_leave_nothing(name, recorded, tmp_path, command):
    change, word = CASES[name]
    folder = edited(recorded, tmp_path, change)
    before = {path.name for path in tmp_path.iterdir()}
    done = command("calibrate", "kinematics", folder, "--out", tmp_path / "out")
    assert_one_clear_line(done, word)
    assert {path.name for path in tmp_path.iterdir()} == before


def test_a_missing_folder_is_named(tmp_path, command):
    done = command("calibrate", "kinematics", tmp_path / "nothing", "--out", tmp_path / "out")
    assert_one_clear_line(done, "nothing")
    assert not (tmp_path / "out").exists()


def test_an_existing_result_is_refused_without_force(recorded, result, command):
    before = (result / "result.json").read_bytes()
    done = command("calibrate", "kinematics", recorded[0], "--out", result)
    assert_one_clear_line(done, result, "--force")
    assert (result / "result.json").read_bytes() == before


def test_an_unwritable_output_is_named(recorded, tmp_path, command):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out"
    assert_one_clear_line(command("calibrate", "kinematics", recorded[0], "--out", out), "file")


def test_a_self_model_of_another_version_is_refused(result, tmp_path, command, recorded):
    text = (result / "self_model.yaml").read_text()
    model = tmp_path / "model.yaml"
    model.write_text(text.replace("nico-selfmodel/1", "nico-selfmodel/9"))
    done = command("evaluate", model, recorded[1])
    assert_one_clear_line(done, "nico-selfmodel/9", "nico-selfmodel/1")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--robot", "nobody"), "nico"),
        (("--robot", "nico", "--arm", "tail"), "right_arm"),
        (("--robot", "nico", "--base", "chest", "--tip", "moon"), "moon"),
        (("--robot", "nico", "--base", "head", "--tip", "chest"), "chest"),
        (("--robot", "nico", "--arm", "left_arm"), "left_"),
        (("--fix", "right_elbow.gaer"), "right_elbow.gear"),
        (("--fix", "right_elbow.r=long"), "long"),
        (("--fix", "right_elbow.alpha=90"), "if these are degrees, give 1.5708"),
        (("--method", "magic"), "magic"),
        (("--loss", "magic"), "trimmed"),
        (("--test-fraction", "1.5"), "--test-fraction"),
        (("--test-fraction", "1.5"), "1.5"),
        (("--seed", "-1"), "--seed"),
        (("--robot", "nico", "--base", "chest"), "--tip"),
        (("--test", "nowhere"), "nowhere"),
    ],
)
def test_a_bad_option_is_explained(options, word, recorded, tmp_path, command):
    done = command("calibrate", "kinematics", recorded[0], *options, "--out", tmp_path / "out")
    assert_one_clear_line(done, word)
    assert not (tmp_path / "out").exists()


def test_wrong_readings_for_a_prediction_are_explained(result, command):
    assert_one_clear_line(command("predict", result, "--encoders", "1,2"), "2", "4", "right_elbow")
    assert_one_clear_line(command("predict", result, "--encoders", "1,2,x,4"), "'x'")
    assert_one_clear_line(command("predict", result), "--encoders")
    assert_one_clear_line(
        command("predict", result, "--encoders", "1,2,3,4", "--marker", "ear"), "ear"
    )


def test_a_view_of_nothing_is_explained(tmp_path, command):
    assert_one_clear_line(command("view", tmp_path / "nothing"), "nothing")


def test_a_self_model_is_no_scene(result, tmp_path, command):
    done = command("view", result / "self_model.yaml", "--out", tmp_path / "page.html")
    assert_one_clear_line(done, "self_model.yaml is no scene")


def test_a_world_that_does_not_exist_is_explained(tmp_path, command):
    done = command("learn", "--imperfections", "moon", "--out", tmp_path / "out")
    assert_one_clear_line(done, "moon", "thesis")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--base", "chest"), "--robot"),
        (("--fix", "right_elbow.r=nan"), "finite"),
        (("--fix", "right_elbow.r=1e308"), "'1e308' is larger than anything measured"),
        (("--fix", "right_elbow.r="), "--fix right_elbow.r=: '' is not a number"),
        ((*RIGHT_ARM, "--hold", "right_wrist=up"), "--hold right_wrist=up: 'up' is not a number"),
        (("--require-test-mm", "nan"), "--require-test-mm"),
        (("--require-test-mm", "1"), "is a bound on held-out data: give --test or --test-fraction"),
        (("--require-test-mm", "-2"), "--require-test-mm"),
        ((*RIGHT_ARM, "--point", "ear=right_hand"), "tracks no 'ear'; it tracks hand"),
        ((*RIGHT_ARM, "--hold", "right_wrist=40"), "'right_wrist' cannot be held at 40 rad"),
        (("--name", ""), "--name is empty"),
        (("--name=",), "--name is empty"),
        (("--robot", " "), "--robot is empty"),
        (("--test", ""), "--test is empty"),
        (("--fix", ""), "--fix is empty"),
    ],
)
def test_options_that_would_be_ignored_are_refused(options, word, recorded, tmp_path, command):
    done = command("calibrate", "kinematics", recorded[0], *options, "--out", tmp_path / "out")
    assert_one_clear_line(done, word)


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("learn", "--out", ""), "--out is empty"),
        (("simulate", "motion-capture", "--seed", "-1", "--out", "somewhere"), "--seed"),
        (("evaluate", "", "data"), "an argument is empty"),
        (("predict", "model", "--encoders", ""), "--encoders is empty"),
        (("choose-poses", "m", "--count", "0"), "expected at least 1, got '0'. See: "),
        (("choose-poses", "m", "--count=-3"), "expected at least 1, got '-3'. See: "),
        (("choose-poses", "m", "--count", "x"), "expected a whole number, got 'x'. See: "),
        (("choose-poses", "m", "--cuont", "1"), "--cuont"),
        (
            ("calibrate", "camera", "d", "--board", "7x5", "--square-mm", "0.03", "--out", "o"),
            "if these are metres, give 30",
        ),
        (
            ("markers", "board", "--board", "7x5", "--square-mm", "0.03", "--out", "o.pdf"),
            "if these are metres, give 30",
        ),
        (
            ("calibrate", "kinematics", "d", "--out", "o", "--starts", 99999999999999999999),
            "expected at most 1000000, got '99999999999999999999'. See: ",
        ),
    ],
)
def test_every_command_refuses_words_that_say_nothing(words, wanted, command):
    assert_one_clear_line(command(*words), wanted)


def test_training_data_are_no_test_data(recorded, tmp_path, command):
    done = command(
        *("calibrate", "kinematics", recorded[0], "--test", recorded[0]),
        *("--out", tmp_path / "out"),
    )
    assert_one_clear_line(done, "training data")


def test_force_never_deletes_the_data_it_reads_or_a_folder_of_something_else(
    recorded, tmp_path, command
):
    data = tmp_path / "data"
    shutil.copytree(recorded[0], data)
    done = command("calibrate", "kinematics", data, "--out", data, "--force")
    assert_one_clear_line(done, "is read")
    assert (data / "samples.csv").is_file()
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "thesis.tex").write_text("years")
    done = command("calibrate", "kinematics", data, "--out", tmp_path / "work", "--force")
    assert_one_clear_line(done, "not a result")
    assert (tmp_path / "work" / "thesis.tex").read_text() == "years"


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--effects", "sagg"), "no effect 'sagg', did you mean 'sag'? There are"),
        (("--up", "0,0,0"), "--up must be a direction as three numbers"),
        (("--up", "0,1"), "--up must be a direction as three numbers"),
        (("--up", "0,x,1"), "--up: 'x' is not a number"),
    ],
)
def test_what_cannot_bend_is_refused_in_one_line(command, project_root, tmp_path, words, reason):
    data = project_root / "examples" / "data" / "positioner_two_axis"
    done = command("calibrate", "kinematics", data, "--out", tmp_path / "out", *words)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert reason in line
    assert not (tmp_path / "out").exists()
