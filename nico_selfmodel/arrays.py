"""Read-only copies of arrays, checked for shape, finiteness and what a covariance must be."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.names import shown

_ROUNDING = 1e-6
"""Of a correlation."""


def as_floats(value: ArrayLike, name: str) -> NDArray:
    """Return a copy of numbers as an array of floats.

    Args:
        value: A number, or rows of them.
        name: What the message calls it.

    Raises:
        ValueError: If something else is among them, or the rows are of different lengths.
    """
    try:
        return np.array(value, dtype=float)
    except (OverflowError, TypeError, ValueError):  # what numpy says of it is not for people
        raise ValueError(
            f"{name} must be numbers, in rows of equally many, got {shown(value)}"
        ) from None


def read_only(value: ArrayLike, dtype: Any = None) -> NDArray:
    """Return a copy that cannot be written to, of another type if one is asked for."""
    array = np.array(value, dtype=dtype)
    array.flags.writeable = False
    return array


def frozen_array(value: ArrayLike, shape: tuple[int, ...], name: str) -> NDArray:
    """Return a read-only float copy.

    Args:
        shape: The shape it must have.
        name: What the message calls it.

    Raises:
        ValueError: If the shape differs or an entry is no finite number.
    """
    array = as_floats(value, name)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    array.flags.writeable = False
    return array


def frozen_covariance(value: ArrayLike, count: int) -> NDArray:
    """Return a read-only copy of a covariance.

    It must be symmetric and have no negative eigenvalue, each to a millionth of the standard
    deviations: rounding is forgiven, whatever the units are.

    Args:
        count: Of the variables.

    Returns:
        A copy that cannot be written to. Shape (count, count).

    Raises:
        ValueError: If the shape differs, an entry is not finite, or it is no covariance.
    """
    matrix = frozen_array(value, (count, count), "covariance")
    variances = np.diag(matrix)
    if (variances < 0.0).any():
        raise ValueError(f"covariance has a negative variance: {variances.min():g}")
    scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    correlation = matrix / scale / scale[:, None]
    if np.abs(correlation - correlation.T).max(initial=0.0) > _ROUNDING:
        raise ValueError("covariance is not symmetric")
    if count and np.linalg.eigvalsh(correlation)[0] < -_ROUNDING * count:
        raise ValueError(
            "covariance is not positive semi-definite: no errors are correlated like that"
        )
    return matrix


def numbered_rows(rows: NDArray) -> tuple[NDArray, NDArray]:
    """Number equal rows, as `np.unique` does along the first axis, in a fraction of its time.

    Sums by weights without a common measure are equal only where all numbers are, but for rounding,
    which is checked.

    Args:
        rows: Without nan. Shape (N, k).

    Returns:
        Where each distinct row stands first, shape (K,), and which of them each row is, shape (N,).
    """
    keys = np.zeros(len(rows))
    for place, column in enumerate(rows.T):
        keys += np.sqrt(2.0 + place) * column
    if (np.diff(np.sort(keys)) > 0.0).all():  # without indices a sort takes a fifth of the time
        every = np.arange(len(rows))
        return every, every
    _, lead, same = np.unique(keys, return_index=True, return_inverse=True)
    if not (rows[lead][same.reshape(len(rows))] == rows).all():
        _, lead, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return lead, same.reshape(len(rows))
