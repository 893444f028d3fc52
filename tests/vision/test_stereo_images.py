"""Folders of photographs: pairs, and what is said of folders that hold none."""

import warnings

import cv2
import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.vision.boards.board_detection import BoardDetection
from nico_selfmodel.vision.boards.board_detections import detect_boards, detect_boards_of_cameras
from nico_selfmodel.vision.boards.board_images import (
    camera_images,
    images_by_folder,
    images_by_pattern,
    images_of_one,
    pairs_by_pattern,
    stereo_pairs,
)
from nico_selfmodel.vision.boards.chessboard import Board

from .rendering import random_view, render_board

BOARD = Board(5, 4, 0.03)


@pytest.fixture(scope="module")
def board_image():
    rng = np.random.default_rng(0)
    H = random_view(rng, 130, (320, 240), tilt=0.3, roll=0.3)
    return render_board(5, 4, H, rng).image


@pytest.fixture
def two_days(tmp_path, board_image):
    """Return cameras whose photographs lie in folders of one name; each saw no board once."""
    images = {}
    for day in ("day1", "day2"):
        folder = tmp_path / day / "cam"
        folder.mkdir(parents=True)
        cv2.imwrite(str(folder / "01.png"), board_image)
        cv2.imwrite(str(folder / "02.png"), np.full_like(board_image, 90))
        images[day] = [("1", folder / "01.png"), ("2", folder / "02.png")]
    return images


@pytest.fixture
def folder(tmp_path, board_image):
    """Return a folder of three pairs; in the last one only the left camera saw the board."""
    for name in ("left1.png", "right1.png", "left2.png", "right2.png", "left10.png"):
        cv2.imwrite(str(tmp_path / name), board_image)
    cv2.imwrite(str(tmp_path / "right10.png"), np.full_like(board_image, 90))
    return tmp_path


def test_pairs_come_in_the_order_of_their_numbers(folder):
    (folder / "notes.txt").write_text("of no interest")
    pairs = stereo_pairs(folder)
    assert [name for name, _, _ in pairs] == ["1", "2", "10"]
    assert [path.name for path in pairs[2][1:]] == ["left10.png", "right10.png"]
    assert [name for name, _ in camera_images(folder, "right")] == ["1", "2", "10"]


def test_a_camera_that_has_a_folder_of_its_own_needs_no_prefix(folder, tmp_path):
    assert images_of_one(folder, "left") == camera_images(folder, "left")
    with pytest.raises(DataError, match=r"no images cam0\*.png .* as a pattern: '.*/\*.png'"):
        images_of_one(folder, "cam0")  # these are a pair's
    own = tmp_path / "cam0"
    own.mkdir()
    for name in ("02.png", "10.png", "1.png"):
        (own / name).write_bytes((folder / "left1.png").read_bytes())
    assert [name for name, _ in images_of_one(own, "left")] == ["1", "02", "10"]


def files_of(folder, *names):
    """Make files that are listed as photographs."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"of no interest")


@pytest.mark.parametrize(
    ("names", "pattern", "view"),
    [
        (("d1/i2_3.png", "d1_2/i3.png"), "d*/i*.png", "1_2_3"),
        (("e1/b.png", "e/b1.png"), "e*/b*.png", "1"),
    ],
)
def test_two_photographs_that_a_pattern_takes_for_one_view_are_refused(
    tmp_path, names, pattern, view
):
    files_of(tmp_path, *names)
    same = rf"^{tmp_path}/.*: .*/{names[0]} and .*/{names[1]} are the same view, '{view}': "
    either = same.replace(names[0], "(one)").replace(names[1], names[0]).replace("(one)", names[1])
    for listed in (images_by_pattern, lambda left: pairs_by_pattern(left, left)):
        with pytest.raises(DataError, match=f"{same}|{either}"):
            listed(f"{tmp_path}/{pattern}")


def test_two_photographs_of_one_name_in_the_folder_of_a_camera_are_refused(tmp_path):
    files_of(tmp_path, "cam0/1.png", "cam0/2.png", "cam1/1.jpg")
    found = images_by_folder(tmp_path)
    assert [(camera, len(images)) for camera, images in found.items()] == [("cam0", 2), ("cam1", 1)]
    files_of(tmp_path, "cam0/1.jpg")
    with pytest.raises(DataError, match=r"cam0: 1\.(png and 1\.jpg|jpg and 1\.png) are the same"):
        images_by_folder(tmp_path)


def test_wildcards_stand_for_what_they_stand_for_in_a_shell(tmp_path):
    files_of(tmp_path, "a1.png", "b1.png", "b2.png", "c10.png")

    def names(pattern):
        return [path.name for _, path in images_by_pattern(f"{tmp_path}/{pattern}")]

    assert names("[!a]*.png") == ["b1.png", "b2.png", "c10.png"]
    assert names("[ab]?.png") == ["a1.png", "b1.png", "b2.png"]
    assert names("[a-b]1*") == ["a1.png", "b1.png"]


def test_two_stars_stand_for_any_folders(tmp_path):
    files_of(tmp_path, "left1.png", "a/left1.png", "a/b/left2.png", "a/b/right2.png")
    found = images_by_pattern(f"{tmp_path}/**/left*.png")
    assert sorted(name for name, _ in found) == ["1", "a_1", "a_b_2"]
    pairs = pairs_by_pattern(f"{tmp_path}/a/**/left2.png", f"{tmp_path}/a/**/right2.png")
    assert [(left.name, right.name) for _, left, right in pairs] == [("left2.png", "right2.png")]


def test_copies_of_photographs_are_left_out_by_name(folder):
    found = detect_boards(folder, BOARD, 4)
    with pytest.warns(UserWarning, match="copies of photographs are left out: 2 of 1$"):
        views = found.seen_views
    assert views.names == ("1", "10")  # what its right camera saw is another thing


def test_a_single_pair_needs_no_number(tmp_path, board_image):
    for name in ("Left.PNG", "right.jpg"):
        cv2.imwrite(str(tmp_path / name), board_image)
    ((name, left, right),) = stereo_pairs(tmp_path)
    assert (name, left.name, right.name) == ("pair", "Left.PNG", "right.jpg")


def test_corners_that_one_camera_did_not_see_are_nan_with_the_reason(folder):
    told = []
    found = detect_boards(folder, BOARD, 4, lambda *step: told.append(step))
    assert found.views.image_sizes == ((320, 240),) * 2
    assert found.views.seen.all(axis=2).tolist() == [[True, True], [True, True], [True, False]]
    assert list(found.not_seen) == ["right10.png"]
    assert "no 5x4 board" in found.not_seen["right10.png"]
    assert told[-1] == ("looking for boards", 6, 6)
    one = detect_boards_of_cameras({"right": camera_images(folder, "right")}, BOARD, 4)
    np.testing.assert_array_equal(one.views.of_camera("right"), found.views.of_camera("right"))


def test_photographs_in_folders_of_one_name_are_told_apart(two_days):
    found = detect_boards_of_cameras(two_days, BOARD, 4)
    assert sorted(found.not_seen) == ["day1/cam/02.png", "day2/cam/02.png"]
    assert found.document["files"]["day2"] == {"1": "day2/cam/01.png", "2": "day2/cam/02.png"}


def test_a_window_that_sees_neighbouring_corners_is_warned_of(folder):
    """Of faint boards, whose corners are `cornerSubPix`'s; windows of plain ones are cut anyway."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        detect_boards(folder, BOARD, 16)
    for path in folder.glob("*.png"):
        cv2.imwrite(str(path), np.rint(120.0 + 0.04 * cv2.imread(str(path))).astype(np.uint8))
    with pytest.warns(UserWarning, match=r"squares are as small as .* take a smaller window"):
        detect_boards(folder, BOARD, 16)


def spoil(folder, change):
    """Change a folder by one word."""
    if change == "unpaired":
        (folder / "right2.png").unlink()
    elif change == "one camera":
        for path in folder.glob("right*"):
            path.unlink()
    elif change == "twice":
        (folder / "left1.jpg").write_bytes((folder / "left1.png").read_bytes())
    elif change == "size":
        cv2.imwrite(str(folder / "right2.png"), np.zeros((100, 200, 3), np.uint8))
    elif change == "text":
        (folder / "left2.png").write_text("not a photograph")
    elif change == "empty file":
        (folder / "left2.png").write_bytes(b"")
    elif change == "nothing":
        for path in folder.iterdir():
            path.unlink()
    return folder


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("unpaired", "without a partner in the other camera: left2.png"),
        ("one camera", r"images of one camera only: left\* without right\*"),
        ("twice", "left1.jpg and left1.png are the same view"),
        ("size", "'right' have different sizes: right1.png has 320x240, right2.png has 200x100"),
        ("text", "left2.png: not an image"),
        ("empty file", "left2.png: the file is empty"),
        ("nothing", "no stereo images .* it is empty"),
    ],
)
def test_a_spoilt_folder_is_refused_in_words(folder, change, message):
    with pytest.raises(DataError, match=message):
        detect_boards(spoil(folder, change), BOARD, 4)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(DataError, match="nowhere does not exist; a folder of images"):
        stereo_pairs(tmp_path / "nowhere")
    with pytest.raises(DataError, match=r"no images left\*.png"):
        camera_images(tmp_path, "left")


def test_of_parts_seen_equally_often_the_largest_is_asked_about(folder, monkeypatch):
    board, lefts = Board(12, 9, 0.03), camera_images(folder, "left")
    parts = []
    for columns, rows in ((9, 6), (10, 7), (8, 6)):
        corners = np.full((9, 12, 2), np.nan)
        corners[:rows, :columns] = 1.0
        parts.append(BoardDetection(board, corners.reshape(-1, 2), "", None, loose=True))
    monkeypatch.setattr(Board, "find", lambda *_: parts.pop())
    with pytest.raises(DataError, match="is it a 10x7 board"):
        detect_boards_of_cameras({"left": lefts}, board, 4)


@pytest.mark.slow
def test_a_board_of_the_wrong_size_is_told_which_size_was_seen(folder):
    for image in (*folder.glob("*10.png"), *folder.glob("*2.png")):
        image.unlink()
    with pytest.raises(DataError, match="none of 2 images shows all of a 6x9 board") as caught:
        detect_boards(folder, Board(6, 9, 0.03))
    assert "is it a 5x4 board" in str(caught.value)
    assert "counts inner corners" in str(caught.value)
    with pytest.raises(DataError, match=r"no 4x3 board in any of 2 images .*left1.png") as caught:
        detect_boards(folder, Board(4, 3, 0.03))
    assert "a 5x4 board seems to be there" in str(caught.value)
