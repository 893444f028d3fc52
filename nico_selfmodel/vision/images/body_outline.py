"""Where a body ends in a picture: before a plain room by the room's colour, else by depths."""

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import EstimationError

_APART = 5.0
"""What differs more from the room shows something else [standard deviations of a smoothed level]"""
_GLASS = (0.75, 1.1)
"""How bright a room looks in a glass, of how it looks beside it."""
_FINE = 4
"""Parts of a pixel along each side in which an outline is drawn."""
_DEEP = 2
"""So far inside of a body its colour is not mixed with the room's [px]."""
_HOLE = 80
"""Patches of the room's colour that are smaller are on the body [px]."""
_DARK = 12.0
"""What is darker in a corner of the picture is beyond the lens."""
_LEAST = 500
"""What is smaller is no body [px]."""
_FAR = 60.0
"""Distances beyond are not told apart [px]."""
_FAT = 4
"""What is so near to where a depth jumps may have the depth of the other side [px]."""


def plain_color(picture: NDArray) -> NDArray:
    """Return the commonest colour of a picture, to a fraction of a grey level.

    Args:
        picture: BGR, 8 bits. Shape (h, w, 3).

    Returns:
        Blue, green, red. Shape (3,).
    """
    coarse = (picture.astype(np.int32) // 8) @ np.array([1, 32, 1024])
    own = picture.reshape(-1, 3)
    start = np.median(own[coarse.ravel() == np.argmax(np.bincount(coarse.ravel()))], axis=0)
    near = np.abs(own - start).max(axis=1) < 8.0
    return own[near].mean(axis=0)


def shows_room(colors: NDArray, room: NDArray) -> NDArray:
    """Return which colours in a glass are that of a plain room.

    Args:
        colors: BGR, as `plain_color` of a picture. Shape (..., 3).
        room: Colour of the room as seen directly. Shape (3,).

    Returns:
        Shape (...).
    """
    ratio = colors / room
    mean = ratio.mean(axis=-1)
    return (_GLASS[0] < mean) & (mean < _GLASS[1]) & (np.ptp(ratio, axis=-1) < 0.1)


def beyond_by_depth(picture: NDArray, room: NDArray, body: NDArray, other: NDArray) -> NDArray:
    """Return on which side of an outline pixels are that depths put there, all about them too.

    Depths do not tell to the pixel where a body ends: no outline passes there. Where a room is
    plain nothing is to be matched, and the depths of the body go on: what has its colour may be it.

    Args:
        picture: BGR, 8 bits. Shape (h, w, 3).
        room: Colour of the room as seen directly. Shape (3,).
        body: Pixels whose depth is that of the body. Shape (h, w).
        other: Pixels whose depth is that of the room behind it. Shape (h, w).

    Returns:
        60 for the room, -60 for the body, nan about the outline and where nothing is known.
        Shape (h, w) [px].
    """
    around = np.ones((2 * _FAT + 1, 2 * _FAT + 1), np.uint8)
    body = body & ~shows_room(cv2.blur(picture, (3, 3)), room)
    # Single pixels that match by chance, or do not match, say nothing about what is around them.
    smooth = [cv2.medianBlur(one.astype(np.uint8), 5) for one in (body, other)]
    own, beyond = (cv2.erode(one, around) > 0 for one in smooth)
    return np.where(own, -_FAR, np.where(beyond, _FAR, np.nan)).astype(np.float32)


def beyond_body(picture: NDArray, room: NDArray, noise: float) -> NDArray:
    """Return how far each pixel is outside of what stands before the room.

    The outline goes where half of a pixel shows the room (`share`), to a part of a pixel.

    Args:
        picture: BGR, 8 bits, of a glass in which the room is seen. Shape (h, w, 3).
        room: Colour of the room as seen directly. Shape (3,).
        noise: Standard deviation of a grey level.

    Returns:
        Distances, negative inside, cut off at 60 px; nan where neither body nor room is seen, as
        beside the glass. Shape (h, w) [px].

    Raises:
        EstimationError: If nothing is before the room.
    """
    color = plain_color(picture)
    smooth = cv2.blur(picture, (3, 3)).astype(float)
    apart = _APART * noise / 3.0 + 1.0
    other = np.abs(smooth - color).max(axis=2) > apart
    dark = smooth.max(axis=2) < _DARK
    beside = (np.abs(smooth - room).max(axis=2) < apart) | _at_corners(dark)
    own, strange = _split(other & ~beside, other)
    if not own.any():
        raise EstimationError("nothing stands before the room: is the robot in the mirror?")
    signed = np.full(own.shape, _FAR, np.float32)
    near = _about(own)
    signed[near] = _signed(_share(picture[near], color, own[near]))
    return np.where(strange, np.nan, np.clip(signed, -_FAR, _FAR)).astype(np.float32)


def _about(own: NDArray) -> tuple[slice, slice]:
    """Return the part of a picture in which distances from a body are told apart."""
    margin = int(_FAR) + 2
    sides = [np.flatnonzero(own.any(axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(max(0, s[0] - margin), s[-1] + margin + 1) for s in sides)
    return rows, columns


def _signed(share: NDArray) -> NDArray:
    """Return how far pixels are outside of where half of them shows the body [px]. (h, w)."""
    fine = cv2.resize(share, None, fx=_FINE, fy=_FINE, interpolation=cv2.INTER_LINEAR)
    inside = (fine > 0.5).astype(np.uint8)
    away = [cv2.distanceTransform(one, cv2.DIST_L2, 5) for one in (1 - inside, inside)]
    apart = cv2.resize(away[0] - away[1], share.shape[::-1], interpolation=cv2.INTER_AREA)
    return apart / _FINE


def _at_corners(dark: NDArray) -> NDArray:
    """Return which dark pixels reach a corner of the picture, where a lens shows nothing."""
    labels = cv2.connectedComponents(dark.astype(np.uint8))[1]
    corners = labels[[0, 0, -1, -1], [0, -1, 0, -1]]
    grown = np.isin(labels, corners[corners > 0]).astype(np.uint8)
    return cv2.dilate(grown, np.ones((9, 9), np.uint8)) > 0


def _split(body: NDArray, other: NDArray) -> tuple[NDArray, NDArray]:
    """Return the body among what may be it, and what is neither body nor the room in a glass."""
    opened = cv2.morphologyEx(body.astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened)
    large = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= _LEAST]
    own = np.isin(labels, large)
    holes, parts, sizes, _ = cv2.connectedComponentsWithStats((~own).astype(np.uint8))
    small = [k for k in range(1, holes) if sizes[k, cv2.CC_STAT_AREA] < _HOLE]
    own |= np.isin(parts, small)
    reached = cv2.dilate(own.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    strange = (cv2.dilate(other.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0) & ~reached
    return own, strange


def _share(picture: NDArray, color: NDArray, own: NDArray) -> NDArray:
    """Return which part of each pixel shows the body, by its colour a little inside. (h, w)."""
    deep = cv2.erode(own.astype(np.uint8), np.ones((2 * _DEEP + 1, 2 * _DEEP + 1), np.uint8))
    _, nearest = cv2.distanceTransformWithLabels(
        1 - deep, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    nearest = np.asarray(nearest, dtype=np.intp)
    inner = np.zeros((int(nearest.max()) + 1, 3))
    inner[nearest[deep > 0]] = cv2.blur(picture, (3, 3))[deep > 0]
    contrast = inner[nearest] - color
    found = np.sum((picture - color) * contrast, axis=2) / np.sum(contrast**2, axis=2).clip(25.0)
    edge = cv2.dilate(own.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(deep > 0, 1.0, np.where(edge, np.clip(found, 0.0, 1.0), 0.0)).astype(np.float32)
