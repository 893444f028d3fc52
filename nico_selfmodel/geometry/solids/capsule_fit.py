"""Capsules around points: what collides as a surface would that was only seen in parts.

One capsule: of many directions of its axis the one whose capsule has the least volume. Across the
axis its radius is that of the least circle about the points (Badoiu and Clarkson 2003, to one
part in the number of steps); along it, it is as long as its ends need to be. Several: points are
handed to and fro until each is in the capsule it is deepest in, as in k-means, and those capsules
count as best in which points are least deep.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.checked_points import checked_points
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids
from nico_selfmodel.geometry.transform import transform

_DIRECTIONS = 100
"""Of axes on a half sphere that are tried at first, 10 deg apart."""
_CLOSER = (0.08, 0.04, 0.02, 0.01)
"""How far directions are from the best one in later tries [rad]."""
_MANY = 500
"""Points by which directions are judged; all of them are held."""
_STEPS = 60
"""Towards the middle of the least circle."""
_ROUNDS = 8
"""In which points are handed from one capsule to another."""
_FEWEST = 30
"""Points that a capsule of several is fitted to."""
_CLOSE = 1e-3
"""Points that are no deeper than this in the mean need no more capsules [m]."""
_WORTH = 0.97
"""Points must be so much less deep for one more capsule."""
_THINNEST = 1e-4
"""Radius and length of a capsule about less than that [m]."""


def fit_capsule(p_FQ: ArrayLike) -> Solid:
    """Return the capsule of about the least volume that holds all points.

    Args:
        p_FQ: Points [m]. Shape (N, 3) with N >= 1.

    Raises:
        ValueError: If there is no point, or one is not finite.
    """
    points = checked_points(p_FQ, 1)
    few = points[:: -(-len(points) // _MANY)]
    best = _best(few, _half_sphere(_DIRECTIONS))
    for step in _CLOSER:
        best = _best(few, _about(best, step))
    return _capsule(points, best)


def fit_capsules(p_FQ: ArrayLike, most: int) -> tuple[Solid, ...]:
    """Return capsules that hold all points together, as many as fit more closely.

    Args:
        p_FQ: Points [m]. Shape (N, 3) with N >= 1.
        most: Capsules that there may be.

    Raises:
        ValueError: If there is no point, one is not finite, or no capsule is allowed.
    """
    if most < 1:
        raise ValueError(f"most must be 1 or more, got {most}")
    points = checked_points(p_FQ, 1)
    found = (fit_capsule(points),)
    for _ in range(1, most):
        owner = _halved(points, found)
        if _depth(found, points) < _CLOSE or np.bincount(owner).min() < _FEWEST:
            break
        more = _several(points, owner)
        if _depth(more, points) > _WORTH * _depth(found, points):
            break
        found = more
    return found


def _several(points: NDArray, owner: NDArray) -> tuple[Solid, ...]:
    """Return the smallest capsules that were met while points were handed to and fro."""
    met = []
    for _ in range(_ROUNDS):
        met.append(tuple(fit_capsule(points[owner == k]) for k in np.unique(owner)))
        after = distance_to_solids(met[-1], points)[1]
        if np.array_equal(after, owner) or np.bincount(after).min() < _FEWEST:
            break
        owner = after
    return min(met, key=lambda one: _depth(one, points))


def _halved(points: NDArray, capsules: tuple[Solid, ...]) -> NDArray:
    """Return the capsule of each point, those of the largest halved where they are longest."""
    owner = distance_to_solids(capsules, points)[1]
    depth = -distance_to_solids(capsules, points)[0]
    largest = int(np.argmax(np.bincount(owner, depth, len(capsules))))
    own = np.flatnonzero(owner == largest)
    off = points[own] - points[own].mean(axis=0)
    along = off @ np.linalg.svd(off, full_matrices=False)[2][0]
    owner[own[along > np.median(along)]] = len(capsules)
    return owner


def _depth(capsules: tuple[Solid, ...], points: NDArray) -> float:
    """Return how deep points are inside, in the mean [m]."""
    return -float(np.mean(distance_to_solids(capsules, points)[0]))


def _best(points: NDArray, ways: NDArray) -> NDArray:
    """Return the direction whose capsule is smallest. Shape (3,)."""
    _, radius, low, high = _around(points, ways)
    volume = radius**2 * (np.maximum(high - low, 0.0) + 4.0 / 3.0 * radius)
    return ways[np.argmin(volume)]


def _capsule(points: NDArray, way: NDArray) -> Solid:
    """Return the capsule about points whose axis has a direction."""
    middle, radius, low, high = (one[0] for one in _around(points, way[None]))
    basis = tangent_basis(way)
    center = basis @ middle + 0.5 * (low + high) * way
    size = (max(float(radius), _THINNEST), max(float(high - low), _THINNEST))
    return Solid("capsule", size, transform(np.column_stack([basis, way]), center))


def _around(points: NDArray, ways: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return middles across, radii, and where ends are along each of several axes.

    Shapes (D, 2), (D,), (D,), (D,).
    """
    flat = np.einsum("nk,dkj->dnj", points, np.stack([tangent_basis(way) for way in ways]))
    middle = flat.mean(axis=1)
    for step in range(1, _STEPS + 1):
        off = flat - middle[:, None]
        farthest = np.argmax(np.einsum("dnj,dnj->dn", off, off), axis=1)
        middle += off[np.arange(len(ways)), farthest] / (step + 1.0)
    aside = np.linalg.norm(flat - middle[:, None], axis=2)
    radius = aside.max(axis=1)
    along, cap = ways @ points.T, np.sqrt(np.maximum(radius[:, None] ** 2 - aside**2, 0.0))
    low, high = (along + cap).min(axis=1), (along - cap).max(axis=1)
    # Where half spheres hold all, they are one sphere, between the bounds.
    both = 0.5 * (low + high)
    crossed = low > high
    return middle, radius, np.where(crossed, both, low), np.where(crossed, both, high)


def _half_sphere(count: int) -> NDArray:
    """Return directions evenly over a half sphere. Shape (count, 3)."""
    k = np.arange(count)
    z, turn = (k + 0.5) / count, k * np.pi * (3.0 - np.sqrt(5.0))
    aside = np.sqrt(1.0 - z**2)
    return np.stack([aside * np.cos(turn), aside * np.sin(turn), z], axis=1)


def _about(way: NDArray, step: float) -> NDArray:
    """Return a direction and eight beside it. Shape (9, 3)."""
    turn = np.arange(8) * (0.25 * np.pi)
    beside = way + step * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ tangent_basis(way).T
    ways = np.concatenate([way[None], beside])
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)
