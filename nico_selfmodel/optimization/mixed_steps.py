"""Fixed points of searches whose steps fall short, in fewer of them (Anderson 1965).

A search that takes x to x + f(x) goes a share of the way each time where its slopes are too large
or it finds one part after another. What its last steps changed in f tells how f goes to zero
(Walker and Ni 2011, type II): with dX and dF the differences of these x and f, and C the covariance
at x,

    x' = x + f - (dX + dF) g,    g = argmin (f - dF g)' C^-1 (f - dF g)
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_TELLS = 1e-6
"""Differences smaller than this share of the largest tell nothing."""


def mixed_step(tried: Sequence[tuple[NDArray, NDArray]], covariance: NDArray) -> NDArray:
    """Return the step that earlier ones make of the last.

    Args:
        tried: x and f(x), the last one last; at least one. Shapes (n,).
        covariance: In which measure f is small. Shape (n, n).

    Returns:
        By how much x changes: f where it is the only one. Shape (n,).
    """
    x, f = (np.array(part) for part in zip(*tried, strict=True))
    root = np.linalg.cholesky(covariance)
    by_x, by_f = np.diff(x, axis=0).T, np.diff(f, axis=0).T
    white = np.linalg.solve(root, np.column_stack([by_f, f[-1]]))
    share = np.linalg.lstsq(white[:, :-1], white[:, -1], rcond=_TELLS)[0]
    return f[-1] - (by_x + by_f) @ share
