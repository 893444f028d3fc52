"""Angles and rotation vectors on the branch nearest to another: a whole turn is no difference."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def nearest_turn(
    angle: ArrayLike, reference: ArrayLike, period: ArrayLike = 2.0 * np.pi
) -> NDArray:
    """Return angles moved by whole turns to within half a turn of others.

    Args:
        angle: Angles [rad].
        reference: What they are to be near to [rad].
        period: What a whole turn is: an encoder's is the gear's times a joint's [rad].
    """
    angle, period = np.asarray(angle, dtype=float), np.asarray(period, dtype=float)
    return angle - period * np.round((angle - np.asarray(reference, dtype=float)) / period)


def nearest_rotation_vector(vector: ArrayLike, reference: ArrayLike) -> NDArray:
    """Return the rotation vector of the same rotation that is nearest to another one.

    w and w (1 + 2 pi k / |w|) turn alike: beyond half a turn the shortest one points the other way.

    Args:
        vector: A rotation vector [rad]. Shape (3,).
        reference: What it is to be near to [rad]. Shape (3,).

    Returns:
        Shape (3,).
    """
    vector, reference = np.asarray(vector, dtype=float), np.asarray(reference, dtype=float)
    angle = float(np.linalg.norm(vector))
    # No turn at all has every axis: take the reference's.
    axis = vector / angle if angle > 1e-12 else reference / max(np.linalg.norm(reference), 1e-300)
    return axis * nearest_turn(angle, axis @ reference)
