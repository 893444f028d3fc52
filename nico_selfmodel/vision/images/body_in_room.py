"""A body in pictures: what is behind it, where its parts meet, what covers it."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.vision.images.image_array import smoothed_within

_ASIDE = 6
"""How far beside a body the room is looked at that is behind its outline: farther than a loose arm
stands from where it is expected [px]."""
_SEAM, _JOINED = 7, 0.01
"""About where two parts meet the crack between them may be seen, in a window as wide [px]; they
meet where neither is farther than this behind the other [m]."""


def before_room(expected: NDArray, seen: NDArray, body: NDArray, told: NDArray) -> NDArray:
    """Return what is expected of a body with what is about it, as it is seen there.

    Nobody knows the room behind a body, but beyond its outline it shows itself, and a little way on
    it looks alike.

    Args:
        expected: BGR. Shape (h, w, 3).
        seen: The same. Shape (h, w, 3).
        body: What shows the body. Shape (h, w).
        told: What tells how bright the picture is. Shape (h, w).

    Returns:
        BGR, as bright as what is expected. Shape (h, w, 3).
    """
    room = cv2.erode((~body).astype(np.uint8), np.ones((2 * _ASIDE + 1,) * 2, np.uint8)) > 0
    about = smoothed_within(seen, room, _ASIDE)
    inside = told & body
    level = expected[inside].sum(axis=1).astype(float), seen[inside].sum(axis=1).astype(float)
    gain = float(np.median(level[1] / np.maximum(level[0], 1.0))) if inside.any() else 1.0
    return np.where(body[:, :, None], expected, about / max(gain, 0.1))


def seam(part: NDArray, others: NDArray, depth: NDArray) -> NDArray:
    """Return what is next to where a part of a body and the rest of it meet.

    The crack there opens and closes as the part moves. Where one hides the other there is none.

    Args:
        part: What shows it. Shape (h, w).
        others: What shows the rest. Shape (h, w).
        depth: Along the optical axis [m]. Shape (h, w).

    Returns:
        Truth values. Shape (h, w).
    """
    near = np.ones((3, 3), np.uint8)
    both = [cv2.dilate(one.astype(np.uint8), near) > 0 for one in (part, others)]
    with np.errstate(invalid="ignore"):
        step = cv2.dilate(depth, near) - cv2.erode(depth, near)
        meet = both[0] & both[1] & (step < _JOINED)
    return cv2.dilate(meet.astype(np.uint8), np.ones((_SEAM, _SEAM), np.uint8)) > 0


def within_hulls(bodies: Sequence[NDArray], shape: tuple[int, int]) -> NDArray:
    """Return what is within the convex hulls of pixels, or next to it.

    Args:
        bodies: Pixels of each; one with a pixel that is not known covers nothing. (n, 2) each.
        shape: Height and width of the picture [px].

    Returns:
        Truth values. Shape (h, w).
    """
    found = np.zeros(shape, np.uint8)
    for pixels in bodies:
        if np.isfinite(pixels).all():
            hull = cv2.convexHull(np.rint(pixels).astype(np.int32))
            cv2.fillConvexPoly(found, hull, 1)
    return cv2.dilate(found, np.ones((3, 3), np.uint8)) > 0
