"""Points from outside: checked before singular values are asked what to make of a nan."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def checked_points(points: ArrayLike, least: int, name: str = "points") -> NDArray:
    """Return points as floats.

    Args:
        points: Shape (n, 3).
        least: Smallest n that serves.
        name: What the message calls them.

    Returns:
        Shape (n, 3).

    Raises:
        ValueError: If the shape is another, or a coordinate is not finite; names the row.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < least:
        raise ValueError(f"{name} must have shape (n >= {least}, 3), got {points.shape}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise ValueError(
            f"{name} must be finite, got {points[bad[0]].tolist()} in row {bad[0]}: leave out "
            "what was not measured"
        )
    return points
