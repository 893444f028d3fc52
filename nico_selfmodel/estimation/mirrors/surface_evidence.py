"""How surprising one place of the own surface is in all pictures that show it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mark_place import GATE_3
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.optimization.chi_square import as_rare_as

_SAME = 0.01
"""What a camera sees nearer or farther than a place by this is not that place [m]."""


@dataclass(frozen=True, eq=False)
class SurfaceView:
    """One camera's picture of the own body in a mirror."""

    look: int
    """Which look it belongs to: those of one look are of the same moment."""
    side: int
    """Which camera, 0 or 1."""
    rig: MirrorRig
    """The cameras and the mirror."""
    places: NDArray
    """Chi-square of three degrees of freedom about each pixel; nan where nothing is judged.
    Shape (h, w)."""
    depth: NDArray
    """Along the optical axis to where the reflection seems to be [m]. Shape (h, w)."""
    labels: NDArray
    """Number of the link that is seen. Shape (h, w)."""
    poses: Mapping[int, NDArray]
    """Number of each link -> its pose in the world. Shape (4, 4)."""


def surprising_together(
    views: Sequence[SurfaceView], threshold_of: Callable[[int, int], float]
) -> list[NDArray]:
    """Return what of each picture surprises by all pictures of the same places of the surface.

    A place of the surface that m pictures judge has the chi-squares c_1 ... c_m, of three degrees
    of freedom each. It surprises if

        sum c_i - max c_i > T(n, 3 (m - 1)),    n P(chi^2_(3 (m - 1)) > T) = the false alarms

    and if, of three or more, also those without the two largest together differ as one place in a
    thousand does. No picture counts alone, nor do two: what one camera sees on the glass lies
    before other places of the surface for another, but in two mirrors before nearly the same ones
    for the same camera. The sum without its largest part is at most that of any m - 1 parts, so
    that T is exceeded at most as often as is said if pictures err independently. Such a place
    surprises in every picture that shows it, however little it does in that one alone.

    Args:
        views: All pictures of the body in mirrors.
        threshold_of: T of the number of places and the degrees of freedom.

    Returns:
        For each picture which pixels. Shape (h, w) each.
    """
    count = sum(int(np.isfinite(view.places).sum()) for view in views)
    above = [np.zeros(view.places.shape, dtype=bool) for view in views]
    for view in views:
        for mask, (rows, columns) in zip(
            above, _together(view, views, count, threshold_of), strict=True
        ):
            mask[rows, columns] = True
    return above


def _together(
    view: SurfaceView,
    views: Sequence[SurfaceView],
    count: int,
    threshold_of: Callable[[int, int], float],
) -> list[tuple[NDArray, NDArray]]:
    """Return where each picture shows the places of one picture that surprise by all of them."""
    rows, columns = np.nonzero(np.isfinite(view.places))
    labels, p_FQ = _on_links(view, rows, columns)
    shown = [_shown(other, labels, p_FQ) for other in views]
    each = np.array([chi_square for chi_square, _, _ in shown])
    judged = np.isfinite(each)
    filled = np.where(judged, each, 0.0)
    number = judged.sum(axis=0)
    least = np.array(
        [np.inf, np.inf, *(threshold_of(count, 3 * (m - 1)) for m in range(2, 1 + len(views)))]
    )
    rest = filled.sum(axis=0) - filled.max(axis=0)
    found = (rest > least[number]) & _without_two(filled, number)
    return [(v[found & own], u[found & own]) for own, (_, v, u) in zip(judged, shown, strict=True)]


def _without_two(filled: NDArray, number: NDArray) -> NDArray:
    """Return which places still differ as one in a thousand does without their two largest parts.

    Args:
        filled: Chi-square in each picture, 0 where it does not judge. Shape (m, N).
        number: Pictures that judge a place; it passes where there are fewer than three. Shape (N,).
    """
    rest = np.sort(filled, axis=0)[:-2].sum(axis=0)
    least = [0.0] * 3 + [as_rare_as(GATE_3, 3, 3 * (m - 2)) for m in range(3, 1 + len(filled))]
    return rest >= np.array(least)[number]


def _on_links(view: SurfaceView, rows: NDArray, columns: NDArray) -> tuple[NDArray, NDArray]:
    """Return the link of each pixel, and its place in that link's frame. (N,) and (N, 3)."""
    camera = view.rig.rig.cameras[view.side]
    ideal = camera.undistort(np.stack([columns, rows], axis=1).astype(float))
    p_CQ = np.concatenate([ideal, np.ones((len(rows), 1))], axis=1)
    p_WQ = reflect(view.rig.plane, apply(camera.X_WC, p_CQ * view.depth[rows, columns][:, None]))
    labels = view.labels[rows, columns]
    p_FQ = np.full(p_WQ.shape, np.nan)
    for label, X_WF in view.poses.items():
        own = labels == label
        p_FQ[own] = apply(inverse(X_WF), p_WQ[own])
    return labels, p_FQ


def _shown(view: SurfaceView, labels: NDArray, p_FQ: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return how surprising places of links are in a picture, and their rows and columns there.

    They are nan where it shows other places, and rows and columns then mean nothing.
    """
    p_WQ = np.full(p_FQ.shape, np.nan)
    for label, X_WF in view.poses.items():
        own = labels == label
        p_WQ[own] = apply(X_WF, p_FQ[own])
    with np.errstate(invalid="ignore"):
        pixels = view.rig.project(p_WQ)[:, 2 * view.side : 2 * view.side + 2]
    camera = view.rig.rig.cameras[view.side]
    depth = apply(camera.X_CW, reflect(view.rig.plane, p_WQ))[:, 2]
    height, width = view.places.shape
    u, v = np.nan_to_num(np.rint(pixels), nan=-1.0).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    u, v = np.where(inside, u, 0), np.where(inside, v, 0)
    same = inside & (view.labels[v, u] == labels)
    with np.errstate(invalid="ignore"):
        same &= np.abs(view.depth[v, u] - depth) < _SAME
    return np.where(same, view.places[v, u], np.nan), v, u
