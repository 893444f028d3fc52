"""Learning cameras at the command line: the whole way from photographs, and what goes wrong."""

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from nico_selfmodel.model.self_model_file import load_model

from .one_line import assert_one_clear_line

_SPEC = importlib.util.spec_from_file_location(
    "drawn_boards", Path(__file__).parents[1] / "drawn_boards.py"
)
drawn_boards = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(drawn_boards)
BOARD = ("--board", "7x5", "--square-mm", 30, "--window", 5)


@pytest.fixture(scope="session")
def photographs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photographs")
    drawn_boards.draw_pairs(folder, count=10)
    return folder


@pytest.fixture
def spoilt(photographs, tmp_path):
    """Return a copy of the photographs that a test may spoil."""
    return Path(shutil.copytree(photographs, tmp_path / "photographs"))


@pytest.fixture(scope="session")
def cameras(tmp_path_factory, photographs, command):
    """Return the result folder of a calibration with two boards held out."""
    out = tmp_path_factory.mktemp("cameras") / "cameras"
    words = ("--fix", "k3=0", "--test-fraction", 0.2, "--out", out)
    done = command("calibrate", "stereo", photographs, *BOARD, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "PASS" in done.stdout
    return out


def refused(command, folder, tmp_path, *words):
    """Return the one line with which a calibration is refused, and that nothing was written."""
    out = tmp_path / "result"
    done = command("calibrate", "stereo", folder, *(words or BOARD), "--out", out)
    assert done.returncode == 2, done.stdout + done.stderr
    assert not out.exists()
    lines = [
        line
        for line in done.stderr.strip().splitlines()
        if "warning:" not in line and not line.endswith(": done")
    ]
    assert len(lines) == 1
    return lines[0]


def test_photographs_become_cameras_that_are_where_they_were_drawn(cameras):
    model, truth = load_model(cameras), drawn_boards.SMALL_RIG
    document = json.loads((cameras / "result.json").read_text())
    assert document["status"] == "PASS"
    assert document["test"]["pixels"]["rms"] < 0.2
    files = document["detection"].pop("files")
    assert files["right"]["03"] == "right03.png"
    assert document["detection"] == {
        "board": "7x5", "square_mm": 30.0, "window_px": 5, "images": 20, "not_seen": {},
        "in_part": [],
    }  # fmt: skip
    assert model.rig.baseline == pytest.approx(truth.baseline, abs=5e-4)
    assert model.rig.left.fx == pytest.approx(truth.left.fx, abs=2.0)
    assert model.rig.right.cy == pytest.approx(truth.right.cy, abs=2.5)
    assert "left.k3" not in model.covariance.names
    names = {path.name for path in cameras.iterdir()}
    assert names == {"self_model.yaml", "result.json", "report.html", "residuals.csv", "scene.json"}


@pytest.mark.slow
def test_one_camera_alone_is_a_command_of_its_own(photographs, tmp_path, command):
    out = tmp_path / "camera"
    words = ("--fixed-aspect", "--tangential", "--fix", "k3=0", "--camera", "right", "--json")
    done = command("calibrate", "camera", photographs, *BOARD, *words, "--out", out)
    assert done.returncode == 0, done.stderr
    parameters = json.loads(done.stdout)["parameters"]
    assert parameters["right.fx"]["value"] == parameters["right.fy"]["value"]
    assert parameters["right.p1"]["free"]
    assert "baseline" not in parameters
    assert set(load_model(out).cameras) == {"right"}


@pytest.mark.slow
def test_cameras_are_learned_without_a_drawing(photographs, tmp_path, command):
    out = tmp_path / "cameras"
    done = command("calibrate", "stereo", photographs, *BOARD, "--no-report", "--out", out)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == {"self_model.yaml", "result.json"}


@pytest.mark.slow
def test_a_bound_that_is_missed_fails_and_is_written(photographs, tmp_path, command):
    out = tmp_path / "cameras"
    words = ("--test-fraction", 0.2, "--require-test-px", 0.001, "--out", out)
    done = command("calibrate", "stereo", photographs, *BOARD, *words)
    assert done.returncode == 1
    assert "required at most 0.001 px" in done.stdout
    assert json.loads((out / "result.json").read_text())["status"] == "FAIL"


def test_an_image_without_its_partner_is_named(spoilt, tmp_path, command):
    (spoilt / "right03.png").unlink()
    assert "left03.png" in refused(command, spoilt, tmp_path)


def test_images_of_one_camera_only_are_refused(spoilt, tmp_path, command):
    for path in spoilt.glob("right*"):
        path.unlink()
    assert "one camera only" in refused(command, spoilt, tmp_path)


def test_images_of_different_sizes_are_refused_with_their_names(spoilt, tmp_path, command):
    cv2 = pytest.importorskip("cv2")
    cv2.imwrite(str(spoilt / "left02.png"), cv2.imread(str(spoilt / "left02.png"))[:200])
    message = refused(command, spoilt, tmp_path)
    assert "left02.png has 320x200" in message


def test_a_photograph_that_is_none_is_named(spoilt, tmp_path, command):
    (spoilt / "left02.png").write_text("not an image")
    assert "left02.png" in refused(command, spoilt, tmp_path)


@pytest.mark.slow
def test_a_wrong_board_is_refused_with_the_one_that_is_there(photographs, tmp_path, command):
    message = refused(command, photographs, tmp_path, "--board", "9x6", "--square-mm", 30)
    assert "none of 20 images shows all of a 9x6 board" in message
    assert "is it a 7x5" in message


def test_two_boards_are_too_few(spoilt, tmp_path, command):
    for path in spoilt.iterdir():
        if path.stem[-2:] not in ("01", "02"):
            path.unlink()
    assert "saw 2 boards, at least 3" in refused(command, spoilt, tmp_path)


def test_a_copied_pair_is_no_third_board(spoilt, tmp_path, command):
    for path in spoilt.iterdir():
        if path.stem[-2:] not in ("01", "02"):
            path.unlink()
    for path in list(spoilt.glob("*02.png")):
        shutil.copy(path, spoilt / path.name.replace("02", "03"))
    assert "saw 2 boards, at least 3" in refused(command, spoilt, tmp_path)


@pytest.mark.slow
def test_what_is_told_of_a_lens_stands_beside_what_pictures_would_else_be(
    spoilt, tmp_path, command
):
    message = refused(command, spoilt, tmp_path, *BOARD, "--fix", "left.fx=2000")
    assert message.endswith("or what is told is wrong: try without --fix left.fx=2000")


@pytest.mark.slow
def test_swapped_cameras_are_recognised(spoilt, tmp_path, command):
    for path in sorted(spoilt.glob("left*")):
        other = spoilt / path.name.replace("left", "right")
        path.rename(spoilt / "aside.png")
        other.rename(path)
        (spoilt / "aside.png").rename(other)
    message = refused(command, spoilt, tmp_path)
    assert "left and right are swapped" in message
    assert "--swap-cameras" in message
    out = tmp_path / "cameras"
    done = command("calibrate", "stereo", spoilt, *BOARD, "--swap-cameras", "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    found, truth = load_model(out).rig, drawn_boards.SMALL_RIG
    assert found.baseline == pytest.approx(truth.baseline, rel=0.02)


@pytest.fixture(scope="module")
def fisheye_photographs(tmp_path_factory):
    """Return drawn photographs by OpenCV's fisheye, whose image's corners look 115 deg aside.

    Of fourteen a rational lens is as likely in one draw of seven.
    """
    folder, rng = tmp_path_factory.mktemp("fisheye"), np.random.default_rng(0)
    fine = np.arange(3) / 3.0 - 1.0 / 3.0
    u, v = ((np.arange(n)[:, None] + fine).ravel() for n in (320, 240))
    angle = np.stack(np.meshgrid(u - 159.5, v - 119.5), axis=-1) / 125.0
    off = np.linalg.norm(angle, axis=2, keepdims=True)
    lines = np.concatenate([angle * np.sinc(off / np.pi), np.cos(off)], axis=2)
    camera = drawn_boards.SMALL_RIG.left
    for number, place in enumerate(np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False)):
        turn = drawn_boards.rotation_from_vector(rng.normal(0.0, 0.3, 3))
        middle = np.array([0.14 * np.cos(place), 0.09 * np.sin(place), rng.uniform(0.1, 0.2)])
        center = 0.03 * np.array([3.0, 2.0, 0.0])
        pose = drawn_boards.transform(turn, middle - turn @ center)
        image = drawn_boards.drawn(camera, lines, pose, rng=rng)
        drawn_boards.cv2.imwrite(str(folder / f"left{number:02d}.png"), image)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("pins", [(), pytest.param(("--fix", "k3=0"), marks=pytest.mark.slow)])
def test_photographs_of_a_fisheye_do_not_pass_as_a_polynomial(
    fisheye_photographs, tmp_path, command, pins
):
    out = tmp_path / "camera"
    words = ("--board", "7x5", "--square-mm", 30, "--window", 4, "--test-fraction", 0.25)
    words = (*words, "--lens", "polynomial")
    done = command("calibrate", "camera", fisheye_photographs, *words, *pins, "--out", out)
    assert done.returncode == 1, done.stdout + done.stderr
    reasons = json.loads((out / "result.json").read_text())["reasons"]
    assert "bends light as its model does not" in reasons[0]


@pytest.mark.slow
def test_photographs_of_a_fisheye_choose_the_fisheye(fisheye_photographs, tmp_path, command):
    out = tmp_path / "camera"
    words = ("--board", "7x5", "--square-mm", 30, "--window", 4, "--test-fraction", 0.25)
    done = command("calibrate", "camera", fisheye_photographs, *words, "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads((out / "result.json").read_text())
    assert document["lens"]["kind"] == "fisheye"
    assert {trial["lens"] for trial in document["lens"]["tried"]} >= {"polynomial", "fisheye"}
    camera = load_model(out).cameras["left"]
    assert camera.lens == "fisheye"
    assert camera.fx == pytest.approx(125.0, rel=0.04)
    assert "The lens: fisheye" in (out / "report.html").read_text()
    other = command("calibrate", "body", out, "--model", out, "--out", tmp_path / "body")
    assert other.returncode == 2
    unknown = command(
        "calibrate",
        "camera",
        fisheye_photographs,
        *words,
        "--lens",
        "round",
        "--out",
        out,
        "--force",
    )
    assert_one_clear_line(unknown, "no lens 'round'; there are auto, polynomial, rational, fisheye")


@pytest.mark.slow
def test_pairs_that_were_not_taken_together_are_refused_by_their_epipolar_error(
    spoilt, tmp_path, command
):
    numbers = [f"{i:02d}" for i in range(1, 11)]
    for number, other in zip(numbers, np.roll(numbers, 1), strict=True):
        (spoilt / f"right{number}.png").rename(spoilt / f"aside{other}.png")
    for number in numbers:
        (spoilt / f"aside{number}.png").rename(spoilt / f"right{number}.png")
    message = refused(command, spoilt, tmp_path)
    assert "no rigid pair of cameras" in message
    assert "px from their epipolar lines" in message


@pytest.mark.slow
def test_two_images_of_one_camera_are_no_pair(spoilt, tmp_path, command):
    for path in spoilt.glob("left*"):
        shutil.copy(path, spoilt / path.name.replace("left", "right"))
    assert "same camera" in refused(command, spoilt, tmp_path)


@pytest.mark.slow
def test_a_board_whose_pair_does_not_match_is_set_aside_by_name(spoilt, tmp_path, command):
    shutil.copy(spoilt / "right03.png", spoilt / "right04.png")
    out = tmp_path / "cameras"
    done = command("calibrate", "stereo", spoilt, *BOARD, "--fix", "k3=0", "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads((out / "result.json").read_text())["outliers"] == ["04"]
    assert "boards set aside as outliers: left04.png and right04.png" in done.stdout


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--fix", "left.k9=0"), "no camera parameter 'left.k9'"),
        (("--fix", "k3=x"), "'x' is not a number"),
        (("--prior", "left.cx=160"), "NAME=MEAN,SIGMA"),
        (("--loss", "cubic"), "cubic"),
        (("--test-fraction", 2), "--test-fraction"),
        (("--seed", -1), "--seed"),
    ],
)
def test_options_that_mean_nothing_are_refused(photographs, tmp_path, command, words, expected):
    assert expected in refused(command, photographs, tmp_path, *BOARD, *words)


@pytest.mark.slow
def test_the_stereo_experiment_writes_tables_and_charts(tmp_path, command, monkeypatch):
    monkeypatch.setattr("nico_selfmodel.experiments.stereo.COUNTS", (6, 13))
    out = tmp_path / "experiment"
    done = command("experiment", "stereo", "--robots", 2, "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    rows = {row["lens"]: row for row in json.loads(done.stdout)["by_lens"]}
    assert rows["pinhole"]["edge_sd_mm"][0] > 1.5 * rows["full"]["edge_sd_mm"][0]
    assert rows["full"]["scale_error"] < 0.005
    assert "1.59 mm" in (out / "tables.md").read_text()
    assert (out / "edges_by_lens.png").stat().st_size > 10_000
