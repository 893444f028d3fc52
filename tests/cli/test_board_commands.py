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


APART = 0.04
"""Distance of a camera from the next [m]."""


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Return a folder with cam0, cam1 and cam2, side by side; a card hides half of the boards.

    The first boards are seen by cam0 and cam1, the last ones by cam1 and cam2.
    """
    folder = tmp_path_factory.mktemp("photographs")
    printed = printed_boards.charuco_print(8, 6, 0.025, 0.01875, TAGS)
    points = board_of("charuco:7x5", 25.0).points
    for i in range(13):
        rng = np.random.default_rng((i, 11))
        hidden, fill = (0.4, 0.95) if i % 2 else (0.0, 0.8)
        R, t = printed_boards.pose_of(points, rng, fill=fill)
        for side, camera in enumerate(("cam0", "cam1") if i < 8 else ("cam1", "cam2")):
            pose = R, t + np.array([(0.5 - side) * APART, 0.0, 0.0])
            photo = printed_boards.photographed(
                printed, points, rng, hidden=hidden, pose=pose, fine=2
            )
            (folder / camera).mkdir(exist_ok=True)
            cv2.imwrite(str(folder / camera / f"{i:03d}.png"), photo.image)
    return folder


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_commands_of_the_page_print_the_board_and_learn_from_it(
    photographs, tmp_path, command, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "cameras.md").read_text()
    printing, one, pair, rig = re.findall(r"^(?:    )?nico-selfmodel (.*)$", page, re.MULTILINE)
    assert command(*shlex.split(printing)).returncode == 0
    assert b"--board charuco:7x5 --square-mm 25" in Path("board.pdf").read_bytes()
    for side in ("cam0", "cam1"):
        (tmp_path / side).mkdir()
        for number in range(8):
            shutil.copy(photographs / side / f"{number:03d}.png", tmp_path / side)
    assert command(*shlex.split(one), "--no-report").returncode == 0
    done = command(*shlex.split(pair), "--no-report")
    assert done.returncode == 0, done.stdout + done.stderr
    assert load_model("pair").rig.baseline == pytest.approx(APART, abs=5e-4)
    shutil.copytree(photographs, tmp_path / "photographs")
    done = command(*shlex.split(rig))
    assert done.returncode == 0, done.stdout + done.stderr
    cameras = load_model("rig").cameras
    for k, name in enumerate(("cam0", "cam1", "cam2")):
        assert cameras[name].X_WC[:3, 3] == pytest.approx([k * APART, 0.0, 0.0], abs=1e-3)
    document = json.loads(Path("rig/result.json").read_text())
    assert [p["cameras"] for p in document["pairs"]] == [["cam0", "cam1"], ["cam1", "cam2"]]
    assert len(document["detection"]["files"]["cam0"]) == 8
    assert "How the cameras work together" in Path("rig/report.html").read_text()


def test_cameras_are_named_by_patterns(photographs, tmp_path, command):
    patterns = [f"--images={n}={photographs}/cam{k}/00[0-5].png" for k, n in enumerate(("a", "b"))]
    words = (*patterns, *BOARD, "--out", tmp_path / "rig", "--no-report", "-q")
    assert command("calibrate", "cameras", *words).returncode == 0
    assert list(load_model(tmp_path / "rig").cameras) == ["a", "b"]


@pytest.mark.slow
def test_cameras_with_images_of_two_sizes_are_a_rig(photographs, tmp_path, command):
    other = tmp_path / "cut"
    shutil.copytree(photographs / "cam0", other / "wide")
    (other / "small").mkdir()
    for path in (photographs / "cam1").glob("00[0-7].png"):
        cv2.imwrite(str(other / "small" / path.name), cv2.imread(str(path))[30:570, 40:760])
    out = tmp_path / "rig"
    words = (*BOARD, "--lens", "small=rational,wide=polynomial", "--out", out)
    done = command("calibrate", "cameras", other, *words)
    assert done.returncode == 0, done.stdout + done.stderr
    cameras = load_model(out).cameras
    assert [cameras[name].image_size for name in ("wide", "small")] == [(800, 600), (720, 540)]
    assert [cameras[name].lens for name in ("wide", "small")] == ["polynomial", "rational"]
    assert cameras["small"].cx - cameras["wide"].cx == pytest.approx(-40.0, abs=2.0)
    assert json.loads((out / "result.json").read_text())["lens"]["kind"] == (
        "small=rational,wide=polynomial"
    )
    page = (out / "report.html").read_text()
    assert "small 720 x 540 px, wide 800 x 600 px" in page


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


def test_wrong_words_are_one_line_before_any_board_is_searched(photographs, tmp_path, command):
    out = tmp_path / "out"
    left, other = f"{photographs}/cam0/00[0-1].png", f"{photographs}/cam1/00[1-2].png"
    to = ("--out", out, "-q")
    camera = ("calibrate", "camera", left, *to, "--square-mm", "25")
    stereo = ("calibrate", "stereo", *BOARD, *to)
    rig = ("calibrate", "cameras", *BOARD, *to)
    two = ("--images", f"a={left}", "--images", f"b={photographs}/cam1/00[0-1].png")
    sheet = ("markers", "board", "--out", tmp_path / "b.pdf")
    cases = [
        ((*camera, "--board", "charucco:7x5"), "did you mean 'charuco'"),
        (("calibrate", "camera", f"{photographs}/cam7/*.png", *BOARD, *to), "no photograph"),
        (rig, "give a folder with a folder for each camera"),
        ((*rig, photographs / "cam0"), "a folder with photographs for each camera"),
        ((*rig, "--images", left), "give NAME=PATTERN"),
        ((*rig, "--images", f"a={left}", "--images", f"a={left}"), "another camera a"),
        ((*camera, *BOARD[:2], "--lens", "round"), "there are auto, polynomial, rational, fisheye"),
        ((*camera, *BOARD[:2], "--lens", "left=round"), "no lens 'round'; there are polynomial"),
        ((*camera, *BOARD[:2], "--lens", "left=fisheye,"), "NAME=LENS of each camera"),
        ((*camera, *BOARD[:2], "--lens", "lft=fisheye"), "did you mean 'left'"),
        ((*rig, *two, "--lens", "a=fisheye"), "no lens is given of b"),
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


@pytest.mark.slow
def test_boards_that_no_photograph_shows_are_one_line(photographs, tmp_path, command):
    out = tmp_path / "out"
    to, cam = ("--out", out, "-q"), [f"{photographs}/cam{i}" for i in range(3)]
    camera = ("calibrate", "camera", f"{cam[0]}/00[0-1].png", *to, "--square-mm", "25")
    apart = ("--images", f"a={cam[0]}/00[0-2].png", "--images", f"b={cam[2]}/0[01][0289].png")
    cases = [
        ((*camera, "--board", "aprilgrid:6x6"), "no apriltag_36h11 tag"),
        ((*camera, "--board", "charuco:3x3"), "which the stated board does not have"),
        ((*camera, "--board", "circles:7x5"), "no circles:7x5"),
        (("calibrate", "cameras", *BOARD, *to, *apart), "boards in common"),
    ]
    for words, message in cases:
        assert_one_clear_line(command(*words), message)
        assert not out.exists()
