"""Printed boards are seen where the sheet has them, at the stated size."""

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.boards.board_kinds import board_of
from nico_selfmodel.vision.boards.board_sheet import BoardSheet

from ..slow_rest import slow_rest

DPI = 150
MM = DPI / 25.4
SHEETS = {
    "9x6": 20.0,
    "charuco:7x5": 25.0,
    "aprilgrid:5x4": 35.0,
    "circles:7x5": 25.0,
    "asymmetric-circles:4x11": 15.0,
}


@pytest.mark.parametrize("text", slow_rest(reversed(SHEETS), plain=2))
def test_a_printed_board_is_seen_at_its_size(text, tmp_path):
    board = board_of(text, SHEETS[text])
    BoardSheet(board).save(tmp_path / "board.png", dpi=DPI)
    image = cv2.GaussianBlur(cv2.imread(str(tmp_path / "board.png")), (0, 0), 1.0)
    seen = board.find(image, 5)
    assert seen.seen.all()
    truth = 1e3 * board.points[:, :2] * MM
    off = seen.corners - truth
    assert np.abs(off - off.mean(axis=0)).max() < 0.9  # edges are rounded to pixels
    size = np.ptp(seen.corners, axis=0) / np.ptp(truth, axis=0)
    assert size == pytest.approx(1.0, abs=2e-3)


def test_it_says_how_to_call_it_again(tmp_path):
    sheet = BoardSheet(board_of("charuco:7x5", 25.0, 18.0, "aruco_5x5_50"))
    sheet.save(tmp_path / "board.svg")
    words = "--board charuco:7x5 --square-mm 25 --tag-mm 18 --family aruco_5x5_50"
    assert words in (tmp_path / "board.svg").read_text()
    sheet.save(tmp_path / "board.pdf")
    assert words.encode() in (tmp_path / "board.pdf").read_bytes()


def test_circles_are_round_in_every_format(tmp_path):
    sheet = BoardSheet(board_of("circles:5x4", 25.0, 12.0))
    sheet.save(tmp_path / "board.svg")
    assert (tmp_path / "board.svg").read_text().count("<circle") == 20
    sheet.save(tmp_path / "board.pdf")
    assert (tmp_path / "board.pdf").read_bytes().count(b" c ") >= 60


def test_what_does_not_fit_is_said_with_the_paper_that_does():
    with pytest.raises(ValueError, match="240 x 168 mm does not fit on a4: take a3"):
        BoardSheet(board_of("9x6", 24.0))
    with pytest.raises(ValueError, match="take smaller squares"):
        BoardSheet(board_of("9x6", 400.0))
    with pytest.raises(ValueError, match="no paper 'b5'; there are a4, letter, a3"):
        BoardSheet(board_of("9x6", 20.0), "b5")
