"""Two cameras read at once: pairs by time, dropped pictures, lost cameras, freed devices."""

import threading
import time

import cv2
import numpy as np
import pytest

from nico_selfmodel.errors import DataError, RobotError
from nico_selfmodel.vision.images.image_file import write_image
from nico_selfmodel.vision.images.picture_sources import CameraLostError
from nico_selfmodel.vision.images.stereo_capture import StereoCapture

SIZE = (64, 48)


class FakeCamera:
    """Shows its time in its pictures [ms, in steps of 10], and does what it is told."""

    def __init__(self, begin, *, fps=50.0, late=0.0, size=SIZE):
        self.name, self.begin, self.fps, self.late, self.size = "fake", begin, fps, late, size
        self.count, self.lost, self.hangs = 0, threading.Event(), threading.Event()
        self.closed = threading.Event()

    def read(self):
        if self.lost.is_set():
            raise CameraLostError("camera fake gives no more pictures: check its cable")
        while self.hangs.is_set() and not self.lost.is_set():
            time.sleep(0.01)
        taken = self.begin + self.late + self.count / self.fps
        time.sleep(max(0.0, taken - time.monotonic()))
        self.count += 1
        picture = np.full((self.size[1], self.size[0], 3), self.count % 256, dtype=np.uint8)
        return taken, picture

    def close(self):
        self.closed.set()


@pytest.fixture
def pair_of():
    """Return a function that opens two fake cameras, and close them at the end."""
    opened = []

    def make(left=None, right=None, **options):
        cameras = []

        def opener_with(settings):
            def opened_at(begin):
                cameras.append(FakeCamera(begin, **settings))
                return cameras[-1]

            return opened_at

        sources = (opener_with(left or {}), opener_with(right or {}))
        capture = StereoCapture(*sources, SIZE, fps=50.0, patience=0.3, **options)
        opened.append(capture)
        capture.open(timeout=1.0)
        return capture, *cameras

    yield make
    for capture in opened:
        capture.close()


def look_for_a_while(capture):
    until = time.monotonic() + 1.5
    while time.monotonic() < until:
        capture.latest()
        time.sleep(0.01)


def test_the_newest_pictures_of_one_time_are_a_pair_and_the_others_are_dropped(pair_of):
    capture, left, right = pair_of(right={"late": 4e-3})
    time.sleep(0.25)
    pair = capture.latest()
    assert pair.times[1] - pair.times[0] == pytest.approx(4e-3, abs=1e-6)
    assert time.monotonic() - pair.time < 0.1
    assert pair.images[0][0, 0, 0] == pair.images[1][0, 0, 0] > 5
    assert all(count > 5 for count in capture.dropped)
    capture.close()
    assert left.closed.is_set()
    assert right.closed.is_set()
    assert not capture.is_open
    assert not any("camera" in thread.name for thread in threading.enumerate())


def test_a_slower_camera_is_paired_with_the_nearest_pictures(pair_of):
    capture, *_ = pair_of(right={"fps": 12.5})
    time.sleep(0.2)
    for _ in range(5):
        pair = capture.latest()
        assert abs(pair.times[0] - pair.times[1]) <= capture.tolerance
        time.sleep(0.03)


def test_cameras_that_are_never_together_are_told_from_lost_ones(pair_of):
    with pytest.raises(CameraLostError, match="never within 2 ms of each other"):
        pair_of(right={"late": 7e-3}, tolerance=2e-3)


def test_a_lost_camera_is_named_with_its_cause(pair_of):
    capture, left, right = pair_of()
    right.lost.set()
    with pytest.raises(CameraLostError, match="right camera: camera fake gives no more") as caught:
        look_for_a_while(capture)
    assert isinstance(caught.value.__cause__, CameraLostError)
    assert right.closed.wait(1.0)
    capture.close()
    assert left.closed.is_set()


def test_a_camera_that_hangs_is_silent_and_freed_when_it_wakes_up(pair_of):
    capture, left, _ = pair_of()
    left.hangs.set()
    with pytest.raises(CameraLostError, match=r"left camera fake has been silent for 0\.\d s"):
        look_for_a_while(capture)
    begin = time.monotonic()
    capture.close()
    assert time.monotonic() - begin < 0.6
    left.lost.set()
    assert left.closed.wait(1.0)


def test_pictures_of_another_size_are_refused(pair_of):
    with pytest.raises(CameraLostError, match="gives pictures of 32 x 48 pixels, expected 64 x 48"):
        pair_of(right={"size": (32, 48)})


def test_cameras_that_are_not_open_or_open_already_say_so(pair_of):
    with pytest.raises(RobotError, match="not open"):
        StereoCapture(0, 1).latest()
    capture, *_ = pair_of()
    with pytest.raises(RobotError, match="open already"):
        capture.open()
    with pytest.raises(ValueError, match="must be positive"):
        StereoCapture(0, 1, fps=0.0)


def grey(value):
    return np.full((SIZE[1], SIZE[0], 3), value, dtype=np.uint8)


def test_a_folder_with_left_and_right_images_feeds_both_cameras_until_it_ends(tmp_path):
    for k in range(1, 13):
        write_image(tmp_path / f"left{k}.png", grey(k))
        write_image(tmp_path / f"right{k}.png", grey(100 + k))
    with StereoCapture(tmp_path, str(tmp_path), SIZE, fps=60.0, patience=0.3) as capture:
        pair = capture.latest()
        left, right = (int(image[0, 0, 0]) for image in pair.images)
        assert right == 100 + left
        assert pair.times[0] == pair.times[1]
        time.sleep(0.4)
        with pytest.raises(CameraLostError, match="have all been shown"):
            capture.latest()


def test_video_files_are_played_in_real_time(tmp_path):
    for camera, first in (("left", 10), ("right", 110)):
        writer = cv2.VideoWriter(
            str(tmp_path / f"{camera}.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, SIZE
        )
        assert writer.isOpened()
        for k in range(8):
            writer.write(grey(first + 10 * k))
        writer.release()
    paths = [tmp_path / "left.avi", tmp_path / "right.avi"]
    with StereoCapture(*paths, SIZE, fps=25.0) as capture:
        time.sleep(0.12)
        left, right = (float(image.mean()) for image in capture.latest().images)
        assert right - left == pytest.approx(100.0, abs=3.0)
        assert 25.0 < left < 65.0
        time.sleep(0.3)
        with pytest.raises(CameraLostError, match=r"left\.avi has ended"):
            capture.latest()


def test_sources_that_are_none_are_explained(tmp_path):
    with pytest.raises(CameraLostError, match="there is no camera /dev/video77; there is"):
        StereoCapture(77, 78, SIZE).open()
    with pytest.raises(CameraLostError, match="no camera's number, no video and no folder"):
        StereoCapture(tmp_path / "nothing", 1, SIZE).open()
    (tmp_path / "text.avi").write_text("no video")
    with pytest.raises(CameraLostError, match="not a video that can be read"):
        StereoCapture(tmp_path / "text.avi", 1, SIZE).open()
    (tmp_path / "empty").mkdir()
    with pytest.raises(CameraLostError, match="no images"):
        StereoCapture(tmp_path / "empty", 1, SIZE).open()
    (tmp_path / "empty" / "left1.png").write_text("no image")
    write_image(tmp_path / "empty" / "right1.png", grey(1))
    with pytest.raises(CameraLostError, match="not an image that can be read") as caught:
        StereoCapture(tmp_path / "empty", tmp_path / "empty", SIZE).open()
    assert isinstance(caught.value.__cause__, DataError)


class Scripted:
    """A source that gives pictures and then fails, each after a while."""

    def __init__(self, pictures, after, error):
        self.name, self._left, self._after, self._error = "scripted", pictures, after, error

    def read(self):
        time.sleep(self._after)
        if self._left == 0:
            raise CameraLostError(self._error)
        self._left -= 1
        return time.monotonic(), grey(1)

    def close(self):
        pass


@pytest.mark.parametrize("first", ["left", "right"])
def test_a_camera_that_gave_nothing_says_why_however_late_it_fails(first):
    ended, broken = Scripted(1, 0.0, "all shown"), Scripted(0, 0.2, "not readable")
    sources = (ended, broken) if first == "left" else (broken, ended)
    with pytest.raises(CameraLostError, match="not readable"):
        StereoCapture(*(lambda _, one=one: one for one in sources), SIZE).open()


def test_a_camera_that_hangs_does_not_hide_that_the_other_failed():
    hangs, broken = Scripted(0, 1.0, "late"), Scripted(0, 0.0, "not readable")
    begin = time.monotonic()
    with pytest.raises(CameraLostError, match="not readable"):
        StereoCapture(lambda _: hangs, lambda _: broken, SIZE, patience=0.2).open()
    assert time.monotonic() - begin < 0.9
