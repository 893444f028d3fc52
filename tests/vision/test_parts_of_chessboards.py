"""Chessboards of which a part is seen: behind a hand, or out of the picture."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from nico_selfmodel.dataset.lattice_places import lattice_of, places_of
from nico_selfmodel.errors import DataError
from nico_selfmodel.vision.boards.board_detections import detect_boards, detect_boards_of_cameras
from nico_selfmodel.vision.boards.chessboard import Board, find_chessboard
from nico_selfmodel.vision.images.not_seen import NotSeen

from ..slow_rest import slow_rest
from .printed_boards import Lens, chess_print, photographed

BOARD = Board(9, 6, 0.03)
PRINT = chess_print(9, 6, 0.03)
NODES = lattice_of(BOARD.points)[0]
FISHEYE = Lens((250.0, 249.0), (403.0, 297.0), (0.02, -0.005, 0.0, 0.0), fisheye=True)
LENSES = {"polynomial": Lens(), "fisheye": FISHEYE}


def errors(seen, photograph):
    """Return how far corners are from those they are, of a part that lies on the board. (n, 2)."""
    rows = np.flatnonzero(seen.seen)
    apart = np.linalg.norm(seen.corners[rows][:, None] - photograph.pixels, axis=2)
    true = apart.argmin(axis=1)
    assert apart.min(axis=1).max() < 1.0  # none where the board has none
    places = places_of(NODES[true], 9, 6)
    assert any(np.array_equal(place, NODES[rows]) for place in places)
    return seen.corners[rows] - photograph.pixels[true]


@pytest.mark.slow
@pytest.mark.parametrize("lens", slow_rest(list(LENSES), plain=1))
@pytest.mark.parametrize("count", [1, pytest.param(30, marks=pytest.mark.slow)])
def test_parts_are_found_where_they_are_and_as_often_as_by_opencv(lens, count):
    rng = np.random.default_rng((count, 5))
    opencv, found, off, share = 0, 0, [], []
    while opencv < count:
        photograph = photographed(
            PRINT, BOARD.points, rng, lens=LENSES[lens], hidden=rng.uniform(0.3, 0.6)
        )
        flags = cv2.CALIB_CB_LARGER + cv2.CALIB_CB_NORMALIZE_IMAGE
        there, corners, _ = cv2.findChessboardCornersSBWithMeta(photograph.image, (3, 3), flags)
        if not there:
            continue
        apart = np.linalg.norm(corners.reshape(-1, 1, 2) - photograph.pixels, axis=2).min(axis=1)
        if apart.max() > 2.0 or len(corners) < 14:  # no part of the board, or less than is taken
            continue
        opencv += 1
        seen = find_chessboard(photograph.image, BOARD)
        if isinstance(seen, NotSeen):
            continue
        found += 1
        off.append(errors(seen, photograph))
        share.append(seen.seen.sum() / len(corners))
    off = np.concatenate(off)
    assert found == opencv
    assert np.mean(share) > 0.9
    assert np.abs(off.mean(axis=0)).max() < 0.02
    assert np.sqrt(np.mean(off**2)) < 0.1


@cache
def shown(seed=4, hidden=0.0, fill=0.7):
    rng = np.random.default_rng(seed)
    return photographed(PRINT, BOARD.points, rng, tilt=0.3, fill=fill, hidden=hidden)


@pytest.mark.parametrize("side", slow_rest(["left", "right", "above", "below"], plain=1))
def test_a_board_half_out_of_the_picture_is_seen_in_part(side):
    whole = shown()
    middle = np.rint(whole.pixels.mean(axis=0)).astype(int)
    image = whole.image.copy()
    covered = {
        "left": np.s_[:, : middle[0]],
        "right": np.s_[:, middle[0] :],
        "above": np.s_[: middle[1]],
        "below": np.s_[middle[1] :],
    }
    image[covered[side]] = 90
    seen = find_chessboard(image, BOARD)
    assert seen.loose
    assert seen.method == "corners that follow each other"
    assert 14 <= seen.seen.sum() <= 36
    assert np.abs(errors(seen, whole)).max() < 0.3


@pytest.mark.slow
def test_a_board_with_a_hole_lies_where_it_lies():
    whole = shown()
    image = whole.image.copy()
    u, v = np.rint(whole.pixels[22]).astype(int)
    image[v - 20 : v + 20, u - 20 : u + 20] = 90
    seen = find_chessboard(image, BOARD)
    assert not seen.loose
    assert 48 <= seen.seen.sum() <= 53
    assert np.nanmax(np.abs(seen.corners - whole.pixels)) < 0.3


@pytest.mark.slow
def test_two_rows_are_no_part():
    image = shown().image.copy()
    whole = shown()
    grid = whole.pixels.reshape(6, 9, 2)
    outline = np.concatenate([grid[2], grid[5, ::-1] + 3.0 * (grid[5, ::-1] - grid[4, ::-1])])
    low = np.rint(outline + (outline - whole.pixels.mean(axis=0)) * 0.4).astype(np.int32)
    cv2.fillPoly(image, [cv2.convexHull(low)], 90)
    assert isinstance(find_chessboard(image, BOARD), NotSeen)


@pytest.fixture
def folder(tmp_path):
    """Photographs of a pair: whole, the right camera's in part, the left one's, and neither."""
    whole, other = shown(4), shown(6)
    half = whole.image.copy()
    half[:, : int(whole.pixels[:, 0].mean())] = 90
    pictures = {
        "left01": whole.image,
        "right01": half,
        "left02": half,
        "right02": whole.image,
        "left03": other.image,
        "right03": other.image,
    }
    for name, image in pictures.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    return tmp_path


@pytest.mark.slow
def test_photographs_tell_of_parts(folder):
    found = detect_boards(folder, BOARD)
    assert found.views.loose.tolist() == [[False, True], [True, False], [False, False]]
    assert found.document["in_part"] == ["right01.png", "left02.png"]
    assert found.document["not_seen"] == {}
    told = found.told_views
    assert told.names == ("01", "02", "03", "01 right", "02 left")
    assert np.isnan(told.of_camera("right")[0]).all()
    image = found.read_images()["right"]["01 right"]
    assert image.shape[:2] == (600, 800)


@pytest.mark.slow
def test_a_board_that_no_photograph_shows_whole_is_asked_about(folder):
    whole = [("01", Path(folder) / "left01.png")]
    with pytest.raises(DataError, match=r"none of 1 images shows all of a 10x7 board.*is it a 9x6"):
        detect_boards_of_cameras({"left": whole}, Board(10, 7, 0.03))
    alone = [("01", Path(folder) / "right01.png")]
    with pytest.raises(DataError, match="none of 1 images shows all of a 9x6 board"):
        detect_boards_of_cameras({"right": alone}, BOARD)
