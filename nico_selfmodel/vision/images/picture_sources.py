"""Where live pictures come from: a camera, a video file, or a folder of images."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import cv2
from numpy.typing import NDArray

from nico_selfmodel.errors import RobotError
from nico_selfmodel.vision.images.image_file import image_files, read_image

Size = tuple[int, int]
"""Width and height [px]."""


class CameraLostError(RobotError):
    """A camera gives no pictures: unplugged, at its end, or never there."""


class PictureSource(Protocol):
    """Gives one picture after the other; used by one thread at a time."""

    name: str
    """What people call it."""

    def read(self) -> tuple[float, NDArray]:
        """Wait for the next picture; return when it was taken [s, monotonic] and it, BGR."""
        ...

    def close(self) -> None:
        """Give the device back."""
        ...


class CameraDevice:
    """A V4L2 camera."""

    def __init__(self, number: int, size: Size, fps: float) -> None:
        """Open the device.

        Args:
            number: N of `/dev/videoN`.
            size: Width and height to ask for [px].
            fps: Pictures a second to ask for [1/s].

        Raises:
            CameraLostError: If there is no such camera, or another program has it.
        """
        self.name = f"/dev/video{number}"
        if not Path(self.name).exists():
            found = ", ".join(sorted(str(path) for path in Path("/dev").glob("video*")))
            raise CameraLostError(f"there is no camera {self.name}; there is {found or 'none'}")
        self._capture = cv2.VideoCapture(number, cv2.CAP_V4L2)
        if not self._capture.isOpened():
            self._capture.release()
            raise CameraLostError(
                f"camera {self.name} cannot be opened: another program has it, or your user may "
                "not use it (group 'video')"
            )
        wanted = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FPS)
        for what, value in zip(wanted, (*size, fps), strict=True):
            self._capture.set(what, value)
        # A picture that waited in a queue shows where the hand was.
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def read(self) -> tuple[float, NDArray]:
        """Wait for the next picture; return when it was taken [s, monotonic] and it, BGR.

        Raises:
            CameraLostError: If the camera gives none.
        """
        grabbed = self._capture.grab()
        taken = time.monotonic()
        ok, picture = self._capture.retrieve() if grabbed else (False, None)
        if not ok or picture is None:
            raise CameraLostError(f"camera {self.name} gives no more pictures: check its cable")
        return taken, picture

    def close(self) -> None:
        """Give the device back."""
        self._capture.release()


class VideoFile:
    """A video, played in real time."""

    def __init__(self, path: Path, begin: float) -> None:
        """Open the file.

        Args:
            path: What OpenCV can read.
            begin: When its first picture counts as taken [s, monotonic].

        Raises:
            CameraLostError: If it cannot be read.
        """
        self.name = str(path)
        self._capture = cv2.VideoCapture(self.name)
        fps = self._capture.get(cv2.CAP_PROP_FPS)
        if not self._capture.isOpened() or not fps > 0.0:
            self._capture.release()
            raise CameraLostError(f"{path} is not a video that can be read")
        self._pace = _Pace(begin, fps)

    def read(self) -> tuple[float, NDArray]:
        """Wait until the next picture is due; return when that is [s, monotonic] and it, BGR.

        Raises:
            CameraLostError: If the video has ended.
        """
        ok, picture = self._capture.read()
        if not ok:
            raise CameraLostError(f"the video {self.name} has ended")
        return self._pace.wait(), picture

    def close(self) -> None:
        """Give the file back."""
        self._capture.release()


class ImageFolder:
    """Images of a folder one after the other, in real time."""

    def __init__(self, folder: Path, begin: float, fps: float, prefix: str = "") -> None:
        """Look into the folder.

        Args:
            folder: Where they are.
            begin: When the first one counts as taken [s, monotonic].
            fps: Images a second [1/s].
            prefix: How their names begin.

        Raises:
            DataError: If there is no such folder.
            CameraLostError: If it holds no such image.
        """
        self.name = str(folder / f"{prefix}*") if prefix else str(folder)
        files = [path for path in image_files(folder) if path.stem.lower().startswith(prefix)]
        if not files:
            raise CameraLostError(f"no images {self.name}: give a folder with PNG or JPEG files")
        self._files, self._pace = iter(files), _Pace(begin, fps)

    def read(self) -> tuple[float, NDArray]:
        """Wait until the next image is due; return when that is [s, monotonic] and it, BGR.

        Raises:
            CameraLostError: If all were shown.
            DataError: If it cannot be read.
        """
        path = next(self._files, None)
        if path is None:
            raise CameraLostError(f"the images {self.name} have all been shown")
        picture = read_image(path)
        return self._pace.wait(), picture

    def close(self) -> None:
        """Do nothing."""


class _Pace:
    """Times at which pictures of a file are due."""

    def __init__(self, begin: float, fps: float) -> None:
        self._begin, self._fps, self._shown = begin, fps, 0

    def wait(self) -> float:
        due = self._begin + self._shown / self._fps
        self._shown += 1
        time.sleep(max(0.0, due - time.monotonic()))
        return due


def opener(
    source: int | str | Path, side: str, size: Size, fps: float
) -> Callable[[float], PictureSource]:
    """Return what opens a source, given the time at which a file begins to play [s, monotonic].

    Args:
        source: Number of a V4L2 camera (or `/dev/videoN`), a video file, or a folder of images;
            a folder with `left*` and `right*` may be given for both cameras.
        side: `left` or `right`.
        size: Width and height of the pictures [px].
        fps: Pictures a second, for cameras and folders [1/s].

    Raises:
        CameraLostError: If there is no such file.
    """
    number = str(source).removeprefix("/dev/video")
    if number.isdecimal():
        return lambda _: CameraDevice(int(number), size, fps)
    path = Path(str(source))
    if path.is_dir():
        names = [file.stem.lower() for file in image_files(path)]
        prefix = side if any(name.startswith(side) for name in names) else ""
        return lambda begin: ImageFolder(path, begin, fps, prefix)
    if not path.is_file():  # a pipe would be waited for
        raise CameraLostError(f"{source}: no camera's number, no video and no folder of images")
    return lambda begin: VideoFile(path, begin)
