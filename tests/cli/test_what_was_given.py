"""Something else given in place of what a command takes is told for what it is, in one line."""

from dataclasses import replace

import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.model.tree.body_model import BodyModel, save_body
from nico_selfmodel.vision.boards.board_detection import size_in

from ..estimation.simulated_trees import one_arm
from .one_line import assert_one_clear_line

STEPS = ("servo", "steps", "--port", "/dev/null", "--config", "servos.yaml")


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """Return a result folder with a body that has neither camera nor covariance."""
    folder = tmp_path_factory.mktemp("body") / "arm"
    folder.mkdir()
    save_body(BodyModel("arm", one_arm(2).tree, np.ones(5)), folder / "body.yaml")
    return folder


@pytest.mark.parametrize(
    ("name", "words"),
    [
        (None, "given is empty"),
        ("result.json", "given is a result (result.json)"),
        ("a.PNG", "given is a folder of pictures"),
        ("poses.txt", "given is a folder of other files"),
    ],
)
@pytest.mark.parametrize("kind", ["kinematics", "body"])
def test_a_folder_that_is_no_data_set_is_told_for_what_it_is(tmp_path, command, kind, name, words):
    folder = tmp_path / "given"
    folder.mkdir()
    if name is not None:
        (folder / name).write_text("{}")
    done = command("calibrate", kind, folder, "--out", tmp_path / "out")
    assert_one_clear_line(done, words, "a data set is a folder with dataset.yaml and samples.csv")


def test_a_whole_body_given_as_an_arm_is_told_for_what_it_is(tmp_path, command, body):
    done = command("export-urdf", body, "--out", tmp_path / "arm.urdf")
    assert_one_clear_line(done, "is a result, of a body (body.yaml)", "self_model.yaml")


def test_a_board_of_too_many_corners_is_not_called_wrongly_written():
    assert size_in("999x6", "9x6") == (999, 6)
    with pytest.raises(ValueError, match="at most 999 corners along a side, got '99999x6'"):
        size_in("99999x6", "9x6")


def test_samples_that_are_there_twice_are_named():
    data = one_arm(2, poses=6).data
    with pytest.raises(DataError, match=r"more than once there is 3$"):
        replace(data, sample=np.array([0, 1, 2, 3, 3, 5]))


def test_what_a_body_lacks_for_choosing_poses_is_named(tmp_path, command, body):
    from nico_selfmodel.dataset.body.body_folder import save_body_dataset

    save_body_dataset(one_arm(2).data, tmp_path / "data")
    words = ("choose-poses", body, tmp_path / "data", "--count", 3, "--out", tmp_path / "o.csv")
    done = command(*words)
    assert_one_clear_line(done, "body 'arm' has no covariance: learn it")


def test_a_data_set_in_the_place_of_a_self_model_is_told_for_what_it_is(
    recorded, result, tmp_path, command
):
    done = command("evaluate", recorded[1], result)
    assert_one_clear_line(done, f"{recorded[1]} is a data set of an arm (samples.csv)")
    done = command("calibrate", "kinematics", result, "--out", tmp_path / "out")
    assert_one_clear_line(done, f"{result} is a result, of an arm or cameras (self_model.yaml)")
    done = command("calibrate", "hand-eye", recorded[1], "--out", tmp_path / "out")
    assert_one_clear_line(done, f"nico-selfmodel convert {recorded[1]} --out")
    assert not (tmp_path / "out").exists()


def test_cameras_that_a_model_does_not_have_are_not_ignored(recorded, result, tmp_path, command):
    out = tmp_path / "out"
    done = command("convert", recorded[1], "--cameras", result, "--out", out)
    assert_one_clear_line(done, "has no pair of cameras")
    assert not out.exists()


def test_too_few_training_data_are_not_called_standing_still(project_root, tmp_path, command):
    data = project_root / "examples" / "data" / "franka_fr3"
    words = ("calibrate", "kinematics", data, "--test-fraction", 0.999)
    done = command(*words, "--out", tmp_path / "out")
    assert_one_clear_line(done, "equations for", "hold out fewer")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate", "motion-capture", "--arc-share", "3"), "expected at most 1"),
        (("record", "--mirror", "m=a,2,3"), "--mirror m=a,2,3: 'a' is not a number"),
        (("calibrate", "stereo", "x", "--board", "9x6", "--square-mm", "0"), "--square-mm must be"),
        (("import", "vicon", "a.csv", "--encoders", "b.csv"), "needs --counts-per-turn"),
        (("markers", "board", "--board", "9x6", "--square-mm", "nan"), "--square-mm must be"),
        (
            (*STEPS, "--rest-s", "inf"),
            "Invalid value for '--rest-s': expected at most 60, got 'inf'",
        ),
        (
            (*STEPS, "--largest-deg", "inf"),
            "Invalid value for '--largest-deg': expected at most 360, got 'inf'",
        ),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_its_option(words, said, tmp_path, command):
    out = tmp_path / "out"
    assert_one_clear_line(command(*words, "--out", out), said)
    assert not out.exists()


def test_an_argument_that_is_no_number_is_told(command):
    words = ("right_elbow", "9o", "--port", "/dev/null", "--config", "servos.yaml")
    done = command("servo", "move", *words)
    assert_one_clear_line(done, "Invalid value for 'ANGLE': expected a number, got '9o'.")


def test_a_model_that_failed_its_checks_says_so_wherever_it_is_used(result, tmp_path, command):
    failed = tmp_path / "failed"
    failed.mkdir()
    (failed / "self_model.yaml").write_bytes((result / "self_model.yaml").read_bytes())
    words = ("predict", failed, "--encoders", "0,0,0,0")
    assert "in doubt" not in command(*words).stderr
    text = (result / "result.json").read_text()
    (failed / "result.json").write_text(text.replace('"status": "PASS"', '"status": "FAIL"'))
    for given in (failed, failed / "self_model.yaml"):
        done = command(words[0], given, *words[2:])
        assert done.returncode == 0
        assert f"{failed} failed its checks, as its result.json says" in done.stderr
