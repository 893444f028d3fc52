"""Detections drawn into the images in which they were made.

Images are drawn upon at twice or more of their size where they are small, so that lines stay thin
beside what they mark and a label can be read.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.vision.boards.board_detection import BoardDetection
from nico_selfmodel.vision.color.color_blob import ColorBlob
from nico_selfmodel.vision.images.image_array import as_color
from nico_selfmodel.vision.images.not_seen import NotSeen
from nico_selfmodel.vision.markers.fiducial import Fiducial

Seen = BoardDetection | Fiducial | ColorBlob

_WIDTH = 1200  # that small images are enlarged to, by a whole number [px]
_MOST_ENLARGED = 4_000_000  # pixels of an image that is enlarged: it may be narrow and tall
_SHIFT = 4  # OpenCV draws at fractions of 1/16 px
_GREEN, _ORANGE, _BLUE = (80, 220, 60), (40, 150, 255), (255, 150, 40)
_WHITE, _BLACK, _RED = (255, 255, 255), (20, 20, 20), (60, 60, 235)
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def annotated(image: NDArray, seen: list[Seen] | NotSeen) -> NDArray:
    """Return an image with what was seen in it, or with the reason why nothing was.

    Args:
        image: BGR or grey, 8 bits.
        seen: What a detector said of it.

    Returns:
        BGR, a whole number of times as large as `image`.

    Raises:
        ValueError: If the image has another shape or type.
    """
    canvas = _Canvas(as_color(image))
    if isinstance(seen, NotSeen):
        canvas.banner(f"not seen: {seen.reason}")
        return canvas.image
    for item in seen:
        if isinstance(item, BoardDetection):
            _draw_board(canvas, item)
        elif isinstance(item, Fiducial):
            _draw_fiducial(canvas, item)
        else:
            _draw_blob(canvas, item)
    return canvas.image


class _Canvas:
    """An enlarged image that takes the pixel coordinates of the original."""

    def __init__(self, image: NDArray) -> None:
        height, width = image.shape[:2]
        most = int((_MOST_ENLARGED / (width * height)) ** 0.5)
        self.scale = max(1, min(round(_WIDTH / width), most))
        size = (image.shape[1] * self.scale, image.shape[0] * self.scale)
        self.image = cv2.resize(image, size, interpolation=cv2.INTER_CUBIC)
        self.unit = max(1.0, self.image.shape[1] / 1280)

    def at(self, points: ArrayLike) -> NDArray:
        """Return pixels of the enlarged image from those of the original."""
        return (np.asarray(points, dtype=float) + 0.5) * self.scale - 0.5

    def line(
        self, points: ArrayLike, color: tuple[int, int, int], width: float, *, closed: bool = False
    ) -> None:
        """Draw a line through pixels of the original."""
        self._polyline(self.at(points), color, width, closed=closed)

    def dot(self, point: ArrayLike, color: tuple[int, int, int], radius: float) -> None:
        """Draw a ring around a pixel of the original, open in the middle."""
        center = tuple(int(value) for value in np.rint(self.at(point) * 2**_SHIFT))
        around = round(radius * self.unit * 2**_SHIFT)
        for ink, width in ((_BLACK, 3.0), (color, 1.5)):
            cv2.circle(self.image, center, around, ink, self._width(width), cv2.LINE_AA, _SHIFT)

    def cross(self, point: ArrayLike, color: tuple[int, int, int], arm: float) -> None:
        """Draw a cross at a pixel of the original, open in the middle."""
        middle = self.at(point)
        for ink, width in ((_BLACK, 4.0), (color, 1.5)):
            for direction in np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]]):
                ends = middle + np.outer([0.3 * arm, arm], direction) * self.unit
                self._polyline(ends, ink, width)

    def text(self, text: str, point: ArrayLike, offset: tuple[float, float]) -> None:
        """Write white on black beside a pixel of the original, inside the image."""
        size, base, scale = self._text_size(text)
        height, width = self.image.shape[:2]
        left, bottom = self.at(point) + np.array(offset) * self.unit
        pad = 5.0 * self.unit
        left = float(np.clip(left, pad, max(width - size[0] - pad, pad)))
        bottom = float(np.clip(bottom, size[1] + pad, max(height - base - pad, pad)))
        corner = (round(left - pad), round(bottom - size[1] - pad))
        self._shade(corner, (round(left + size[0] + pad), round(bottom + base + 0.4 * pad)))
        where = (round(left), round(bottom))
        cv2.putText(self.image, text, where, _FONT, scale, _WHITE, self._width(1.2), cv2.LINE_AA)

    def banner(self, text: str) -> None:
        """Write a line, broken where needed, across the top of the image."""
        height, width = self.image.shape[:2]
        lines, pad = self._broken(text, width - 24.0 * self.unit), round(12 * self.unit)
        step = round(26 * self.unit)
        self._shade((0, 0), (width, min(height, step * len(lines) + pad)))
        cv2.rectangle(self.image, (0, 0), (max(pad // 3, 2), step * len(lines) + pad), _RED, -1)
        _, _, scale = self._text_size(text)
        for i, line in enumerate(lines):
            where = (pad, round(step * (i + 0.95)))
            cv2.putText(
                self.image, line, where, _FONT, scale, _WHITE, self._width(1.2), cv2.LINE_AA
            )

    def _broken(self, text: str, width: float) -> list[str]:
        lines = [""]
        for word in text.split():
            longer = f"{lines[-1]} {word}".strip()
            if lines[-1] and self._text_size(longer)[0][0] > width:
                lines.append(word)
            else:
                lines[-1] = longer
        return lines

    def _text_size(self, text: str) -> tuple[tuple[int, int], int, float]:
        scale = 0.6 * self.unit
        (width, height), base = cv2.getTextSize(text, _FONT, scale, self._width(1.2))
        return (width, height), base, scale

    def _shade(self, corner: tuple[int, int], opposite: tuple[int, int]) -> None:
        (left, top), (right, bottom) = np.clip([corner, opposite], 0, None)
        part = self.image[top:bottom, left:right]
        part[...] = (0.25 * part).astype(np.uint8)

    def _polyline(
        self, points: NDArray, color: tuple[int, int, int], width: float, *, closed: bool = False
    ) -> None:
        fixed = np.rint(points * 2**_SHIFT).astype(np.int32).reshape(1, -1, 2)
        cv2.polylines(
            self.image, list(fixed), closed, color, self._width(width), cv2.LINE_AA, _SHIFT
        )

    def _width(self, width: float) -> int:
        return max(1, round(width * self.unit))


def _draw_board(canvas: _Canvas, seen: BoardDetection) -> None:
    """Draw rows from green to blue, so that the order can be followed, with the first marked."""
    y = seen.board.points[:, 1]
    share = (y - y.min()) / np.ptp(y)
    before = None
    for i in np.flatnonzero(seen.seen).tolist():
        mixed = (1.0 - share[i]) * np.array(_GREEN) + share[i] * np.array(_BLUE)
        color = (int(mixed[0]), int(mixed[1]), int(mixed[2]))
        if before is not None:
            canvas.line(seen.corners[[before, i]], color, 1.5 if y[before] == y[i] else 1.0)
        canvas.dot(seen.corners[i], color, 5.0)
        before = i
    first = int(np.argmax(seen.seen))
    canvas.dot(seen.corners[first], _ORANGE, 10.0)
    what = "first corner" if first == 0 else f"corner {first}"
    if not seen.seen.all():
        what += f", {np.count_nonzero(seen.seen)} of {len(seen.seen)} seen"
    canvas.text(f"{seen.board}: {what}", seen.corners[first], (14.0, -14.0))


def _draw_fiducial(canvas: _Canvas, seen: Fiducial) -> None:
    color = _ORANGE if seen.mirrored else _GREEN
    canvas.line(seen.corners, _BLACK, 4.0, closed=True)
    canvas.line(seen.corners, color, 2.0, closed=True)
    canvas.dot(seen.corners[0], color, 5.0)
    canvas.cross(seen.center, color, 14.0)
    lowest = seen.corners[np.argmax(seen.corners[:, 1])]
    u, v = seen.center
    name = f"{seen.id}{' mirrored' if seen.mirrored else ''}  ({u:.2f}, {v:.2f})"
    canvas.text(name, lowest, (-20.0, 30.0))


def _draw_blob(canvas: _Canvas, seen: ColorBlob) -> None:
    large = cv2.resize(
        seen.mask.astype(np.uint8),
        (canvas.image.shape[1], canvas.image.shape[0]),
        interpolation=cv2.INTER_NEAREST,
    )
    outlines, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    for ink, width in ((_BLACK, 4.0), (_GREEN, 2.0)):
        cv2.drawContours(
            canvas.image, outlines, -1, ink, max(1, round(width * canvas.unit)), cv2.LINE_AA
        )
    left, top, width, height = seen.box
    edges = np.array([[0, 0], [width, 0], [width, height], [0, height]])
    box = edges + np.array([left - 0.5, top - 0.5])  # the outer edges of its pixels
    canvas.line(box, _BLUE, 1.0, closed=True)
    canvas.cross(seen.center, _WHITE, 14.0)
    u, v = seen.center
    canvas.text(f"({u:.2f}, {v:.2f})  {seen.area_px} px", box[3], (0.0, 30.0))
