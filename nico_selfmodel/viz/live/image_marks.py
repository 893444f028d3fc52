"""Crosses and rings on what the cameras see: where the hand is, and where it is expected."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.viz.figures.rgba import Rgba

_MARK, _GAP, _THICK = 44, 18, 2
"""Half a cross, the hole in its middle, and half its thickness, in images [px]."""
_RING, _ARC = 26, np.tan(np.radians(21.0))
"""Radius of a ring in images [px], and the tangent of half the angle of its arcs."""


def marked(
    image: NDArray,
    marks: Mapping[Rgba, ArrayLike],
    rings: Mapping[Rgba, ArrayLike] = MappingProxyType({}),
) -> NDArray:
    """Return an image with a cross at each mark, open in the middle, and with rings.

    Args:
        image: Red, green, blue, 8 bits. Shape (h, w, 3).
        marks: Colour -> pixel (u, v); nan for none.
        rings: The same of what is marked by a ring.

    Returns:
        A copy. Shape (h, w, 3).
    """
    drawn = np.array(image)
    v, u = np.ogrid[: drawn.shape[0], : drawn.shape[1]]
    for shape, places in ((_cross, marks), (_ring, rings)):
        for turn, (color, pixel) in enumerate(places.items()):
            at = np.asarray(pixel, dtype=float)
            if not np.isfinite(at).all():
                continue
            x, y = u - round(at[0]), v - round(at[1])
            # Every other mark stands on its corner, so that both show where they coincide.
            x, y = (x, y) if turn % 2 == 0 else (x + y, x - y)
            drawn[shape(x, y, turn % 2)] = np.round(255.0 * np.array(color[:3])).astype(np.uint8)
    return drawn


def _cross(x: NDArray, y: NDArray, _turned: int) -> NDArray:
    """Return the pixels of a cross that is open in the middle."""
    far = np.maximum(np.abs(x), np.abs(y))
    return (np.minimum(np.abs(x), np.abs(y)) <= _THICK) & (far <= _MARK) & (far >= _GAP)


def _ring(x: NDArray, y: NDArray, turned: int) -> NDArray:
    """Return the pixels of a ring's four arcs about the axes; turned axes are longer by root 2."""
    radius = np.hypot(x, y) / np.sqrt(1.0 + turned)
    near_axis = np.minimum(np.abs(x), np.abs(y)) < _ARC * np.maximum(np.abs(x), np.abs(y))
    return (np.abs(radius - _RING) <= _THICK) & near_axis
