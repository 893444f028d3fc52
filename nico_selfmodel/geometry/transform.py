"""Rigid transforms as 4 x 4 matrices, stacked along leading axes.

What may hold Drake's `AutoDiffXd` or `Expression` is an array of objects then.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def transform(rotation: ArrayLike, translation: ArrayLike) -> NDArray:
    """Assemble X = [R p; 0 1].

    Args:
        rotation: Shape (..., 3, 3).
        translation: Shape (..., 3).

    Returns:
        Shape (..., 4, 4).
    """
    rotation, translation = np.asarray(rotation), np.asarray(translation)
    lead = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    out = np.zeros((*lead, 4, 4), np.result_type(rotation, translation, float))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = rotation, translation, 1.0
    return out


def inverse(x: ArrayLike) -> NDArray:
    """Invert rigid transforms, X^-1 = [R' -R'p; 0 1]. Shape (..., 4, 4) -> (..., 4, 4)."""
    x = np.asarray(x, dtype=float)
    rotation = np.swapaxes(x[..., :3, :3], -1, -2)
    return transform(rotation, -(rotation @ x[..., :3, 3:])[..., 0])


def apply(x: ArrayLike, points: ArrayLike) -> NDArray:
    """Move points by rigid transforms, p' = R p + t.

    Args:
        x: Shape (..., 4, 4).
        points: Shape (..., 3), broadcast against `x`.

    Returns:
        Shape (..., 3).
    """
    x = np.asarray(x, dtype=float)
    return np.einsum("...ij,...j->...i", x[..., :3, :3], np.asarray(points)) + x[..., :3, 3]


def check_rigid(X: NDArray, name: str, within: float = 1e-9) -> None:
    """Refuse what is no pose: axes that are not square and of unit length, or a mirror image.

    Args:
        X: Shape (..., 4, 4).
        name: What the message calls it.
        within: How far an entry of R R' may be off.

    Raises:
        ValueError: If one is none.
    """
    R = X[..., :3, :3]
    off = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(initial=0.0)
    right_handed = bool((np.linalg.det(R) > 0.0).all())
    if not (off <= within and right_handed and (X[..., 3, :] == [0.0, 0.0, 0.0, 1.0]).all()):
        raise ValueError(f"{name} is not a rigid transform")
