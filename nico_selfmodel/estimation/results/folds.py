"""Folds of cross-validation: which observations are left out together."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

FOLDS = 5
_TOLD = 1e-11
"""Information without a fold, of the largest, below which nothing is told."""


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


def told_step(H: NDArray, g: NDArray, unit: NDArray) -> tuple[NDArray, NDArray]:
    """Return the Gauss-Newton step without a fold, and the directions that are then not told.

    With H / (u u') = V diag(h) V', dx = -V h^-1 V' g over the directions whose h is not nothing.

    Args:
        H: Normal matrix of what is not left out. Shape (p, p).
        g: Gradient of the same. Shape (p,).
        unit: By which parameters compare, u: roots of the diagonal of the whole H. Shape (p,).

    Returns:
        The step, shape (p,), and the directions, as columns of shape (p, e).
    """
    unit = np.where(unit > 0.0, unit, 1.0)
    known, vectors = np.linalg.eigh(H / np.outer(unit, unit))
    told = known > _TOLD * known[-1]
    step = -(vectors[:, told] / known[told]) @ (vectors[:, told].T @ (g / unit))
    return step / unit, vectors[:, ~told] / unit[:, None]
