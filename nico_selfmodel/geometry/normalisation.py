"""Points brought to the size of one before a linear estimate (Hartley 1997)."""

import numpy as np
from numpy.typing import NDArray


def normalised_points(points: NDArray, name: str) -> tuple[NDArray, NDArray]:
    """Return points about their centroid at rms distance sqrt 2, and the matrix that does it.

    The right form of the thesis' eq. 7.2, which takes width and height of the bounding box.

    Args:
        points: Shape (..., n, 2).
        name: What the message calls them.

    Returns:
        The moved points, shape (..., n, 2), and the map in homogeneous coordinates, shape
        (..., 3, 3).

    Raises:
        ValueError: If the points coincide.
    """
    centroid = points.mean(axis=-2, keepdims=True)
    about = points - centroid
    size = np.sqrt(np.einsum("...ij,...ij->...", about, about) / points.shape[-2])
    if np.any(size <= 1e-12 * np.abs(centroid).max(axis=(-2, -1), initial=0.0)):
        raise ValueError(f"the {name} points coincide: they determine nothing")
    scale = np.sqrt(2.0) / size
    matrix = np.zeros((*size.shape, 3, 3))
    matrix[..., 0, 0] = matrix[..., 1, 1] = scale
    matrix[..., :2, 2] = -scale[..., None] * centroid[..., 0, :]
    matrix[..., 2, 2] = 1.0
    return scale[..., None, None] * about, matrix
