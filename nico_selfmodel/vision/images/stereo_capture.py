"""Two cameras read at once, their pictures paired by the time at which they were taken."""

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray

from nico_selfmodel.errors import RobotError, SelfModelError
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.vision.images.picture_sources import (
    CameraLostError,
    PictureSource,
    Size,
    opener,
)
from nico_selfmodel.with_blocks import OpenedAtStart

_KEPT = 4
"""Pictures of each camera that wait for a partner; older ones are dropped."""


@dataclass(frozen=True, eq=False)
class StereoPair:
    """What both cameras saw at one time."""

    images: tuple[NDArray, NDArray]
    """Left and right picture, BGR, 8 bits. Shape (h, w, 3)."""
    times: tuple[float, float]
    """When each was taken [s, monotonic]."""

    @property
    def time(self) -> float:
        """When the later one was taken [s, monotonic]."""
        return max(self.times)


@dataclass(frozen=True, eq=False)
class _Picture:
    taken: float
    image: NDArray


class StereoCapture(OpenedAtStart):
    """Reads two sources, each in a thread of its own, and keeps only what is newest.

    Making one opens nothing. `open` waits for the first pair; `close` frees the devices.
    """

    def __init__(
        self,
        left: int | str | Path | Callable[[float], PictureSource],
        right: int | str | Path | Callable[[float], PictureSource],
        size: Size = (640, 480),
        *,
        fps: float = 30.0,
        tolerance: float | None = None,
        patience: float = 1.0,
    ) -> None:
        """Describe the cameras.

        Args:
            left: Number of a V4L2 camera, a video file, a folder of images, or what opens another
                source when told the time at which it begins.
            right: Likewise.
            size: Width and height of the pictures [px].
            fps: Pictures a second [1/s].
            tolerance: How far apart two pictures of a pair may be taken [s]; half the time between
                pictures if omitted.
            patience: How long a camera may be silent before it counts as lost [s].

        Raises:
            ValueError: If a number is not positive.
        """
        if not (min(size) > 0 and fps > 0.0 and patience > 0.0):
            raise ValueError(
                f"size, fps and patience must be positive, got {size}, {fps} and {patience}"
            )
        self.size, self.fps, self.patience = size, fps, patience
        self.tolerance = 0.5 / fps if tolerance is None else tolerance
        self._sources = (left, right)
        self._cameras: list[_Camera] = []
        self._last: StereoPair | None = None

    @property
    def is_open(self) -> bool:
        """Whether the cameras are read."""
        return bool(self._cameras)

    @property
    def dropped(self) -> tuple[int, int]:
        """How many pictures of each camera were never part of a pair that somebody took."""
        left, right = (
            (camera.count - camera.used for camera in self._cameras) if self._cameras else (0, 0)
        )
        return left, right

    def open(self, timeout: float = 10.0) -> StereoPair:
        """Open both cameras and wait for the first pair.

        Args:
            timeout: How long to wait [s].

        Raises:
            RobotError: If they are open already, or a camera cannot be opened, gives nothing, or
                pictures of another size.
        """
        if self._cameras:
            raise RobotError("the cameras are open already: close them first")
        begin, self._last = time.monotonic(), None
        try:
            for side, source in zip(SIDES, self._sources, strict=True):
                opened = source if callable(source) else opener(source, side, self.size, self.fps)
                self._cameras.append(_Camera(side, opened(begin), self.size))
            for camera in self._cameras:
                camera.start()
            while True:
                pair = self._pair()
                if pair is not None:
                    return pair
                if time.monotonic() - begin > timeout:
                    raise CameraLostError(f"no pair of pictures in {timeout:g} s: {self._why()}")
                time.sleep(2e-3)
        except BaseException:
            self.close()
            raise

    def latest(self) -> StereoPair:
        """Return the newest pair; never waits.

        Raises:
            RobotError: If the cameras are not open, one has failed or been silent, or the newest
                pair is older than `patience`; says which and why.
        """
        if not self._cameras:
            raise RobotError("the cameras are not open: call open first")
        pair = self._pair()
        if pair is None or time.monotonic() - pair.time > self.patience:
            raise CameraLostError(f"no pair of pictures for {self.patience:g} s: {self._why()}")
        return pair

    def close(self) -> None:
        """Free both devices; never fails. A camera that hangs is freed when it wakes up."""
        cameras, self._cameras = self._cameras, []
        for camera in cameras:
            camera.end()
        for camera in cameras:
            camera.join(self.patience)

    def _pair(self) -> StereoPair | None:
        """Return the newest pictures that were taken at one time, None if there are none yet."""
        self._check()
        left, right = ([*camera.pictures] for camera in self._cameras)
        pairs = [(a, b) for a in left for b in right if abs(a.taken - b.taken) <= self.tolerance]
        if not pairs:
            return self._last
        a, b = max(pairs, key=lambda pair: (pair[0].taken + pair[1].taken, -_apart(*pair)))
        for camera, picture in zip(self._cameras, (a, b), strict=True):
            camera.note(picture.taken)
        self._last = StereoPair((a.image, b.image), (a.taken, b.taken))
        return self._last

    def _check(self) -> None:
        """Raise what a camera failed with; of two, what that failed with which gave nothing.

        While one has neither given a picture nor failed it may still say why there is no pair: of
        one picture beside an unreadable one, not that the one has been shown.
        """
        failed = [camera for camera in self._cameras if camera.failed_at is not None]
        if not failed:
            return
        waiting = any(c.newest is None and c.failed_at is None for c in self._cameras)
        since = min(camera.failed_at or 0.0 for camera in failed)
        if waiting and time.monotonic() - since < self.patience:
            return
        min(failed, key=lambda camera: camera.newest is not None).check()

    def _why(self) -> str:
        now, newest = time.monotonic(), [camera.newest for camera in self._cameras]
        for camera, taken in zip(self._cameras, newest, strict=True):
            if taken is None:
                return f"the {camera.side} camera {camera.source.name} gave nothing"
            if now - taken > self.patience:
                return (
                    f"the {camera.side} camera {camera.source.name} has been silent for "
                    f"{now - taken:.1f} s: check its cable"
                )
        return (
            "both cameras run, but never within "
            f"{1e3 * self.tolerance:.0f} ms of each other: give a larger tolerance or the same fps"
        )


def _apart(one: _Picture, other: _Picture) -> float:
    return abs(one.taken - other.taken)


class _Camera:
    """One source and the thread that reads it. The thread frees the device when it ends."""

    def __init__(self, side: str, source: PictureSource, size: Size) -> None:
        self.side, self.source, self._size = side, source, size
        self.pictures: deque[_Picture] = deque(maxlen=_KEPT)
        self.count = self.used = 0
        self._last_used = -1.0
        self._failure: BaseException | None = None
        self.failed_at: float | None = None
        """When the thread failed [s, monotonic]."""
        self._ending = False
        self._thread = threading.Thread(target=self._run, name=f"{side} camera", daemon=True)

    @property
    def newest(self) -> float | None:
        """When the last picture was taken [s, monotonic]."""
        pictures = [*self.pictures]
        return pictures[-1].taken if pictures else None

    def start(self) -> None:
        self._thread.start()

    def note(self, taken: float) -> None:
        """Count a picture that became part of a pair."""
        self.used += taken > self._last_used
        self._last_used = max(taken, self._last_used)

    def check(self) -> None:
        """Raise what the thread failed with, with that as its cause."""
        if self._failure is not None:
            raise CameraLostError(f"{self.side} camera: {self._failure}") from self._failure

    def end(self) -> None:
        self._ending = True
        if self._thread.ident is None:  # never started: nobody else frees it
            self.source.close()

    def join(self, timeout: float) -> None:
        if self._thread.ident is not None:
            self._thread.join(timeout)

    def _run(self) -> None:
        try:
            while not self._ending:
                taken, image = self.source.read()
                size = (image.shape[1], image.shape[0])
                if size != self._size:
                    raise CameraLostError(
                        f"{self.source.name} gives pictures of {size[0]} x {size[1]} pixels, "
                        f"expected {self._size[0]} x {self._size[1]}: say so when opening it"
                    )
                self.pictures.append(_Picture(taken, image))
                self.count += 1
        except Exception as error:  # whatever it is, whoever uses the cameras must see it
            self._failure, self.failed_at = error, time.monotonic()
        finally:
            with suppress(SelfModelError, OSError):
                self.source.close()
