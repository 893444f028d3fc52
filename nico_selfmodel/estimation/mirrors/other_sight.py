"""Where one camera of a pair should see what the other one sees in a mirror."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig

_REACH = 4
"""How far beside a spot the body may be whose surface it is on: an outline is off [px]."""


def nearest_depth(depth: NDArray, u: float, v: float) -> float:
    """Return the depth of the surface next to a place of a picture.

    Args:
        depth: Along the optical axis, not finite where nothing is expected [m]. Shape (h, w).
        u: Column of the place [px].
        v: Row of the place [px].

    Returns:
        nan where nothing is expected within 4 px [m].
    """
    first = max(round(v) - _REACH, 0), max(round(u) - _REACH, 0)
    window = depth[first[0] : round(v) + _REACH + 1, first[1] : round(u) + _REACH + 1]
    rows, columns = np.nonzero(np.isfinite(window))
    if not len(rows):
        return float("nan")
    nearest = np.argmin(np.hypot(rows + first[0] - v, columns + first[1] - u))
    return float(window[rows[nearest], columns[nearest]])


def other_sights(rig: MirrorRig, side: int, pixels: ArrayLike, depths: ArrayLike) -> NDArray:
    """Return where the other camera should see spots, on the body's surface or on the glass.

    Args:
        side: The camera that sees the spots, 0 or 1.
        pixels: Where. Shape (N, 2).
        depths: Along its optical axis, to where the surface's reflection seems to be there; not
            finite where no surface is expected [m]. Shape (N,).

    Returns:
        Columns and rows of all that the other camera can see, those on the surface first. Shape
        (K, 2).
    """
    camera, other = rig.rig.cameras[side], 1 - side
    ways, depths = camera.directions(pixels), np.asarray(depths, dtype=float)
    seen = np.isfinite(depths)
    behind = apply(camera.X_WC, ways[seen] * (depths[seen] / ways[seen, 2])[:, None])
    on_surface = rig.project(reflect(rig.plane, behind))[:, 2 * other : 2 * other + 2]
    start, ahead = camera.X_WC[:3, 3], ways @ camera.X_WC[:3, :3].T
    far = -rig.plane.distance_to(start) / (ahead @ rig.plane.normal)
    on_glass = rig.rig.cameras[other].project(start + far[:, None] * ahead)
    found = np.concatenate([on_surface, on_glass])
    return found[np.isfinite(found).all(axis=1)]
