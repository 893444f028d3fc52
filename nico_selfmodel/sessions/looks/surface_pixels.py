"""What pictures show of a link's surface about a place of it."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.painted_disc import SurfacePixels, light_of
from nico_selfmodel.estimation.mirrors.surface_evidence import SurfaceView, on_links
from nico_selfmodel.geometry.solids.solid import distance_to_solids, onto_solids
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.plant.link_surfaces import LinkSurface
from nico_selfmodel.sessions.looks.expecting import MirrorLook
from nico_selfmodel.vision.surprise.blobs import threshold_of
from nico_selfmodel.vision.surprise.spot_middle import pixels_about
from nico_selfmodel.vision.surprise.surprise import Surprise

_ASIDE, _BACK = 1e-4, 5e-3
"""How far beside a place it is asked how pixels move, and how far before what is rendered its
surface is looked for [m]."""
_ABOUT = 6.0
"""Radius of a mark, about which is looked for more of it [px]."""


def surface_pixels(
    p_FM: NDArray,
    number: int,
    surface: LinkSurface,
    view: SurfaceView,
    look: MirrorLook,
    change: Surprise | None,
) -> SurfacePixels | None:
    """Return a picture's pixels about a place of a link; None where hardly any is judged."""
    if number not in view.poses:
        return None
    X_WF = view.poses[number]
    near = apply(X_WF, p_FM + _ASIDE * np.vstack([np.zeros(3), np.eye(3)]))
    pixels = view.rig.project(near)[:, 2 * view.side : 2 * view.side + 2]
    parts = [look.surprise] if change is None else [look.surprise, change]
    if not np.isfinite(pixels).all():
        return None
    u, v = float(pixels[0, 0]), float(pixels[0, 1])
    seen = pixels_about(u, v, _ABOUT, look.picture, parts)
    if seen is None:
        return None
    columns, rows = seen.at.astype(int).T
    own = view.labels[rows, columns] == number
    p_FQ, colors = np.full((2, len(own), 3), np.nan)
    # What is rendered are polygons, that lie inside of the surface by up to half a millimetre.
    shown = on_links(view, rows[own], columns[own])[1]
    ways = shown - apply(inverse(X_WF), view.rig.virtual.cameras[view.side].X_WC[None, :3, 3])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    p_FQ[own] = onto_solids(surface.solids, shown - _BACK * ways, ways)
    own = np.isfinite(p_FQ).all(axis=1)
    colors[own] = 255.0 * surface.colors[distance_to_solids(surface.solids, p_FQ[own])[1], ::-1]
    light = light_of(seen.at, seen.under, colors)
    p_FQ[np.isnan(light[:, 0])] = np.nan
    by_place = (pixels[1:] - pixels[0]).T / _ASIDE
    surprising = seen.chi_square > threshold_of(len(rows))
    return SurfacePixels(
        seen.at, p_FQ, seen.seen, seen.under, light, seen.inverse, by_place, surprising
    )
