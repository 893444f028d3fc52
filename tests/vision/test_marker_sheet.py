"""Marker sheets: exact sizes in every format, and every marker readable."""

import re
import struct

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.images.image_file import read_image
from nico_selfmodel.vision.markers.fiducial import FiducialSearch
from nico_selfmodel.vision.markers.marker_sheet import MarkerSheet, parse_ids


def test_the_markers_of_a_printed_sheet_are_read_at_their_exact_size(tmp_path):
    MarkerSheet((0, 3, 7, 12, 586), 30.0).save(tmp_path / "sheet.png")
    image = cv2.resize(
        read_image(tmp_path / "sheet.png"), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA
    )
    seen = FiducialSearch.of(image).seen
    assert [item.id for item in seen] == [0, 3, 7, 12, 586]
    sides = np.linalg.norm(np.diff([item.corners for item in seen], axis=1), axis=2)
    assert sides * 25.4 / 150 == pytest.approx(np.full((5, 3), 30.0), abs=0.045)  # a pixel of it


def test_a_png_says_its_resolution(tmp_path):
    MarkerSheet((0,), 20.0).save(tmp_path / "sheet.png", dpi=300)
    content = (tmp_path / "sheet.png").read_bytes()
    width, height = struct.unpack(">II", content[16:24])
    assert (width, height) == (2480, 3508)
    at = content.index(b"pHYs")
    assert struct.unpack(">IIB", content[at + 4 : at + 13]) == (11811, 11811, 1)


def test_an_svg_is_in_millimetres(tmp_path):
    MarkerSheet((5,), 40.0).save(tmp_path / "sheet.svg")
    text = (tmp_path / "sheet.svg").read_text()
    assert 'width="210mm" height="297mm" viewBox="0 0 210 297"' in text
    first = re.search(r'<path d="M([\d.]+) ([\d.]+)h([\d.]+)v([\d.]+)', text)
    assert float(first[3]) == 40.0  # the first row of cells, all black
    assert float(first[4]) == 5.0  # one of eight
    assert "id 5" in text
    assert "100 mm long" in text


def test_a_pdf_has_as_many_pages_as_it_takes_and_points_to_its_parts(tmp_path):
    sheet = MarkerSheet(tuple(range(30)), 60.0)
    sheet.save(tmp_path / "sheet.pdf")
    content = (tmp_path / "sheet.pdf").read_bytes()
    assert content.count(b"/Type /Page ") == len(sheet.pages) == 8
    assert b"/MediaBox [0 0 595.2756 841.8898]" in content
    start = int(re.search(rb"startxref\n(\d+)", content)[1])
    assert content[start:].startswith(b"xref")
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", content), start=1):
        assert content[int(place) :].startswith(b"%d 0 obj" % number)


def test_nothing_on_a_page_leaves_the_margins_or_overlaps():
    for size in (8.0, 30.0, 70.0, 148.0):
        (page, *_) = MarkerSheet(tuple(range(200)), size).pages
        lines = np.array([[a.x1, a.y1, a.x2, a.y2] for a in page.lines if a.dashed])
        frames = lines.reshape(-1, 4, 4)
        low, high = frames[..., :2].min(axis=1), frames[..., :2].max(axis=1)
        assert low.min() >= 12.0
        assert (high <= (210.0 - 12.0 + 1e-9, 297.0 - 32.0 + 1e-9)).all()
        apart = (low[:, None] >= high) | (high[:, None] <= low)
        assert (apart.any(axis=2) | np.eye(len(low), dtype=bool)).all()
        for cells, corner in zip(page.cells, low, strict=True):
            assert (cells.left, cells.top) == pytest.approx(corner + size / 8)


def test_ids_are_numbers_and_ranges():
    assert parse_ids("0-3, 7,5") == (0, 1, 2, 3, 7, 5)


@pytest.mark.parametrize("text", ["", "a", "3-1", "1,,2", "1-", "-1", "1,1", "0-2,2"])
def test_what_are_no_ids_is_refused(text):
    with pytest.raises(ValueError, match=r"ids .* got"):
        parse_ids(text)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MarkerSheet((), 30.0), "at least one marker"),
        (lambda: MarkerSheet((587,), 30.0), "ids 0 to 586"),
        (lambda: MarkerSheet((0,), 149.0), "from 3 to 148 on a4"),
        (lambda: MarkerSheet((0,), 2.0), "from 3 to 148 on a4"),
        (lambda: MarkerSheet((0,), float("nan")), "got nan"),
        (lambda: MarkerSheet((0,), 30.0, paper="a5"), "no paper 'a5'; there are a4, letter, a3"),
        (lambda: MarkerSheet((0,), 30.0).save("sheet.gif"), "written as .pdf, .svg, .png"),
        (lambda: MarkerSheet(tuple(range(20)), 60.0).save("sheet.svg"), "4 fit on one"),
    ],
)
def test_what_cannot_be_printed_is_refused(make, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=message):
        make()
    assert list(tmp_path.iterdir()) == []


def test_markers_that_a_mirror_turns_into_others_are_warned_of():
    with pytest.warns(UserWarning, match="8, 9 look in a mirror like other markers"):
        MarkerSheet(tuple(range(12)), 30.0, family="aruco_4x4_50")
