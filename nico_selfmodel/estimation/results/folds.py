"""Folds of cross-validation: which observations are left out together."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

FOLDS = 5


def fold_of(groups: NDArray, folds: int = FOLDS) -> NDArray:
    """Deal whole groups (poses, boards) out to folds, in turn.

    Args:
        groups: Number of each row's group. Shape (N,).
        folds: How many; fewer where there are fewer groups.

    Returns:
        Fold of each row, from 0. Shape (N,).
    """
    of = np.unique(groups, return_inverse=True)[1].reshape(len(groups))
    return of % min(folds, int(of.max(initial=0)) + 1)


def splits(fold: NDArray) -> Iterator[tuple[NDArray, NDArray]]:
    """Yield the rows to learn from and the rows left out, fold by fold. Boolean, shape (N,)."""
    for k in range(int(fold.max(initial=-1)) + 1):
        left = fold == k
        yield ~left, left
