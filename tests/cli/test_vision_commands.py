"""Looking at photographs from the command line."""

import csv
import json

import cv2
import numpy as np
import pytest

from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.detections import COLUMNS
from nico_selfmodel.vision.images.image_file import read_image

RED, GREY = (40, 40, 190), (150, 150, 150)


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Return a folder: a marker and its reflection, a red square, a chessboard, nothing."""
    folder = tmp_path_factory.mktemp("photographs")
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    marker = np.pad(cv2.aruco.generateImageMarker(family, 3, 80), 40, constant_values=255)
    cv2.imwrite(str(folder / "marker.png"), np.hstack([marker, marker[:, ::-1]]))
    patch = np.full((120, 160, 3), GREY, np.uint8)
    patch[40:61, 70:91] = RED
    cv2.imwrite(str(folder / "patch.png"), patch)
    squares = np.kron(np.add.outer(np.arange(5), np.arange(6)) % 2, np.full((24, 24), 255))
    board = np.pad(squares.astype(np.uint8), 30, constant_values=255)
    cv2.imwrite(str(folder / "board.png"), board)
    cv2.imwrite(str(folder / "nothing.jpg"), np.full((120, 160, 3), GREY, np.uint8))
    return folder


@pytest.fixture
def color(tmp_path, photographs):
    path = tmp_path / "red.yaml"
    ColorModel.from_clicks([read_image(photographs / "patch.png")], [[(80, 50)]]).save(path)
    return path


def table(folder):
    with (folder / "detections.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    assert tuple(reader.fieldnames) == COLUMNS
    return rows


def test_markers_are_written_to_a_table_and_drawn(photographs, tmp_path, command):
    out = tmp_path / "seen"
    done = command("detect", photographs, "--fiducial", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document == json.loads((out / "result.json").read_text())
    counts = [document[key] for key in ("images", "images_with_detections", "detections")]
    assert counts == [4, 1, 2]
    names = {"board.png", "marker.png", "nothing.png", "patch.png"}
    assert {path.name for path in out.iterdir()} == {*names, "detections.csv", "result.json"}
    direct, mirrored = [row for row in table(out) if row["seen"] == "yes"]
    assert (direct["id"], direct["mirrored"], mirrored["mirrored"]) == ("3", "no", "yes")
    assert [float(direct[key]) for key in "uv"] == pytest.approx([79.5, 79.5], abs=0.02)
    assert float(direct["corner_0_u"]) == pytest.approx(39.5, abs=0.02)
    unseen = [row for row in table(out) if row["seen"] == "no"]
    assert len(unseen) == 3
    assert all(row["u"] == "" and "no apriltag_36h11 marker" in row["reason"] for row in unseen)


def test_tags_of_one_id_in_one_photograph_are_named(photographs, tmp_path, command):
    marker = cv2.imread(str(photographs / "marker.png"))[:, :160]
    cv2.imwrite(str(tmp_path / "two.png"), np.hstack([marker, marker]))
    done = command("detect", tmp_path / "two.png", "--fiducial", "--out", tmp_path / "seen")
    assert done.returncode == 0, done.stderr
    words = "two.png: marker 3 is at two places at once: tags of one id cannot be told apart"
    assert words in " ".join(done.stderr.split())
    assert len(table(tmp_path / "seen")) == 2


def test_a_colour_is_found_with_a_file_of_pick_color(photographs, tmp_path, command):
    color, mask, out = tmp_path / "red.yaml", tmp_path / "mask.png", tmp_path / "seen"
    image = photographs / "patch.png"
    words = ("--at", "80,50", "--at", "75,45", "--out", color, "--mask", mask)
    done = command("pick-color", image, *words)
    assert done.returncode == 0, done.stderr
    assert "seen in" in done.stdout
    assert "at 80.0,50.0" in done.stdout
    assert set(np.unique(read_image(mask))) == {0, 255}
    done = command("detect", image, "--color", color, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "color red: 1 seen in 1 of 1 images" in done.stdout
    (row,) = table(out)
    assert (float(row["u"]), float(row["v"])) == pytest.approx((80.0, 50.0), abs=0.01)


def test_a_chessboard_is_a_row_for_each_corner(photographs, tmp_path, command):
    image, out = photographs / "board.png", tmp_path / "seen"
    done = command("detect", image, "--board", "5x4", "--window", 5, "--out", out)
    assert done.returncode == 0, done.stderr
    rows = table(out)
    assert [row["id"] for row in rows] == [str(i) for i in range(20)]
    pixels = {(round(float(row["u"]), 1), round(float(row["v"]), 1)) for row in rows}
    assert pixels == {(53.5 + 24 * i, 53.5 + 24 * j) for i in range(5) for j in range(4)}


def test_nothing_seen_is_written_and_ends_with_1(photographs, tmp_path, command):
    out = tmp_path / "seen"
    done = command("detect", photographs / "nothing.jpg", "--fiducial", "--out", out)
    assert done.returncode == 1
    assert "not seen in" in done.stdout
    assert json.loads((out / "result.json").read_text())["detections"] == 0


def test_copies_of_images_of_one_name_do_not_meet(photographs, tmp_path, command):
    other = tmp_path / "other"
    other.mkdir()
    (other / "Marker.png").write_bytes((photographs / "marker.png").read_bytes())
    out = tmp_path / "seen"
    words = (photographs / "marker.png", other, "--fiducial", "--out", out)
    assert command("detect", *words).returncode == 0
    assert {path.name for path in out.glob("*.png")} == {"marker.png", "Marker_2.png"}
    assert command("detect", *words).returncode == 2
    assert command("detect", *words, "--force").returncode == 0


def test_a_sheet_of_markers_is_written(tmp_path, command):
    out = tmp_path / "sheet.svg"
    done = command("markers", "sheet", "--ids", "0-3,7", "--size-mm", 25, "--out", out)
    assert done.returncode == 0, done.stderr
    assert "5 markers of apriltag_36h11, 25 mm, 1 page;" in done.stdout
    assert out.read_text().count(" id 7") + out.read_text().count(">id 7") == 1
    assert command("markers", "sheet", "--out", out).returncode == 2
    assert command("markers", "sheet", "--out", out, "--force").returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("marker.png",), "choose one of --fiducial, --color FILE and --board"),
        (("marker.png", "--fiducial", "--board", "9x6"), "choose one of"),
        (("marker.png", "--board", "9x6", "--family", "x"), "--family are for boards with tags"),
        (("marker.png", "--fiducial", "--window", "5"), "--window is for --board"),
        (("marker.png", "--fiducial", "--family", "tag"), "no marker family 'tag'; there are"),
        (("marker.png", "--board", "nine"), "written as 9x6"),
        (("marker.png", "--color", "marker.png"), "not UTF-8 text"),
        (("nowhere.png", "--fiducial"), "nowhere.png: there is no such file"),
        (("empty", "--fiducial"), "empty: no images"),
        (("text.png", "--fiducial"), "text.png: not an image"),
    ],
)
def test_bad_input_to_detect_is_one_line_and_nothing_written(
    words, message, photographs, tmp_path, command, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "marker.png").write_bytes((photographs / "marker.png").read_bytes())
    (tmp_path / "text.png").write_text("not a photograph")
    (tmp_path / "empty").mkdir()
    done = command("detect", *words, "--out", "seen")
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"marker.png", "text.png", "empty"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "no window can be opened here: give the pixels with --at u,v"),
        (("--at", "80"), "--at takes a pixel as u,v"),
        (("--at", "800,50"), "800,50 lies outside the image of 160x120 pixels"),
        (("--at", "10,10"), "nearly grey"),
    ],
)
def test_bad_input_to_pick_color_is_one_line(words, message, photographs, tmp_path, command):
    out = tmp_path / "red.yaml"
    done = command("pick-color", photographs / "patch.png", *words, "--out", out)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not out.exists()


def test_a_photograph_is_not_written_over(photographs, color, tmp_path, command):
    image = photographs / "patch.png"
    before = image.read_bytes()
    words = ("--at", "80,50", "--mask", image, "--out", tmp_path / "c.yaml", "--force")
    done = command("pick-color", image, *words)
    assert done.returncode == 2
    assert "is read: choose another name" in done.stderr
    done = command("detect", image, "--color", color, "--out", photographs, "--force")
    assert done.returncode == 2
    assert image.read_bytes() == before


@pytest.mark.parametrize("words", [("detect",), ("markers", "sheet"), ("pick-color",)])
def test_the_commands_explain_themselves(words, command):
    done = command(*words, "--help")
    assert done.returncode == 0
    assert "Usage" in done.stdout
