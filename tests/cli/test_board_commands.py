"""Boards from the printer to the camera: `markers board`, `detect`, `calibrate camera|stereo`."""

import csv
import json
import re
import shlex
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from nico_selfmodel.model.self_model_file import load_model
from nico_selfmodel.vision.boards.board_kinds import board_of

from ..vision import printed_boards
from .one_line import assert_one_clear_line

TAGS = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
BOARD = ("--board", "charuco:7x5", "--square-mm", "25")


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Return a folder with cam0 and cam1, in which a card hides a part of half of the boards."""
    folder = tmp_path_factory.mktemp("photographs")
    printed = printed_boards.charuco_print(8, 6, 0.025, 0.01875, TAGS)
    points = board_of("charuco:7x5", 25.0).points
    for side in ("cam0", "cam1"):
        (folder / side).mkdir()
    for i in range(9):
        rng = np.random.default_rng((i, 11))
        hidden, fill = (0.4, 1.1) if i % 2 else (0.0, 0.9)
        photo = printed_boards.photographed(printed, points, rng, hidden=hidden, fill=fill)
        for side in ("cam0", "cam1"):
            cv2.imwrite(str(folder / side / f"{i:03d}.png"), photo.image)
    return folder


def test_a_camera_is_learned_from_boards_seen_in_part(photographs, tmp_path, command):
    out = tmp_path / "camera"
    words = (*BOARD, "--out", out, "--no-report")
    done = command("calibrate", "camera", f"{photographs}/cam0/*.png", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    camera = load_model(out).cameras["left"]
    assert (camera.fx, camera.fy) == pytest.approx((620.0, 615.0), abs=3.0)
    assert camera.k1 == pytest.approx(-0.22, abs=0.03)
    document = json.loads((out / "result.json").read_text())
    found = document["detection"]
    assert (found["board"], found["square_mm"]) == ("charuco:7x5", pytest.approx(25.0))
    assert (found["tag_mm"], found["family"]) == (pytest.approx(18.75), "aruco_4x4_50")
    assert document["lens"]["kind"] == "polynomial"


def test_the_commands_of_the_page_print_the_board_and_look_for_it(
    photographs, tmp_path, command, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for side in ("cam0", "cam1"):
        shutil.copytree(photographs / side, tmp_path / side)
    page = (Path(__file__).parents[2] / "docs" / "cameras.md").read_text()
    printing, one, pair = re.findall(r"^(?:    )?nico-selfmodel (.*)$", page, re.MULTILINE)
    assert command(*shlex.split(printing)).returncode == 0
    assert b"--board charuco:7x5 --square-mm 25" in Path("board.pdf").read_bytes()
    assert command(*shlex.split(one), "--no-report").returncode == 0
    # Both cameras have the same pictures: a pair without a baseline, but every view is paired.
    done = command(*shlex.split(pair), "--no-report")
    assert "without a partner" not in done.stderr


def test_detect_tells_which_corners_it_saw(photographs, tmp_path, command):
    out = tmp_path / "seen"
    image = photographs / "cam0" / "001.png"
    done = command("detect", image, "--board", "charuco:7x5", "--out", out)
    assert done.returncode == 0, done.stderr
    with (out / "detections.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    ids = [int(row["id"]) for row in rows]
    assert 6 <= len(ids) < 35
    assert ids == sorted(set(ids))
    assert rows[0]["detector"] == "charuco:7x5"


def test_wrong_words_are_one_line(photographs, tmp_path, command):
    out = tmp_path / "out"
    left, other = f"{photographs}/cam0/*.png", f"{photographs}/cam1/00[1-3].png"
    to = ("--out", out, "-q")
    camera = ("calibrate", "camera", left, *to, "--square-mm", "25")
    stereo = ("calibrate", "stereo", *BOARD, *to)
    sheet = ("markers", "board", "--out", tmp_path / "b.pdf")
    cases = [
        ((*camera, "--board", "charucco:7x5"), "did you mean 'charuco'"),
        ((*camera, "--board", "aprilgrid:6x6"), "no apriltag_36h11 tag"),
        ((*camera, "--board", "charuco:3x3"), "which the stated board does not have"),
        ((*camera, "--board", "circles:7x5"), "no circles:7x5"),
        (("calibrate", "camera", f"{photographs}/cam7/*.png", *BOARD, *to), "no photograph"),
        (stereo, "--left and --right"),
        ((*stereo, "--left", left), "--left and --right"),
        ((*stereo, "--left", left, "--right", other), "without a partner"),
        ((*stereo, "--left", "a.png", "--right", "b.png"), "has a * in it"),
        ((*sheet, *BOARD, "--paper", "b5"), "no paper"),
        ((*sheet, "--board", "9x6", "--square-mm", "70"), "take a1"),
        (("markers", "board", *BOARD, "--out", tmp_path / "b.docx"), ".pdf, .svg, .png"),
    ]
    for words, message in cases:
        assert_one_clear_line(command(*words), message)
        assert not out.exists()
        assert not list(tmp_path.glob("b.*"))
