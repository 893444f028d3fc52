"""Where a camera sits on its link, from markers of which no place is known, and how the link moves.

Rays a, b of one marker from two poses and the line between the camera's two places lie in a plane:
with R_a the link's turn in the marker's link, o_a its place, d pixels' directions in the camera,

    (R_a R d_a x R_b R d_b) . ((R_b - R_a) t + o_b - o_a) = 0

for the camera's turn R and place t on its link (the epipolar constraint, Longuet-Higgins 1981, of
known motion). Given R it is linear in t: of turns drawn at random the best few are refined. Which
of them is right the angles tell between rays and where those of each marker meet, before the
camera.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.tree_observations import SensorRows
from nico_selfmodel.geometry.rotation import nearest_rotation, rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.tree_motion import TreeMotion

FEWEST_PAIRS = 20
"""Pairs of observations of one marker that are needed; six numbers are asked for."""
_MOST_PAIRS = 400
"""Pairs that are asked; of more some are drawn."""
_TURNS, _REFINED, _STEPS = 1000, 60, 15
"""Turns that are drawn at once, those of them that are refined, and steps of each."""
_LEAST_ANGLE = 0.05
"""Sine of the angle between two rays below which noise turns their plane."""
_NEAR = 0.3
"""Weight that keeps a camera near its link's frame where rays leave that open [1/m]."""
_BATCHES = 3
"""Times that turns are drawn."""
_FAR = 0.1
"""Angle at which a ray misses its marker by any amount [rad]."""
_WITHIN = 0.02
"""Angle by which half of all rays may miss their markers at most [rad]."""
_EXACT = 1e-6
"""Distance of two rays that is none [m]."""
_OPEN = 1e-9
"""Weight by which markers of one ray are at its link's frame."""


def on_link_among_unknown(
    motion: TreeMotion, rows: SensorRows, link: int, rng: np.random.Generator
) -> NDArray | None:
    """Return where a camera sits on its link, from markers on others.

    Returns:
        X_LC, shape (4, 4); None where it saw too little to tell.
    """
    on = np.array([marker.on for marker in motion.tree.markers])[rows.marker]
    own = on != link
    pose, on = rows.pose[own], on[own]
    R_WM, p_WM = motion.R_WL[on, :, :, pose], motion.p_WL[on, :, pose]
    R_WL, p_WL = motion.R_WL[link][:, :, pose].transpose(2, 0, 1), motion.p_WL[link][:, pose].T
    R = np.swapaxes(R_WM, 1, 2) @ R_WL
    p = np.einsum("nji,nj->ni", R_WM, p_WL - p_WM)
    rays = motion.tree.lenses[rows.name].directions(rows.measured[own])
    return camera_among_unknown(rays, rows.marker[own], R, p, rng)


def camera_among_unknown(
    rays: NDArray, marker: NDArray, R: NDArray, p: NDArray, rng: np.random.Generator
) -> NDArray | None:
    """Return where a camera sits on its link.

    Args:
        rays: Directions in the camera, nan where a pixel has none. Shape (N, 3).
        marker: Which marker each is of. Shape (N,).
        R: Turn of the camera's link in the marker's at each observation. Shape (N, 3, 3).
        p: Its place there [m]. Shape (N, 3).

    Returns:
        X_LC, shape (4, 4); None where there are too few pairs of observations, or half of all rays
        miss where others of their markers meet.
    """
    told = np.isfinite(rays).all(axis=1)
    rays, marker, R, p = (
        rays[told],
        np.unique(marker[told], return_inverse=True)[1],
        R[told],
        p[told],
    )
    pairs = _pairs(marker, rng)
    if len(pairs) < FEWEST_PAIRS:
        return None
    i, j = pairs.T
    both = (rays[i], rays[j], R[i], R[j], p[j] - p[i])
    for _ in range(_BATCHES):
        turns = nearest_rotation(rng.normal(size=(_TURNS, 3, 3)))
        turns[:, :, 0] *= np.sign(np.linalg.det(turns))[:, None]
        begun = [_placed(turn, *both) for turn in turns]
        best = np.argsort([cost for cost, _ in begun])[:_REFINED]
        refined = [_refined(turns[k], begun[k][1], *both) for k in best]
        angles = [_angles(turn, t, rays, marker, R, p) for turn, t in refined]
        k = int(np.argmin([np.mean(np.minimum(one, _FAR) ** 2) for one in angles]))
        if np.median(angles[k]) < _WITHIN:
            return transform(*refined[k])
    return None


def _angles(
    turn: NDArray, t: NDArray, rays: NDArray, marker: NDArray, R: NDArray, p: NDArray
) -> NDArray:
    """Return by how much rays miss where those of their markers meet, nearest to all. [rad], (N,).

    The squared distances from lines are least where sum (I - d d') (x - o) = 0.
    """
    o, d = R @ t + p, np.einsum("nij,nj->ni", R @ turn, rays)
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    A, b = np.zeros((marker.max() + 1, 3, 3)), np.zeros((marker.max() + 1, 3))
    np.add.at(A, marker, across)
    np.add.at(b, marker, np.einsum("nij,nj->ni", across, o))
    away = np.linalg.solve(A + _OPEN * np.eye(3), b[:, :, None])[marker, :, 0] - o
    along = np.einsum("ni,ni->n", away, d)
    return np.arctan2(np.linalg.norm(np.cross(away, d), axis=1), along)


def _pairs(marker: NDArray, rng: np.random.Generator) -> NDArray:
    """Return pairs of observations of one marker, not more than are needed. Shape (n, 2)."""
    found = []
    for m in np.unique(marker[marker >= 0]).tolist():
        own = np.flatnonzero(marker == m)
        first, second = np.triu_indices(len(own), 1)
        found.append(np.column_stack([own[first], own[second]]))
    pairs = np.concatenate(found) if found else np.zeros((0, 2), dtype=int)
    if len(pairs) > _MOST_PAIRS:
        pairs = pairs[rng.choice(len(pairs), _MOST_PAIRS, replace=False)]
    return pairs


def _planes(
    turn: NDArray, di: NDArray, dj: NDArray, Ri: NDArray, Rj: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Return rays in the marker's link, and one over the length of their cross product."""
    a, b = np.einsum("nij,nj->ni", Ri @ turn, di), np.einsum("nij,nj->ni", Rj @ turn, dj)
    size = np.linalg.norm(np.cross(a, b), axis=1)
    return a, b, 1.0 / np.maximum(size, _LEAST_ANGLE)


def _placed(
    turn: NDArray, di: NDArray, dj: NDArray, Ri: NDArray, Rj: NDArray, gap: NDArray
) -> tuple[float, NDArray]:
    """Return how far rays miss their planes at a turn, and the best place. [m], (3,)."""
    a, b, weight = _planes(turn, di, dj, Ri, Rj)
    normal = np.cross(a, b) * weight[:, None]
    by_t = np.einsum("ni,nij->nj", normal, Rj - Ri)
    rest = np.einsum("ni,ni->n", normal, gap)
    rows = np.vstack([by_t, _NEAR * np.eye(3)])
    t = np.linalg.lstsq(rows, np.append(-rest, np.zeros(3)), rcond=None)[0]
    return float(np.median(np.abs(by_t @ t + rest))), t


def _refined(
    turn: NDArray,
    t: NDArray,
    di: NDArray,
    dj: NDArray,
    Ri: NDArray,
    Rj: NDArray,
    gap: NDArray,
) -> tuple[NDArray, NDArray]:
    """Refine turn and place, rays that miss by much weighed less (Cauchy)."""
    miss = np.full(len(di), np.inf)
    for _ in range(_STEPS):
        a, b, weight = _planes(turn, di, dj, Ri, Rj)
        along = np.einsum("nij,j->ni", Rj - Ri, t) + gap
        miss = weight * np.einsum("ni,ni->n", np.cross(a, b), along)
        # (a x b) . c by a turn w of R: w . (d_a x R_a'(b x c) + d_b x R_b'(c x a)).
        u = np.einsum("nji,nj->ni", Ri @ turn, np.cross(b, along))
        v = np.einsum("nji,nj->ni", Rj @ turn, np.cross(along, a))
        by_turn = weight[:, None] * (np.cross(di, u) + np.cross(dj, v))
        by_t = weight[:, None] * np.einsum("ni,nij->nj", np.cross(a, b), Rj - Ri)
        usual = max(2.0 * float(np.median(np.abs(miss))), _EXACT)
        robust = 1.0 / np.sqrt(1.0 + (miss / usual) ** 2)
        J = np.hstack([by_turn, by_t]) * robust[:, None]
        step = np.linalg.lstsq(J, -miss * robust, rcond=None)[0]
        turn, t = turn @ rotation_from_vector(step[:3]), t + step[3:]
    return nearest_rotation(turn), t
