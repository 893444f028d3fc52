"""Chessboards: corners, their order, and boards of another size."""

import numpy as np
import pytest

from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.vision.boards.board_detections import detect_boards, detect_boards_of_cameras
from nico_selfmodel.vision.boards.board_images import stereo_pairs
from nico_selfmodel.vision.boards.chessboard import Board, BoardDetection, find_chessboard
from nico_selfmodel.vision.images.image_file import read_image
from nico_selfmodel.vision.images.not_seen import NotSeen

from ..slow_rest import slow_rest
from .rendering import random_view, render_board

SIZE = (640, 480)
BOARD = Board(9, 6, 0.025)


def rendered(columns, rows, seed, *, size=330, tilt=0.6, roll=np.pi, **photograph):
    rng = np.random.default_rng(seed)
    H = random_view(rng, size, SIZE, tilt=tilt, roll=roll, center=(320, 240))
    return render_board(columns, rows, H, rng, image_size=SIZE, **photograph)


def test_a_board_is_written_as_its_inner_corners():
    board = Board.parse("9x6", 25)
    assert (board.columns, board.rows, str(board)) == (9, 6, "9x6")
    assert board.points.shape == (54, 3)
    assert board.points[10] == pytest.approx([0.025, 0.025, 0.0])


@pytest.mark.parametrize("text", ["9", "9x", "x6", "9x6x2", "-9x6", "2x6", "9,6", ""])
def test_what_is_no_board_is_refused(text):
    with pytest.raises(ValueError, match=r"9x6|at least 3x3"):
        Board.parse(text, 25)


@pytest.mark.parametrize("side", [0.0, -25.0, float("nan"), float("inf")])
def test_a_square_without_a_size_is_refused(side):
    with pytest.raises(ValueError, match="positive"):
        Board.parse("9x6", side)


@pytest.mark.parametrize("seed", range(6))
def test_corners_are_listed_alike_however_the_board_is_held(seed):
    truth = rendered(9, 6, seed)
    seen = find_chessboard(truth.image, BOARD, window=5)
    assert isinstance(seen, BoardDetection)
    errors = seen.corners - truth.points
    assert np.abs(errors).max() < 0.3
    assert np.abs(errors.mean(axis=0)).max() < 0.02


@pytest.mark.parametrize(("columns", "rows"), slow_rest([(8, 6), (5, 5), (7, 5), (6, 6)], plain=2))
def test_boards_that_look_alike_upside_down_are_listed_alike_in_both_cameras(columns, rows):
    board = Board(columns, rows, 0.03)
    for seed in range(3):
        left, right = rendered(columns, rows, seed), rendered(columns, rows, seed + 50, roll=0.3)
        seen = [find_chessboard(view.image, board, window=5).corners for view in (left, right)]
        # Turned the other way, as another detector might have listed it.
        turned = seen[1][::-1]
        assert board.same_order(seen[1], turned) == pytest.approx(seen[1])
        if columns == rows:
            quarter = np.rot90(seen[1].reshape(rows, columns, 2)).reshape(-1, 2)
            assert board.same_order(seen[1], quarter) == pytest.approx(seen[1])
        distances = np.linalg.norm(seen[0][:, None] - left.points, axis=2).min(axis=1)
        assert distances.max() < 0.5


def test_a_symmetric_board_begins_at_the_left():
    seen = find_chessboard(rendered(8, 6, 1, roll=0.4).image, Board(8, 6, 0.03), window=5)
    row = seen.corners[7] - seen.corners[0]
    assert row[0] > abs(row[1])


def test_the_right_camera_keeps_its_order_where_the_board_tells_it():
    left = np.arange(108.0).reshape(54, 2)
    np.testing.assert_array_equal(BOARD.same_order(left, left[::-1]), left[::-1])


@pytest.mark.parametrize("size", slow_rest(["3x3", "8x6", "10x5", "7x4"]))
def test_a_part_that_is_more_than_the_board_has_is_not_seen(size):
    image = rendered(9, 6, 3, tilt=0.3).image
    seen = find_chessboard(image, Board.parse(size, 25), window=5)
    assert isinstance(seen, NotSeen)
    assert f"no {size} board" in seen.reason or f"larger than {size}" in seen.reason
    assert f"a part of 9x6 corners is more than a {size} board has" in seen.reason


def test_a_board_over_exposed_or_absent_is_not_seen(draw_scene):
    image = rendered(9, 6, 4, tilt=0.2, roll=0.2).image
    burnt = np.clip(image.astype(int) * 8, 0, 255).astype(np.uint8)
    for spoilt in (burnt, draw_scene()):
        seen = find_chessboard(np.ascontiguousarray(spoilt), BOARD)
        assert isinstance(seen, NotSeen)
        assert "findChessboardCornersSB" in seen.reason


def test_the_window_and_the_detector_are_stated():
    image = rendered(9, 6, 5).image
    seen = find_chessboard(image, BOARD, window=7)
    assert (seen.window, seen.method) == (None, "findChessboardCorners")
    assert 20 < seen.smallest_square_px < 40
    faint = find_chessboard(np.rint(120.0 + 0.04 * image).astype(np.uint8), BOARD, window=7)
    assert (faint.window, faint.method) == (7, "findChessboardCorners")
    with pytest.raises(ValueError, match="window must be at least 1"):
        find_chessboard(rendered(9, 6, 5).image, BOARD, window=0)


@pytest.mark.real_data
@pytest.mark.parametrize(("k", "theirs", "share"), [(0, 0.3926, 0.45), (1, 0.445, 0.4)])
def test_real_photographs_fit_better_than_with_opencvs_own_corners(
    k, theirs, share, real_data_folder
):
    """OpenCV's published calibration of the left camera leaves 0.393 px, by `cornerSubPix`."""
    cv2 = pytest.importorskip("cv2")
    folder = real_data_folder / "stereo_chessboard"
    pairs, side = [(name, both[k]) for name, *both in stereo_pairs(folder)], SIDES[k]
    found = detect_boards_of_cameras({side: pairs}, BOARD)
    assert (found.window, dict(found.not_seen)) == (11, {})
    corners = [view.astype(np.float32) for view in found.views.of_camera(side)]
    assert len(corners) == 13
    end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
    subpix = [
        cv2.cornerSubPix(cv2.imread(str(path), 0), view.copy(), (11, 11), (-1, -1), end)
        for view, (_, path) in zip(corners, pairs, strict=True)
    ]
    boards = [BOARD.points.astype(np.float32)] * len(corners)
    ours, opencv = (
        cv2.calibrateCamera(
            boards, seen, (640, 480), np.eye(3), None, flags=cv2.CALIB_FIX_ASPECT_RATIO
        )[0]
        for seen in (corners, subpix)
    )
    assert opencv == pytest.approx(theirs, abs=0.02)
    assert ours <= share * theirs


@pytest.mark.slow
@pytest.mark.real_data
def test_no_real_photograph_shows_a_board_of_another_size(real_data_folder):
    files = sorted((real_data_folder / "stereo_chessboard").glob("*.jpg"))[::13]
    for size in ("8x6", "7x4"):
        board = Board.parse(size, 25)
        seen = [find_chessboard(read_image(path), board) for path in files]
        assert all(isinstance(item, NotSeen) for item in seen)


@pytest.mark.slow
@pytest.mark.real_data
def test_both_cameras_list_the_same_corners_in_the_same_order(real_data_folder):
    found = detect_boards(real_data_folder / "stereo_chessboard", BOARD)
    left, right = (found.views.of_camera(camera) for camera in ("left", "right"))
    # The cameras are parallel: from one camera to the other all corners move by nearly the same.
    moved = left - right
    assert np.abs(moved - moved.mean(axis=1, keepdims=True)).max() < 80
    assert np.abs(moved[..., 1]).max() < 40


def nearest(seen, truth):
    """Return how far each corner that was seen is from the nearest true one. Shape (n,)."""
    found = seen.corners[seen.seen]
    return np.linalg.norm(found[:, None] - truth.points, axis=2).min(axis=1)


@pytest.mark.parametrize("window", [1, 11])
def test_a_faint_board_of_which_no_corner_is_plain_is_found_all_the_same(window):
    """It had ended in an error of numpy's, and a whole calibration with it."""
    truth = rendered(9, 6, 5)
    faint = np.rint(120.0 + 0.04 * truth.image).astype(np.uint8)
    seen = find_chessboard(faint, BOARD, 11)
    assert seen.seen.all()
    assert nearest(seen, truth).max() < 1.0
    assert nearest(find_chessboard(truth.image, BOARD, window), truth).max() < 0.5


def test_corners_that_only_the_second_detector_finds_are_exact_too():
    """Its own are off by up to 0.7 px."""
    truth = rendered(9, 6, 3)
    seen = find_chessboard(255 - truth.image, BOARD)
    assert seen.method == "findChessboardCornersSB"
    assert seen.seen.all()
    assert nearest(seen, truth).max() < 0.06


def test_light_that_rises_from_side_to_side_moves_no_corner():
    """It moved all of them alike, by 0.03 px and more."""
    truth = rendered(9, 6, 5, noise=0.0)
    across = np.linspace(0.3, 1.1, truth.image.shape[1])[None, :, None]
    shaded = np.rint(np.minimum(truth.image * across, 255.0)).astype(np.uint8)
    seen = find_chessboard(shaded, BOARD)
    assert seen.seen.all()
    assert np.abs((seen.corners - truth.points).mean(axis=0)).max() < 0.01


@pytest.mark.parametrize("soft", [0.7, 3.0])
def test_corners_at_the_edge_of_a_shadow_count_as_not_seen(soft):
    """They were up to 5 px off, and taken."""
    truth = rendered(9, 6, 5)
    u = np.arange(truth.image.shape[1]) - truth.points[:, 0].mean() - 7.0
    shadow = 0.35 + 0.65 / (1.0 + np.exp(-u / soft))
    seen = find_chessboard(np.rint(truth.image * shadow[:, None]).astype(np.uint8), BOARD)
    assert 0.75 * 54 <= seen.seen.sum() < 54
    assert nearest(seen, truth).max() < 0.25
