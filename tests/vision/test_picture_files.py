"""Pictures are looked at by their header first, and whatever is named like one is no trap."""

import os
import socket
import struct
import subprocess
import sys
import time
import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from nico_selfmodel.errors import DataError
from nico_selfmodel.vision.boards.chessboard import Board, find_chessboard, size_of_board
from nico_selfmodel.vision.color.color_blob import color_blobs, find_color_blob
from nico_selfmodel.vision.color.color_model import ColorModel
from nico_selfmodel.vision.images.image_file import read_image
from nico_selfmodel.vision.images.picture_header import MOST_PIXELS, check_header
from nico_selfmodel.vision.markers.fiducial import FiducialSearch

from ..slow_rest import slow_rest

RED = ColorModel("red", (20.0, 20.0), 0.0, 40.0, 0.2)


def encoded(width, height, ending=".png"):
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return cv2.imencode(ending, image)[1].tobytes()


def empty_png(width, height):
    """Return a PNG of a few hundred bytes that unfolds to so many pixels."""

    def chunk(name, data):
        length, check = struct.pack(">I", len(data)), struct.pack(">I", zlib.crc32(name + data))
        return length + name + data + check

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


@pytest.mark.parametrize("ending", [".png", ".jpg"])
@pytest.mark.parametrize("size", [(16, 16), (40, 17), (17, 40)])
def test_the_header_tells_the_size_of_what_is_decoded(tmp_path, ending, size):
    content = encoded(*size, ending)
    assert check_header(content) == size
    (tmp_path / f"a{ending}").write_bytes(content)
    assert read_image(tmp_path / f"a{ending}").shape == (size[1], size[0], 3)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_a_picture_without_colours_has_its_grey_in_all_three(tmp_path, ending):
    grey = np.random.default_rng(1).integers(0, 256, (40, 60), dtype=np.uint8)
    for name, image in (("grey", grey), ("sixteen", 257 * grey.astype(np.uint16))):
        if ending == ".png" or name == "grey":
            (tmp_path / f"{name}{ending}").write_bytes(cv2.imencode(ending, image)[1].tobytes())
            read = read_image(tmp_path / f"{name}{ending}")
            expected = cv2.imread(str(tmp_path / f"{name}{ending}"), cv2.IMREAD_COLOR)
            np.testing.assert_array_equal(read, expected)
            assert len(np.unique(read)) > 100


def test_the_size_is_found_behind_what_a_camera_writes_before_it():
    jpeg = encoded(64, 48, ".jpg")
    thumbnail = encoded(20, 20, ".jpg")
    exif = b"\xff\xe1" + struct.pack(">H", len(thumbnail) + 2) + thumbnail
    assert check_header(jpeg[:2] + exif + b"\xff\xff" + jpeg[3:]) == (64, 48)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (empty_png(9000, 9000), "9000x9000 pixels; at most 40 megapixels"),
        (empty_png(40_000, 20), "30000 a side"),
        (empty_png(2**31 - 1, 2**31 - 1), "at most 40 megapixels"),
        (empty_png(0, 100), "0x100 pixels; an image was expected"),
        (encoded(64, 48, ".jpg")[:-200], "cut off"),
        (encoded(64, 48, ".jpg")[:10], "a JPEG without a header"),
        (encoded(64, 48)[:20], "a PNG without a header"),
        (encoded(64, 48)[:500], r"not an image that can be read|damaged"),
        (empty_png(640, 480), r"not an image that can be read|damaged"),
        (encoded(20, 20, ".bmp"), "save it as PNG or JPEG"),
        (b"\x00" * 100, "save it as PNG or JPEG"),
        (b"", "the file is empty"),
    ],
)
def test_a_picture_that_nothing_can_be_seen_in_is_refused(tmp_path, capfd, content, message):
    path = tmp_path / "picture.png"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message) as caught:
        read_image(path)
    assert str(path) in str(caught.value)
    assert capfd.readouterr().err == ""


def test_the_limit_is_where_it_is_said_to_be():
    assert check_header(empty_png(MOST_PIXELS // 4000, 4000))
    with pytest.raises(ValueError, match="megapixels"):
        check_header(empty_png(MOST_PIXELS // 4000 + 1, 4000))


@pytest.mark.parametrize("kind", slow_rest(["pipe", "socket", "device", "folder"]))
def test_what_is_no_file_is_neither_waited_for_nor_left_half_done(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a.png"
    listening = socket.socket(socket.AF_UNIX)
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        listening.bind("a.png")
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    code = "from nico_selfmodel.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "detect", "a.png", "--fiducial", "--out", "out"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    listening.close()
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert [left.name for left in tmp_path.iterdir()] == ["a.png"]


@pytest.mark.parametrize(("width", "height"), [(1, 4000), (4000, 1), (15, 15)])
def test_a_picture_too_narrow_to_see_in_is_refused_by_name(tmp_path, command, width, height):
    (tmp_path / "left1.png").write_bytes(encoded(width, height))
    RED.save(tmp_path / "red.yaml")
    camera = ("calibrate", "camera", tmp_path, "--board", "9x6", "--square-mm", 25)
    picture = ("detect", tmp_path / "left1.png")
    looks = [
        (*picture, "--fiducial"),
        (*picture, "--board", "9x6"),
        (*picture, "--color", tmp_path / "red.yaml"),
    ]
    before = sorted(tmp_path.iterdir())
    for words in (camera, *looks):
        done = command(*words, "--out", tmp_path / "out")
        assert done.returncode == 2, done.stdout
        assert done.stderr.count("\n") == 1
        assert "left1.png: " in done.stderr
        assert "at least 16 a side" in done.stderr
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("shape", [(15, 40), (40, 15), (1, 1), (0, 0), (20, 30_001)])
def test_detectors_say_what_size_they_need(shape):
    image = np.zeros((*shape, 3), dtype=np.uint8)
    for look in (
        lambda: FiducialSearch.of(image).seen,
        lambda: find_chessboard(image, Board(9, 6, 0.025)),
        lambda: size_of_board(image),
        lambda: find_color_blob(image, RED),
    ):
        with pytest.raises(
            ValueError, match=r"image must have at least 16 a side|8 bits and shape"
        ):
            look()


def test_noise_has_many_patches_and_takes_no_memory_for_each():
    noise = np.random.default_rng(0).integers(0, 256, (600, 800, 3), dtype=np.uint8)
    blobs = color_blobs(noise, replace(RED, blur_px=0.0))
    assert 500 < len(blobs) <= 1000
    assert all(blob.labels is blobs[0].labels for blob in blobs)
    assert blobs[0].mask.sum() == blobs[0].area_px


@pytest.mark.slow
@pytest.mark.parametrize("megapixels", [0.5, 2.0, 12.0])
def test_no_detector_takes_long_over_noise(megapixels):
    height = int((1e6 * megapixels / 1.5) ** 0.5)
    noise = np.random.default_rng(1).integers(0, 256, (height, height * 3 // 2, 3), dtype=np.uint8)
    for look in (
        lambda: FiducialSearch.of(noise).seen,
        lambda: find_chessboard(noise, Board(9, 6, 0.025)),
        lambda: size_of_board(noise),
        lambda: find_color_blob(noise, RED),
    ):
        began = time.process_time()
        look()
        assert time.process_time() - began < 20.0  # all threads together
