"""Numbers that systems compute with: floats, Drake's `AutoDiffXd` and `Expression`."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

quiet = np.errstate(invalid="ignore")
"""Around what may be symbolic: products of an `Expression` raise the flag of invalid numbers."""


def of_scalars(T: Any, values: ArrayLike) -> NDArray:
    """Return values as what vectors of a kind of scalar take. Shape (n,)."""
    values = np.asarray(values)
    if T is float:
        return values
    return np.array([v if isinstance(v, T) else T(v) for v in values], dtype=object)
