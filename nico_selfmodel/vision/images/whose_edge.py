"""Which surface the edges of a picture belong to, where one part hides another."""

import cv2
import numpy as np
from numpy.typing import NDArray

_EDGE, _BEFORE = 3, 0.01
"""How far an edge spreads in smoothed pictures [px], and how far before another what hides it is
[m]."""


def whose_edge(depth: NDArray) -> NDArray:
    """Return the pixel whose surface each pixel's grey levels move with.

    Within 3 px of where something well before it ends, that is what hides it: smoothed pictures mix
    both, and the edge is the nearer one's. If each side counted by itself the nearer part would be
    told by half of its edge, and whatever is wrong alike on both sides would turn the body.

    Args:
        depth: Along the optical axis, inf where nothing is [m]. Shape (h, w).

    Returns:
        Numbers of pixels, row by row. Shape (h, w).
    """
    height, width = depth.shape
    reach = np.arange(-_EDGE, _EDGE + 1)
    down, right = (one.ravel() for one in np.meshgrid(reach, reach, indexing="ij"))
    within = np.hypot(down, right) <= _EDGE
    window = within.reshape(len(reach), -1).astype(np.uint8)
    nearest = cv2.erode(depth, window, borderType=cv2.BORDER_REPLICATE)
    found = np.arange(depth.size).reshape(depth.shape)
    with np.errstate(invalid="ignore"):
        rows, columns = np.nonzero(depth - nearest > _BEFORE)
    rest = np.ones(len(rows), dtype=bool)
    for dv, du in zip(down[within], right[within], strict=True):
        v, u = np.clip(rows + dv, 0, height - 1), np.clip(columns + du, 0, width - 1)
        own = rest & (depth[v, u] == nearest[rows, columns])
        found[rows[own], columns[own]] = (v * width + u)[own]
        rest &= ~own
    return found
