"""Which part of a chessboard each camera saw, where several saw some of it at one time.

A part may lie elsewhere on the board, shifted by whole squares and turned by quarters: to one
camera it is all the same, for the board's pose takes it up. Two cameras that stand firmly must see
the same board: the right one of all places is where the first camera's board puts the second one's
corners. Where no view of a whole board says how cameras stand to each other, all views vote: the
right places give one relative pose X_CD = X_CG G X_DG^-1 in each view, with G the move between two
places; wrong ones give one that hangs on how the board was held.

A whole board of two even or two odd numbers of corners is half a turn on what it is: cameras of
which one is rolled, or hangs upside down, number its corners from opposite ends.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.lattice_places import lattice_of, places_of
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.camera_initialization import pose_of_seen_boards, poses_apart
from nico_selfmodel.estimation.cameras.rig_start import Placed, rig_links
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.names import listed

_FITS, _OTHERS = 0.25, 0.3
"""Share of a square by which corners may lie off in the right place, and share of that in the next
best one."""
_SAME = 0.5
"""Relative poses that differ by less than so many squares, seen from the board's distance, are one:
places differ by whole ones."""
_CLEARLY = 0.5
"""Share of the next best relative pose's disagreement that the best one may have."""
_CANDIDATES = 400
"""Relative poses that are voted on: those of the views with fewest places."""


def told_places(views: BoardViews, placed: Sequence[Placed]) -> tuple[BoardViews, list[Placed]]:
    """Return views in which parts lie where all cameras have the board, and the boards before each.

    Args:
        views: Corners; of some the place is not told.
        placed: Each camera by itself and its boards, in the order of `views.cameras`.

    Raises:
        EstimationError: If cameras share no board, or its parts may lie in several ways.
    """
    by_name = dict(zip(views.cameras, placed, strict=True))
    X_WC = {views.cameras[0]: np.eye(4)}
    for known, new in rig_links(views):
        poses = (by_name[known][1], by_name[new][1])
        X_WC[new] = X_WC[known] @ _voted(views.pair(known, new), poses)
    whole = joined(views, [by_name[name][0].at(X_WC[name]) for name in views.cameras])
    return whole, [(camera, _before(whole, name, camera)) for name, (camera, _) in by_name.items()]


def with_half_turns(views: BoardViews) -> BoardViews | None:
    """Return views in which cameras other than the first may have boards half a turn on.

    None where there is one camera, or boards that are something else half a turn on.
    """
    nodes, columns, rows = lattice_of(views.p_GQ)
    full = len(np.unique(nodes, axis=0)) == columns * rows == len(views.p_GQ)
    if len(views.cameras) < 2 or not full or len(places_of(nodes, columns, rows)) < 2:
        return None
    seen = np.asarray(views.seen.any(axis=2))
    others = np.arange(len(views.cameras)) > 0
    return replace(views, loose=views.loose | (seen & others))


def turned_to_fit(views: BoardViews, cameras: Sequence[Camera]) -> BoardViews:
    """Return views in which boards lie half a turn on where only so they fit in all cameras.

    Args:
        cameras: As they stand, in the order of `views.cameras`.
    """
    free = with_half_turns(views)
    if free is None:
        return views
    pixels = np.array(views.pixels)
    several = views.seen.any(axis=2).sum(axis=1) > 1
    for v in np.flatnonzero(several & ~views.loose.any(axis=1)).tolist():
        told = [found for found, left in _ways(free, cameras, v) if not left.any()]
        if told:
            pixels[v] = told[0]
    return replace(views, pixels=pixels)


def _before(views: BoardViews, name: str, camera: Camera) -> NDArray:
    """Return the pose of each view's board before one camera, nan where it saw none. (V, 4, 4)."""
    X_CG = np.full((len(views), 4, 4), np.nan)
    alone = views.only(name)
    rows = [views.names.index(view) for view in alone.names]
    X_CG[rows] = pose_of_seen_boards((camera.at(np.eye(4)),), alone)
    return X_CG


def joined(views: BoardViews, cameras: Sequence[Camera]) -> BoardViews:
    """Return views in which parts lie where cameras that stand firmly have the board.

    Args:
        views: Corners; of some the place is not told.
        cameras: About as they are and stand, in the order of `views.cameras`.

    Returns:
        Parts whose place is still not told are views of their own; none is loose.
    """
    pixels, loose = np.array(views.pixels), np.array(views.loose)
    seen = np.asarray(views.seen.any(axis=2))
    for v in np.flatnonzero(loose.any(axis=1) & (seen.sum(axis=1) > 1)).tolist():
        ways = list(_ways(views, cameras, v))
        if ways:
            pixels[v], loose[v] = min(ways, key=lambda way: np.count_nonzero(way[1]))
    return replace(views, pixels=pixels, loose=loose).apart()


def _ways(
    views: BoardViews, cameras: Sequence[Camera], view: int
) -> Iterator[tuple[NDArray, NDArray]]:
    """Return one view's corners and which are still loose, by each place of the first camera's.

    Where no camera's corners are told, those of one are put in all their places: the others must
    fit on the board.

    Yields:
        Pixels, shape (P, 2 C), and booleans, shape (C,).
    """
    loose, seen = views.loose[view], np.asarray(views.seen[view].any(axis=1))
    base = int(np.flatnonzero(seen)[np.argmin(loose[seen])])
    X_WG = _pose(views, cameras[base], base, view)
    if X_WG is None:
        return
    own = views.of_camera(views.cameras[base])[view]
    rows, places = _places(views.p_GQ, own)
    if not loose[base]:
        places = rows[None]
    moves = _rigid(views.p_GQ[rows], views.p_GQ[places])
    for place, X_WB in zip(places, X_WG @ inverse(moves), strict=True):
        pixels, left = np.array(views.pixels[view]), np.array(loose)
        pixels[:, 2 * base : 2 * base + 2], left[base] = np.nan, False
        pixels[place, 2 * base : 2 * base + 2] = own[rows]
        for c in np.flatnonzero(left).tolist():
            columns = slice(2 * c, 2 * c + 2)
            found = _place(views, pixels[:, columns], cameras[c], X_WB)
            if found is not None:
                pixels[:, columns], left[c] = found, False
        yield pixels, left


def _pose(views: BoardViews, camera: Camera, number: int, view: int) -> NDArray | None:
    """Return the pose of the board before one camera, X_WG; None where it cannot be told."""
    alone = views.select([view]).only(views.cameras[number])
    try:
        return camera.X_WC @ pose_of_seen_boards((camera.at(np.eye(4)),), alone)[0]
    except EstimationError:
        return None


def _place(views: BoardViews, pixels: NDArray, camera: Camera, X_WG: NDArray) -> NDArray | None:
    """Return a camera's corners where they lie on the board; None where that is not plain. (P, 2).

    Args:
        pixels: Corners in one of their places, nan where not seen. Shape (P, 2).
        X_WG: Pose of the board. Shape (4, 4).
    """
    seen, places = _places(views.p_GQ, pixels)
    shown = camera.project(apply(X_WG, views.p_GQ))
    off = np.linalg.norm(shown[places] - pixels[seen], axis=2)
    missed = np.nan_to_num(np.median(off, axis=1), nan=np.inf)
    order = np.argsort(missed)
    square = _nearest(pixels[seen])
    if not missed[order[0]] < _FITS * square:
        return None
    if len(order) > 1 and not missed[order[0]] < _OTHERS * missed[order[1]]:
        return None
    found = np.full_like(pixels, np.nan)
    found[places[order[0]]] = pixels[seen]
    return found


def _places(p_GQ: NDArray, pixels: NDArray) -> tuple[NDArray, NDArray]:
    """Return which corners are seen, and which of the board they may be. Shapes (n,), (k, n)."""
    nodes, columns, rows = lattice_of(p_GQ)
    seen = np.flatnonzero(np.isfinite(pixels[:, 0]))
    places = places_of(nodes[seen], columns, rows)
    return seen, places[..., 1] * columns + places[..., 0]


def _nearest(pixels: NDArray) -> float:
    """Return the median distance of the nearest neighbours [px]. Shape (n, 2)."""
    apart = np.linalg.norm(pixels[:, None] - pixels, axis=2)
    return float(np.median(np.partition(apart, 1, axis=1)[:, 1]))


def _voted(views: BoardViews, poses: tuple[NDArray, NDArray]) -> NDArray:
    """Return how a second camera stands to a first one, by boards of which both saw parts.

    By X_CG and X_DG of all views, nan where a camera saw nothing, shapes (V, 4, 4): X_CD. (4, 4).

    Raises:
        EstimationError: If the parts may lie in several ways.
    """
    both = np.flatnonzero(np.asarray(views.seen.any(axis=2)).all(axis=1))
    if not views.loose[both].any(axis=1).all():
        both = both[~views.loose[both].any(axis=1)]
    options = [poses[0][v] @ _moves(views, int(v)) @ inverse(poses[1][v]) for v in both]
    options.sort(key=len)
    candidates = np.concatenate(options)[:_CANDIDATES]
    depth = float(np.median(poses[0][both, 2, 3]))
    square = float(np.linalg.norm(views.p_GQ[1] - views.p_GQ[0])) / depth
    apart = [poses_apart(candidates, one, depth).min(axis=1) for one in options]
    cost = np.minimum(apart, square).sum(axis=0)  # further off, all are alike wrong
    best = int(np.argmin(cost))
    other = poses_apart(candidates, candidates[best][None], depth)[:, 0] > _SAME * square
    if other.any() and cost[best] >= _CLEARLY * cost[other].min():
        raise EstimationError(
            f"cameras {listed(views.cameras)} saw no board whole at one time, and parts of it may "
            "lie in several ways: show all of the board to both in some photographs, or take a "
            "board with tags"
        )
    return candidates[best]


def _moves(views: BoardViews, view: int) -> NDArray:
    """Return moves of the board, from its place in the second camera to that in the first.

    Returns:
        Shape (k, 4, 4).
    """
    found = [np.eye(4)[None], np.eye(4)[None]]
    for c, camera in enumerate(views.cameras):
        if views.loose[view, c]:
            pixels = views.of_camera(camera)[view]
            seen, places = _places(views.p_GQ, pixels)
            found[c] = _rigid(views.p_GQ[seen], views.p_GQ[places])
    moves = (inverse(found[0])[:, None] @ found[1]).reshape(-1, 4, 4)
    _, first = np.unique(np.round(moves.reshape(len(moves), -1), 6), axis=0, return_index=True)
    return moves[first]


def _rigid(points: NDArray, moved: NDArray) -> NDArray:
    """Return the moves in a plane that take points to others. Shapes (n, 3), (k, n, 3)."""
    a, b = points - points.mean(axis=0), moved - moved.mean(axis=1, keepdims=True)
    cosine = np.einsum("ni,kni->k", a, b)
    sine = np.einsum("n,kn->k", a[:, 0], b[..., 1]) - np.einsum("n,kn->k", a[:, 1], b[..., 0])
    turn = np.arctan2(sine, cosine)
    R = np.zeros((len(turn), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(turn)
    R[:, 1, 0], R[:, 2, 2] = np.sin(turn), 1.0
    R[:, 0, 1] = -R[:, 1, 0]
    return transform(R, moved.mean(axis=1) - R @ points.mean(axis=0))
