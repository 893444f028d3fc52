"""A camera's pose from points whose positions are known (direct linear transform, RANSAC)."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.transform import inverse, transform

FEWEST = 6
"""Points that a linear resection needs."""
_FARTHEST = 1e3
"""Times how far points are spread that they are from a camera that tells them apart."""


def camera_pose(p_WQ: NDArray, rays: NDArray) -> NDArray:
    """Return X_WC of a camera that sees points along unit rays.

    [ray]x (R p + t) = 0 is linear in R and t; R is made a rotation afterwards.

    Args:
        p_WQ: Points, not all in one plane. Shape (N, 3), N >= 6.
        rays: Unit directions in the camera's frame. Shape (N, 3).

    Returns:
        Shape (4, 4).
    """
    middle, size = p_WQ.mean(axis=0), max(float(p_WQ.std()), 1e-12)
    unit = (p_WQ - middle) / size
    long = np.concatenate([unit, np.ones((len(unit), 1))], axis=1)
    a, b, c = rays.T
    zero = np.zeros_like(long)
    rows = np.concatenate(
        [
            np.hstack([zero, -c[:, None] * long, b[:, None] * long]),
            np.hstack([c[:, None] * long, zero, -a[:, None] * long]),
            np.hstack([-b[:, None] * long, a[:, None] * long, zero]),
        ]
    )
    P = np.linalg.svd(rows, full_matrices=False)[2][-1].reshape(3, 4)
    P = P * np.sign(np.linalg.det(P[:, :3]) or 1.0)
    scale = np.cbrt(max(float(np.linalg.det(P[:, :3])), 1e-300))
    R = nearest_rotation(P[:, :3])
    t = P[:, 3] / scale * size - R @ middle
    return inverse(transform(R, t))


def robust_camera_pose(
    p_WQ: NDArray, rays: NDArray, within: float, rng: np.random.Generator, draws: int = 200
) -> tuple[NDArray, NDArray]:
    """Return X_WC and which points agree with it (RANSAC; Fischler, Bolles 1981).

    Args:
        p_WQ: Points. Shape (N, 3), N >= 6.
        rays: Unit directions in the camera's frame. Shape (N, 3).
        within: Angle between a ray and its point within which they agree [rad].
        draws: How many sets of six are tried.

    Returns:
        Shape (4, 4) and boolean, shape (N,).
    """
    best, agree = np.eye(4), np.zeros(len(rays), dtype=bool)
    middle, size = p_WQ.mean(axis=0), float(np.sqrt(np.var(p_WQ, axis=0).sum()))
    for _ in range(draws):
        chosen = rng.choice(len(rays), FEWEST, replace=False)
        X = camera_pose(p_WQ[chosen], rays[chosen])
        if not np.linalg.norm(X[:3, 3] - middle) < _FARTHEST * size:
            continue
        found = agreeing(X, p_WQ, rays, within)
        if found.sum() > agree.sum():
            best, agree = X, found
            if agree.mean() > 0.95:
                break
    for _ in range(3):
        if agree.sum() >= FEWEST:
            again = camera_pose(p_WQ[agree], rays[agree])
            found = agreeing(again, p_WQ, rays, within)
            if found.sum() < agree.sum():
                break
            best, agree = again, found
    return best, agree


def agreeing(X_WC: NDArray, p_WQ: NDArray, rays: NDArray, within: float) -> NDArray:
    """Return which points a camera at X_WC sees along their rays. Boolean, shape (N,)."""
    return np.asarray(cosines(X_WC, p_WQ, rays) > np.cos(within))


def cosines(X_WC: NDArray, p_WQ: NDArray, rays: NDArray) -> NDArray:
    """Return the cosines of the angles between rays and where their points are. Shape (N,)."""
    p = (p_WQ - X_WC[:3, 3]) @ X_WC[:3, :3]
    return np.asarray(np.sum(p * rays, axis=1) / np.maximum(np.linalg.norm(p, axis=1), 1e-12))
