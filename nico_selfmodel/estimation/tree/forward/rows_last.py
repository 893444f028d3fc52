"""Arrays with the components of vectors first and rows last, along contiguous memory."""

import numpy as np
from numpy.typing import NDArray


def consecutive(index: NDArray) -> NDArray | slice:
    """Return indices that follow each other as a slice, which copies nothing. Shape (N,)."""
    if len(index) and index[-1] - index[0] == len(index) - 1 and (np.diff(index) == 1).all():
        return slice(int(index[0]), int(index[-1]) + 1)
    return index


def at_samples(values: NDArray, rows: NDArray | slice) -> NDArray:
    """Return values of samples, `consecutive` ones by slice. Shape (..., P) -> (..., N)."""
    return values[..., rows] if isinstance(rows, slice) else np.take(values, rows, axis=-1)


def dot_first(vectors: NDArray, axes: NDArray) -> NDArray:
    """Return the sum over the first axis of products of two arrays, their components along it."""
    total = np.asarray(vectors[0] * axes[0])
    product = vectors[1] * axes[1]
    total += product
    total += np.multiply(vectors[2], axes[2], out=product)
    return total
