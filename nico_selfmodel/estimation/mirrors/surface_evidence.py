"""How surprising one place of the own surface is in all pictures that show it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mark_place import GATE_3
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig

_MANY = 3
"""Pictures of which not two may decide."""
_ABOUT, _NARROW = 3e-3, 1.5
"""What about a place must be shown with it [m], and how wide it must look [px]."""
_SAME = 0.01
"""What a camera sees nearer or farther than a place by this is not that place [m]."""


@dataclass(frozen=True, eq=False)
class SurfaceView:
    """One camera's picture of the own body in a mirror."""

    side: int
    """Which camera, 0 or 1."""
    rig: MirrorRig
    """The cameras and the mirror."""
    places: NDArray
    """Chi-square of three degrees of freedom about each pixel; nan where nothing is judged.
    Shape (h, w)."""
    off: NDArray
    """What each judged place differs by, row by row [grey levels]. Shape (n, 3)."""
    covariance: NDArray
    """Of that. Shape (n, 3, 3)."""
    alike: NDArray
    """What of that is wrong in all pictures alike. Shape (n, 3, 3)."""
    depth: NDArray
    """Along the optical axis to where the reflection seems to be [m]. Shape (h, w)."""
    labels: NDArray
    """Number of the link that is seen. Shape (h, w)."""
    poses: Mapping[int, NDArray]
    """Number of each link -> its pose in the world. Shape (4, 4)."""

    @property
    def judged(self) -> NDArray:
        """Which places are. Shape (h, w)."""
        return np.isfinite(self.places)


def surprising_together(
    views: Sequence[SurfaceView], threshold_of: Callable[[int, int], float]
) -> list[NDArray]:
    """Return what of each picture surprises by all pictures of the same places of the surface.

    Paint differs from what is under it alike in all pictures, by d. With e_1 ... e_m what a place
    differs by in those that judge it, C_i their covariances, and S_i what of these is no noise but
    colours and places that are expected wrongly, the least squares for d have

        z^2 = b' (sum C_i^-1 (C_i - S_i) C_i^-1 + K K')^-1 b,    b = sum C_i^-1 e_i
        K = sum C_i^-1 S_i^(1/2)

    of three degrees of freedom. What is expected wrongly is taken to be so in all pictures alike.
    (With C_i alone an edge low on the body of robot 1853 was a mark in two trials of eight.) A
    place surprises if

        z^2 > T(n),    n P(chi^2_3 > T) = the false alarms

    and if, whichever picture is left out, or of three or more whichever two, z^2 exceeds what one
    place in a thousand does. No picture counts alone, nor do two: what one camera sees on the glass
    lies before other places of the surface for another, but in two mirrors before nearly the same
    ones for the same camera. Such a place surprises in every picture that shows it, however little
    it does in that one alone.

    Args:
        views: All pictures of the body in mirrors.
        threshold_of: T of the number of places and the degrees of freedom.

    Returns:
        For each picture which pixels. Shape (h, w) each.
    """
    count = sum(int(view.judged.sum()) for view in views)
    least = threshold_of(count, 3)
    above = [np.zeros(view.places.shape, dtype=bool) for view in views]
    for view in views:
        for mask, (rows, columns) in zip(above, _together(view, views, least), strict=True):
            mask[rows, columns] = True
    return above


def _together(
    view: SurfaceView, views: Sequence[SurfaceView], least: float
) -> list[tuple[NDArray, NDArray]]:
    """Return where each picture shows the places of one picture that surprise by all of them."""
    rows, columns = np.nonzero(view.judged)
    labels, p_FQ = on_links(view, rows, columns)
    shown = [_shown(other, labels, p_FQ) for other in views]
    each = np.array([chi_square for chi_square, _, _ in shown])
    filled = np.nan_to_num(each)
    may = np.flatnonzero(filled.sum(axis=0) > least)  # z^2 of independent ones is at most this
    shown, judged = [(v[may], u[may]) for _, v, u in shown], np.isfinite(each[:, may])
    told = _told(views, shown, judged)
    numbers = range(len(views))
    rest = [
        np.min([_without(*told, some) for some in combinations(numbers, k)], axis=0) for k in (1, 2)
    ]
    rest = np.where(judged.sum(axis=0) < _MANY, *rest)
    found = (_without(*told, ()) > least) & (rest > GATE_3)
    return [(v[found & own], u[found & own]) for own, (v, u) in zip(judged, shown, strict=True)]


def _told(
    views: Sequence[SurfaceView], shown: Sequence[tuple[NDArray, NDArray]], judged: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return C^-1, C^-1 S^(1/2) and C^-1 e of places in each picture, 0 where it does not judge.

    Shapes (m, N, 3, 3) twice, and (m, N, 3).
    """
    W, K = np.zeros((2, *judged.shape, 3, 3))
    b = np.zeros((*judged.shape, 3))
    for k, (view, (v, u), own) in enumerate(zip(views, shown, judged, strict=True)):
        number = np.cumsum(view.judged).reshape(view.places.shape) - 1
        which = number[v[own], u[own]]
        W[k, own] = np.linalg.inv(view.covariance[which])
        K[k, own] = W[k, own] @ _root(view.alike[which])
        b[k, own] = np.einsum("nij,nj->ni", W[k, own], view.off[which])
    return W, K, b


def _root(covariance: NDArray) -> NDArray:
    """Return the symmetric roots of covariances. Shape (N, 3, 3)."""
    values, ways = np.linalg.eigh(covariance)
    return (ways * np.sqrt(np.maximum(values, 0.0))[:, None]) @ ways.transpose(0, 2, 1)


def _without(W: NDArray, K: NDArray, b: NDArray, left_out: Sequence[int]) -> NDArray:
    """Return z^2 without some pictures; 0 where no other judges. Shape (N,)."""
    kept = [k for k in range(len(W)) if k not in left_out]
    alike, told = K[kept].sum(axis=0), b[kept].sum(axis=0)
    noise = W[kept] - K[kept] @ K[kept].transpose(0, 1, 3, 2)
    total = noise.sum(axis=0) + alike @ alike.transpose(0, 2, 1)
    some = np.trace(total, axis1=1, axis2=2) > 0.0
    found = np.zeros(len(told))
    each = np.linalg.solve(total[some], told[some][:, :, None])[:, :, 0]
    found[some] = np.sum(told[some] * each, axis=1)
    return found


def on_links(view: SurfaceView, rows: NDArray, columns: NDArray) -> tuple[NDArray, NDArray]:
    """Return the link of each pixel, and its place in that link's frame. (N,) and (N, 3)."""
    camera = view.rig.rig.cameras[view.side]
    behind = camera.at_depth(np.stack([columns, rows], axis=1), view.depth[rows, columns])
    p_WQ = reflect(view.rig.plane, behind)
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
    same, v, u = shown_in(view, labels, p_FQ)
    return np.where(same, view.places[v, u], np.nan), v, u


def plainly_shown(view: SurfaceView, label: int, p_FM: NDArray, n_F: NDArray) -> bool:
    """Return whether a picture shows a place of a link and what is about it, not from the side.

    Args:
        label: Number of the link.
        p_FM: The place in its frame [m]. Shape (3,).
        n_F: Outward normal there. Shape (3,).
    """
    if label not in view.poses:
        return False
    E = tangent_basis(n_F)
    about = p_FM + _ABOUT * np.vstack([np.zeros(3), E.T, -E.T])
    if not shown_in(view, np.full(len(about), label), about)[0].all():
        return False
    pixels = view.rig.project(apply(view.poses[label], about))[:, 2 * view.side : 2 * view.side + 2]
    width = np.linalg.svd((pixels[1:3] - pixels[0]).T / _ABOUT)[1].min() * 2.0 * _ABOUT
    return bool(width >= _NARROW)


def shown_in(view: SurfaceView, labels: NDArray, p_FQ: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return which places of links a picture shows, and their rows and columns there.

    Args:
        labels: Number of the link of each. Shape (N,).
        p_FQ: Places in the frames of these links [m]. Shape (N, 3).

    Returns:
        Truth values, rows and columns, which mean nothing where another place is shown. (N,) each.
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
    return same, v, u
