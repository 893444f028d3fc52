"""Read-only copies of arrays, checked for shape and finiteness."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def frozen_array(value: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray:
    """Return a read-only float copy.

    Args:
        value: The array.
        shape: The shape it must have.
        name: What the message calls it.

    Returns:
        A copy that cannot be written to.

    Raises:
        ValueError: If the shape differs or an entry is not finite.
    """
    array = np.array(value, dtype=float)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    array.flags.writeable = False
    return array
