"""The common normal of two lines in space."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def common_normal_feet(
    point_a: ArrayLike, direction_a: ArrayLike, point_b: ArrayLike, direction_b: ArrayLike
) -> tuple[NDArray, NDArray]:
    """Return the feet of the common normal of two lines that are not parallel.

    Solves a + s da + r x = b + t db with x along da x db (the thesis' eq. 6.10 without the detour
    of eq. 6.11-6.13).

    Args:
        point_a: A point of line a. Shape (3,).
        direction_a: Unit direction of line a. Shape (3,).
        point_b: A point of line b. Shape (3,).
        direction_b: Unit direction of line b. Shape (3,).

    Returns:
        The foot on a and the foot on b. Each of shape (3,).

    Raises:
        ValueError: If the lines are parallel to machine precision.
    """
    a, da = np.asarray(point_a, dtype=float), np.asarray(direction_a, dtype=float)
    b, db = np.asarray(point_b, dtype=float), np.asarray(direction_b, dtype=float)
    normal = np.cross(da, db)
    if np.linalg.norm(normal) < 1e-12:
        raise ValueError("parallel lines have no single common normal")
    s, t, _ = np.linalg.solve(np.stack([da, -db, normal], axis=1), b - a)
    return a + s * da, b + t * db
